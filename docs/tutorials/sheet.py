# %% [markdown]
# # A sheet
#
# A small piece of a large membrane is a sheet without a border: what leaves it on the right comes back on the left.
# This tutorial makes such a periodic sheet, lets it undulate at room temperature, and reads the bending modulus and the
# tension from its waves. Then it pulls at the sheet, and its longest waves get lower. It takes two to four minutes.
#
# You need `pip install 'openmm-helfrich[analysis]'`.

# %%
import os

import matplotlib.pyplot as plt
import numpy as np
from openmm import unit

import openmmhelfrich as mh

isSmall = os.environ.get("HELFRICH_TUTORIAL_SIZE") == "small"
side, edge, bendingModulus = 16, 1.0, 20
steps = 60 if isSmall else 6000

# %% [markdown]
# ## A membrane in a periodic box
#
# `Mesh.sheet` makes flat triangles that go on across the sides of a box, `mesh.box`. For the connectivity it is a
# torus: closed, with neighbors on all sides of each vertex. The same is `sheet = [16, 16, 1]` under `[mesh]` in a file.
#
# A sheet encloses nothing, so that terms of the volume are off, and an error if one asks for them. The box holds the
# area, and `area_modulus` is 0 unless given.

# %%
mesh = mh.Mesh.sheet(side, side, edge)
print(mesh, "in a box of", np.diag(mesh.box), "nm")


def sample(tension):
    """Return the shapes of a sheet under a tension, in kT per square nanometer, and the last one as a mesh."""
    scene = mh.Scene.of(
        {
            "membrane": {"bending_modulus": bendingModulus, "tension": tension},
            "sampling": {"seed": 1, "steps_per_trajectory": 100, "flip_fraction": 0.3, "flip_probability": 0.3},
        },
        mesh,
    )
    force = scene.createForce()
    simulation = scene.createSimulation(force)
    mh.adaptStepSize(simulation, max(100, steps // 8))
    simulation.step(steps // 8)
    frames = []
    for _ in range(steps):
        simulation.step(1)
        positions = simulation.context.getState(positions=True).getPositions(asNumpy=True)
        frames.append(positions.value_in_unit(unit.nanometer))
    return frames, mh.Mesh(frames[-1], force.getTrianglesInContext(simulation.context), mesh.box)


# %% [markdown]
# ## Undulations
#
# Trajectories move all vertices at once, and flips between them let the membrane flow. Vertices wander far along the
# sheet, over the sides of the box and beyond. That does not matter: neighbors are always the nearest images. A picture
# shows each triangle once, where the box has it.

# %%
frames, last = sample(0.0)
print("area", round(last.area, 1), "nm^2 on", side * side, "nm^2")
last.plot(elevation=35).save("sheet.png")

# %% [markdown]
# ![A sheet, red where it bulges up and blue where it bulges down](sheet.png)
#
# ## The spectrum of heights
#
# The height is a sum of the waves that fit into the box, and theory says how large each is on average:
# ⟨|h|²⟩ = kT / A(κq⁴+σq²), q being the wave number and A the area of the box. `heightSpectrum` measures them. `fit`
# finds κ and the tension σ from the waves up to 0.9 per nm. It is told the edge length, since a mesh is softer for
# waves of only a few edges.
#
# The second sheet is pulled by 1 kT/nm², which is 4 mN/m.

# %%
tensions = (0.0, 1.0)
spectra = [mh.heightSpectrum(frames, mesh.box, 1.3), mh.heightSpectrum(sample(tensions[1])[0], mesh.box, 1.3)]
fits = [spectrum.fit(0.9, mesh.edgeLengths.mean()) for spectrum in spectra]
for tension, fit in zip(tensions, fits):
    print(
        f"tension {tension:g}: kappa = {fit.bendingModulus:.1f} +- {fit.bendingModulusError:.1f} kT, "
        f"sigma = {fit.tension:.2f} +- {fit.tensionError:.2f} kT/nm^2"
    )

# %%
axes = plt.figure(figsize=(6, 4), layout="constrained").subplots()
smooth = np.linspace(spectra[0].waveNumbers[0], 1.3, 100)
for tension, spectrum, color in zip(tensions, spectra, ("C0", "C1")):
    theory = spectrum.theory(smooth, bendingModulus, tension, mesh.edgeLengths.mean())
    axes.errorbar(spectrum.waveNumbers, spectrum.powers, spectrum.errors, fmt="o", color=color)
    axes.plot(smooth, theory, color=color, label=f"κ = {bendingModulus} kT, σ = {tension:g} kT/nm²")
axes.set(xlabel="wave number q (1/nm)", ylabel="mean |h|² (nm²)", xscale="log", yscale="log")
axes.set_xticks([0.4, 0.5, 0.6, 0.8, 1.0, 1.2], labels=["0.4", "0.5", "0.6", "0.8", "1", "1.2"])
axes.xaxis.set_minor_formatter("")
axes.legend(title="lines: theory")
axes.figure.savefig("heights.png", dpi=110)

# %% [markdown]
# ![Measured heights on the lines of theory; under tension the longest waves are lower](heights.png)
#
# This run found κ = 19.3 ± 0.5 kT and σ = 0.30 ± 0.15 kT/nm² for the first sheet. For the second it found 18.5 ± 0.6
# and 1.51 ± 0.17: the tension is 1.2 ± 0.2 higher where 1 was added. The small tension of the first sheet is that which
# a box of fixed size puts on its edges. As in a vesicle, undulations too short for the fit soften the membrane.
#
# ## Where to go
#
# - [Fluctuations](fluctuations.py) does the same for a vesicle.
# - [Long waves](../explanation/long-waves.md) move slowly in large sheets: `multilevel_weight` helps.
# - [Analysis](../how-to/analysis.md) has more on spectra and their errors.
