# %% [markdown]
# # A budding vesicle
#
# A membrane of two lipids may have a domain of one in a sea of the other. The boundary between them costs energy, so
# much a length: the line tension. A short boundary is cheaper. So the domain bulges out, until it hangs on a neck.
# This tutorial raises the line tension, and watches a bud form. It takes half a minute.

# %%
import os

import numpy as np

import openmmhelfrich as mh

isSmall = os.environ.get("HELFRICH_TUTORIAL_SIZE") == "small"

# %% [markdown]
# ## A domain on a sphere
#
# A fifth of the vertices, those furthest up, are of the species `lo`. All others are `ld`. Both have the same bending
# modulus here. The area is held. The volume is free, as it is on long times, when water passes the membrane.
#
# A stage of the kind `continue` raises the line tension window by window. Flips let the membrane flow, and species stay
# on their vertices, so that the domain stays whole.

# %%
kappa = 20
domain = np.sqrt(4 * 0.2)  # its radius if it were flat, for a sphere of radius 1
greatest = 9 * kappa / domain
result = mh.run(
    {
        "mesh": {"icosphere": 2 if isSmall else 3},
        "membrane": {"bending_modulus": kappa, "volume_modulus": 0},
        "species": [{"name": "lo", "fraction": 0.2, "region": "cap"}, {"name": "ld"}],
        "stages": [
            {
                "kind": "continue",
                "line_tension": greatest,
                "windows": 3 if isSmall else 12,
                "equilibration": 2 if isSmall else 100,
                "steps": 4 if isSmall else 100,
            }
        ],
        "sampling": {"seed": 1},
        "output": {
            "prefix": "results/budding",
            "trajectory_interval": 4 if isSmall else 100,
            "observables_interval": 2 if isSmall else 10,
            "overwrite": True,
        },
    }
)
print(result)

# %% [markdown]
# ## The boundary
#
# The energy of the line over the line tension is the length of the boundary. On a flat membrane theory puts the bud and
# the flat domain at the same energy where λL/κ is 4, with L the radius of the flat domain. A domain that bulges as a
# cap leaves the flat shape at 8 (Lipowsky, J. Phys. II France 2, 1825, 1992), one of any shape
# [at 5.8](../results/materials.md). On a vesicle the domain is curved from the start.

# %%
table = result.table
rows = table["equilibrated"] == 1
windows = np.unique(table["window"][rows])
for window in windows[1:]:
    tension = greatest * window / windows[-1]
    line = table["E_line"][rows & (table["window"] == window)].mean()
    print(f"λL/κ = {tension * domain / kappa:4.1f}: the boundary is {line / tension:.2f} long")

# %% [markdown]
# ## The bud
#
# The picture shows the last frame, colored by species.
#
# ![A vesicle with a bud](budding.png)

# %%
frames = mh.readMeshTrajectory("results/budding.vtkhdf")
frames[-1].mesh.plot(azimuth=-60, elevation=5).save("budding.png")
bud = mh.findDomains(frames[-1].mesh, 0)
print(f"{bud.areas[0]:.2f} nm² hang on a boundary of {bud.boundaryLengths[0]:.2f} nm")

# %% [markdown]
# The domain is a bud now: almost a sphere of its own, on a neck. From here, [species](../how-to/species.md) of other
# moduli, and a volume that is held, change when it happens.
