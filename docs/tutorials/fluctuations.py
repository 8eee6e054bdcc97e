# %% [markdown]
# # Fluctuations
#
# A membrane at room temperature undulates, and the softer it is, the more. Microscopes measure the bending modulus of
# vesicles in this way. This tutorial samples a nearly spherical vesicle whose bending modulus we know, 20 kT, and
# gets it back from the undulations alone, with an error bar. It takes a quarter of a minute.
#
# You need `pip install 'openmm-helfrich[analysis]'`.

# %%
import os

import matplotlib.pyplot as plt
import numpy as np
from openmm import unit

import openmmhelfrich as mh
from openmmhelfrich.analysis import fluctuationSpectrum, meshStiffness

isSmall = os.environ.get("HELFRICH_TUTORIAL_SIZE") == "small"
bendingModulus = 20
steps = 20 if isSmall else 4000

# %% [markdown]
# ## A vesicle that is free to undulate
#
# The volume is held, as water does not pass the membrane. The area is held softly, so that undulations do not feel
# each other. Long trajectories move the slow, large waves; sweeps of flips between them keep the membrane fluid.

# %%
mesh = mh.Mesh.icosphere(2)
size, edge = len(mesh.vertices), mesh.edgeLengths.mean()
scene = mh.Scene.of(
    {
        "membrane": {
            "bending_modulus": bendingModulus,
            "area_modulus": 60 * size,
            "volume_modulus": 1e5,
            "reduced_volume": mesh.reducedVolume,
        },
        "sampling": {
            "seed": 1,
            "step_size": 2e-4,
            "steps_per_trajectory": round(0.8 * size),
            "flip_fraction": 0.5,
            "flip_probability": 0.3,
        },
    },
    mesh,
)
force = scene.createForce()
simulation = scene.createSimulation(force)

# %% [markdown]
# ## Sampling
#
# `adaptStepSize` finds a step size while the vesicle comes to equilibrium. What moves until then does not count.

# %%
mh.adaptStepSize(simulation, max(100, steps // 8))
simulation.step(steps // 8)
frames = []
for _ in range(steps):
    simulation.step(1)
    positions = simulation.context.getState(positions=True).getPositions(asNumpy=True)
    frames.append(positions.value_in_unit(unit.nanometer))

# %% [markdown]
# ## The spectrum
#
# The distance of the surface from the center is a sum of spherical harmonics of the degrees l, and theory says how
# large each is on average: ⟨|u|²⟩ = kT / κ(l−1)(l+2)(l(l+1)+σ̄). `fluctuationSpectrum` measures them, with errors
# that know how long each wave remembers its past. `fit` finds κ and the tension σ̄. It is told the edge length, since
# a mesh is softer than a smooth surface for waves of only a few edges.

# %%
spectrum = fluctuationSpectrum(frames, maxDegree=6)
fit = spectrum.fit(2, 6, edge)
print(f"kappa = {fit.bendingModulus:.1f} +- {fit.bendingModulusError:.1f} kT; it was {bendingModulus} kT")

# %%
l = spectrum.degrees
smooth = np.linspace(2, 6, 100)


def theory(degree, modulus):
    stiffness = meshStiffness(degree, edge / spectrum.radius)
    return 1 / (modulus * stiffness * (degree - 1) * (degree + 2) * (degree * (degree + 1) + fit.tension))


axes = plt.figure(figsize=(6, 4), layout="constrained").subplots()
axes.errorbar(l, spectrum.powers, spectrum.errors, fmt="o", label="measured")
axes.plot(smooth, theory(smooth, bendingModulus), label="theory, κ = 20 kT")
axes.plot(smooth, theory(smooth, 2 * bendingModulus), ls=":", label="theory, κ = 40 kT")
axes.set(xlabel="degree l", ylabel="mean |u|²", yscale="log")
axes.set_xticks(l)
axes.legend()
axes.figure.savefig("spectrum.png", dpi=110)

# %% [markdown]
# ![The measured spectrum on the line of theory](spectrum.png)
#
# This run found κ = 19.3 ± 0.2 kT: a spectrum gives κ to a few percent. Do not expect 20.0: the error bar tells how
# far chance alone may be off. Two more things pull in the same direction. Undulations that are too short for the fit
# soften the membrane by some 0.4 kT. The correction for the edge length is good to 3% on so coarse a mesh.
#
# ## Where to go
#
# - [Analysis](../how-to/analysis.md) has more on spectra, correlation times and diffusion.
# - [Validation](../results/validation.md) compares more moduli and sizes with theory.
