# %% [markdown]
# # Minimize and anneal
#
# But for thermal undulations, a vesicle has the shape of least energy. A minimization walks downhill from where it
# begins, and may end in the wrong valley. An annealing begins warm and cools, and so leaves valleys that are not
# deep. This tutorial does both. It takes some ten seconds.

# %%
import os

import matplotlib.pyplot as plt
import numpy as np

import openmmhelfrich as mh

isSmall = os.environ.get("HELFRICH_TUTORIAL_SIZE") == "small"
bendingModulus, volume, numVertices = 20, 0.8, 92 if isSmall else 642
exact = {branch: mh.axisymmetricMinimum(branch, volume).energy for branch in ("prolate", "oblate")}
print({branch: round(energy, 3) for branch, energy in exact.items()})

# %% [markdown]
# These are the energies of the two smooth shapes of this volume, in units of the energy of a sphere, 8πκ. They were
# computed without triangles, and tell what to expect: 1.387 for a prolate, 1.453 for an oblate.
#
# ## Minimize
#
# Two starts: an oblate, and a sphere. `fluid` lets edges flip too, where that lowers the energy.

# %%
mh.spheroid(numVertices, mh.spheroidAspectRatio(volume, "oblate")).write("oblate.ply")
mh.Mesh.icosphere(2 if isSmall else 3).write("sphere.ply")
minimize = {"kind": "minimize", "fluid": True, "max_iterations": 200 if isSmall else 20000}
anneal = {"kind": "anneal", "steps": 20 if isSmall else 600, "end_temperature": 3}


def study(name, start, *stages):
    """Do some stages from a start, and return the final mesh and its energy."""
    config = {
        "mesh": {"file": start},
        "membrane": {"bending_modulus": bendingModulus, "reduced_volume": volume},
        "sampling": {"seed": 1},
        "stages": list(stages),
        "output": {"prefix": f"results/{name}", "overwrite": True},
    }
    result = mh.run(config)
    mesh = mh.Mesh.read(f"results/{name}.ply")
    energy = result.table["E_bending"][-1] / (8 * np.pi * bendingModulus)
    shape = mh.describeShape(mesh)
    print(f"{name}: {shape.shapeClass}, v = {shape.reducedVolume:.3f}, E/8πκ = {energy:.3f}, {result.verdict.level}")
    return mesh


shapes = {
    "oblate, minimized": study("oblate_minimized", "oblate.ply", minimize),
    "sphere, minimized": study("sphere_minimized", "sphere.ply", minimize),
}

# %% [markdown]
# The oblate stays an oblate, at a minimum that is not the lowest. The sphere becomes a prolate, whose energy is lower.
# The verdict is *good* for both: each is a minimum. Where the search began decides which.
#
# ## Anneal
#
# Now the oblate again, but the membrane first moves at 300 K, and then cools to 3 K. A minimization at the end takes
# the last undulations away.

# %%
shapes["oblate, annealed"] = study("oblate_annealed", "oblate.ply", anneal, minimize)

# %%
figure = plt.figure(figsize=(9, 3.2), layout="constrained")
for place, (name, mesh) in enumerate(shapes.items(), start=1):
    mesh.plot(elevation=10, azimuth=-45, size=(600, 600), range=(-2, 2)).save(f"results/{place}.png")
    axes = figure.add_subplot(1, 3, place, title=name)
    axes.imshow(plt.imread(f"results/{place}.png"))
    axes.set_axis_off()
figure.savefig("minimize_and_anneal.png", dpi=110, bbox_inches="tight")

# %% [markdown]
# ![An oblate, a prolate from a sphere, and the prolate that annealing found](minimize_and_anneal.png)
#
# Annealing found the prolate, whose energy is within a percent of the smooth one's. The mesh gives a little less than
# the smooth surface, as coarse meshes do.
#
# Annealing is no guarantee: of the seeds 1 to 4, 3 left the oblate an oblate. Begin from several shapes, and compare
# energies.
#
# ## Where to go
#
# - [Minimum shapes](../how-to/minimization.md) says where to begin, and how good the minima are.
# - [Studies](../how-to/studies.md) has all stages: minimize, sample, anneal, continue.
