# %% [markdown]
# # Domains on a vesicle
#
# Two lipids that do not like each other separate. This tutorial mixes them at random on a vesicle, lets them change
# places, and watches domains grow. It takes half a minute.

# %%
import os

import numpy as np

import openmmhelfrich as mh

isSmall = os.environ.get("HELFRICH_TUTORIAL_SIZE") == "small"

# %% [markdown]
# ## A mixture
#
# A third of the vertices, at random, are of the species `lo`, which is stiffer. The line tension is the energy of their
# boundary by its length. Here an edge's length of it costs about two kT.
#
# A part of the steps are sweeps of exchanges: the species of an edge's two ends change places, if the Metropolis test
# lets them. Trajectories move the vertices, and flips let them flow, as ever.

# %%
result = mh.run(
    {
        "mesh": {"icosphere": 2 if isSmall else 3},
        "membrane": {"bending_modulus": 15, "line_tension": 14, "reduced_volume": 0.97},
        "species": [
            {"name": "lo", "bending_modulus": 30, "fraction": 0.33},
            {"name": "ld"},
        ],
        "sampling": {
            "steps": 30 if isSmall else 4000,
            "exchange_probability": 0.4,
            "exchange_fraction": 1.0,
            "flip_probability": 0.3,
            "seed": 3,
        },
        "output": {"prefix": "results/domains", "trajectory_interval": 10 if isSmall else 400, "overwrite": True},
    }
)
print(result)

# %% [markdown]
# ## The domains
#
# Each frame knows the species of its vertices. `mh.findDomains` finds what hangs together.

# %%
frames = mh.readMeshTrajectory("results/domains.vtkhdf")
for i in range(len(frames)):
    mesh = frames[i].mesh
    domains = mh.findDomains(mesh, 0)
    share = domains.areas[0] / domains.areas.sum()
    print(f"step {frames[i].step:4d}: {len(domains.areas):3d} domains, the largest has {share:.0%}, "
          f"boundaries of {mh.boundaryLength(mesh):.1f} nm")  # fmt: skip

# %% [markdown]
# ## Composition by wavelength
#
# The structure factor says on which scale the composition varies: for each degree l of the spherical harmonics, how
# much of it there is. Domains that grow move it to small l.

# %%
for frame in (frames[0], frames[-1]):
    print(np.round(mh.compositionSpectrum(frame.mesh, 0, 6)[1:], 3))

# %% [markdown]
# ## The picture
#
# ![Domains of two species on a vesicle](domains.png)

# %%
frames[-1].mesh.plot(azimuth=-60, elevation=20).save("domains.png")

# %% [markdown]
# A smaller line tension leaves the two mixed. [Species](../how-to/species.md) may also attract each other by the energy
# of the edges between them, and prefer curvatures of their own.
