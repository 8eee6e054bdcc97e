"""A vesicle that is held at one pole and pulled at the other by a bead, in a whole study: forces, beads and fixed
vertices take part in its stages, its checkpoint and its pictures.

Writes the files of a run, beads.*, and beads_pulled.png.
"""

import sys
from typing import Any

import numpy as np
import openmm as mm

import openmmhelfrich as mh
from openmmhelfrich.pictures.look import Look
from openmmhelfrich.pictures.rendering import render

subdivisions, steps = map(int, sys.argv[1:]) if len(sys.argv) > 1 else (3, 300)


def pull(system: mm.System, scene: mh.Scene) -> Any:
    """Tie a bead to the top of the vesicle, by a spring, and pull it upwards with 40 kT/nm."""
    vertices = scene.mesh.vertices
    top = int(vertices[:, 2].argmax())
    bead = system.addParticle(10.0)
    spring, weight = mm.HarmonicBondForce(), mm.CustomExternalForce("-f*z")
    spring.addBond(top, bead, 0.1, 100 * scene.kT)
    weight.addGlobalParameter("f", 40 * scene.kT)
    weight.addParticle(bead)
    system.addForce(spring)
    system.addForce(weight)
    return vertices[[top]] + [0, 0, 0.1]


config = {
    "mesh": {"icosphere": subdivisions},
    "membrane": {"reduced_volume": 0.85},
    "system": {"fixed_box": [[-0.3, -0.3, -1.1], [0.3, 0.3, -0.8]]},
    "sampling": {"seed": 1},
    "stages": [{"kind": "minimize", "fluid": True}, {"kind": "sample", "steps": steps}],
    "output": {"prefix": "beads", "trajectory_interval": max(1, steps // 10), "overwrite": True},
}
result = mh.run(config, setup=pull)
print(result)

frames = mh.readMeshTrajectory("beads.vtkhdf")
lengths = [float(np.ptp(frame.mesh.vertices[:, 2])) for frame in (frames[0], frames[-1])]
print(f"length of the vesicle: {lengths[0]:.2f} nm after minimization, {lengths[1]:.2f} nm at the end")
render(frames[-1:], "beads_pulled.png", look=Look(elevation=10, scaleBar=True))
