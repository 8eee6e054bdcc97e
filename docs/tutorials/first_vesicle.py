# %% [markdown]
# # A first vesicle
#
# A vesicle is a closed membrane: a bag of water in water. Take some of the water out, and it is no sphere any more.
# This tutorial deflates one, and looks at what it becomes. It takes a quarter of a minute.
#
# You need `pip install openmm-helfrich` and nothing else.

# %%
import os

import openmmhelfrich as mh

isSmall = os.environ.get("HELFRICH_TUTORIAL_SIZE") == "small"

# %% [markdown]
# ## The run
#
# A run is described by a dict, or by a file with the same sections. This one says: a sphere of 642 vertices, a
# bending modulus of 20 kT as lipid bilayers have it, and a volume of 0.7 of that of a sphere with the same area.
# Everything else has a default.

# %%
result = mh.run(
    {
        "mesh": {"icosphere": 2 if isSmall else 3},
        "membrane": {"bending_modulus": 20, "reduced_volume": 0.9 if isSmall else 0.7},
        "sampling": {"steps": 30 if isSmall else 1000, "seed": 1},
        "output": {"prefix": "results/first_vesicle", "overwrite": True},
    }
)

# %% [markdown]
# `result` shows itself as a table. Two lines of it matter most. The *verdict* says whether the run can be trusted.
# The *reduced volume* is what was asked for: 1 is a sphere, less is deflated.

# %%
print(result)

# %% [markdown]
# ## The shape
#
# The final mesh is a file, as are the trajectory, the table of energies, and the settings with all defaults filled
# in.

# %%
mesh = mh.Mesh.read("results/first_vesicle.ply")
shape = mh.describeShape(mesh)
print(shape.shapeClass, f"reduced volume {shape.reducedVolume:.3f}")
mesh.plot(elevation=15, scaleBar=True).save("first_vesicle.png")

# %% [markdown]
# ![The vesicle, colored by its mean curvature](first_vesicle.png)
#
# The colors are mean curvatures. The surface is rough, for the membrane has a temperature: every vertex is kicked
# about by some kT/2, and the rough surface that you see is one of the many shapes that the vesicle takes in turn.
#
# ## The same in OpenMM's words
#
# Nothing of this is beyond an ordinary OpenMM script. A `Scene` makes the force, the System and the Simulation of the
# same settings. From there on everything is OpenMM's.

# %%
scene = mh.Scene.of({"membrane": {"reduced_volume": 0.95}, "sampling": {"seed": 1}}, mh.Mesh.icosphere(2))
force = scene.createForce()
simulation = scene.createSimulation(force)
simulation.step(20)
print(force.getEnergyTermsInContext(simulation.context)["bending"])
print(f"{simulation.integrator.getAcceptanceRate():.0%} of the trajectories were accepted")

# %% [markdown]
# ## Where to go
#
# - `openmm-helfrich report results/first_vesicle` makes a page of the run, with the shape in 3D; `pip install
#   'openmm-helfrich[looking]'` brings what that takes.
# - [Minimize and anneal](minimize_and_anneal.py) finds the shape without the roughness.
# - [Studies](../how-to/studies.md) has what else a run can do, [Python](../how-to/python.md) what a script can do.
