"""Minimum shapes of vesicles, prolate and oblate, compared with those of axisymmetric vesicles.  Prints a table and writes minima.png.

Arguments: the number of vertices (642), and reduced volumes (0.9, 0.8 and 0.7).
"""
import math
import sys
import time

import numpy as np
import openmm as mm
import openmmhelfrich as mh
from matplotlib.figure import Figure
from openmm import app, unit

# Bending energy over 8 pi kappa of axisymmetric shapes, from tests/data/axisymmetric_minima.csv.
REFERENCE = {("prolate", 0.9): 1.18964, ("oblate", 0.9): 1.21786, ("prolate", 0.8): 1.38744, ("oblate", 0.8): 1.45254,
             ("prolate", 0.7): 1.64327, ("oblate", 0.7): 1.69911}

numVertices = int(sys.argv[1]) if len(sys.argv) > 1 else 642
reducedVolumes = [float(v) for v in sys.argv[2:]] or [0.9, 0.8, 0.7]
kappa = 50.0  # kJ/mol, 20 kT at 300 K
sphere = 8*math.pi*kappa


def minimize(kind, reducedVolume):
    """Return the shape of least energy near a spheroid, and what the minimisation says of it."""
    mesh = mh.spheroid(numVertices, mh.spheroidAspectRatio(reducedVolume, kind))
    edge = mesh.edgeLengths.mean()
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(kappa)
    force.setAreaModulus(1e6*kappa)
    force.setTargetArea(mesh.area)
    force.setVolumeModulus(1e6*kappa)
    force.setTargetVolume(reducedVolume*mesh.area**1.5/(6*math.sqrt(math.pi)))
    force.setTether(kappa, 0.8*edge, 1.25*edge, 2)
    system = mesh.createSystem()
    system.addForce(force)
    integrator = mh.HybridMonteCarloIntegrator(300, 1e-4)
    integrator.setRandomNumberSeed(1)
    simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatformByName("CPU"))
    simulation.context.setPositions(mesh.vertices)
    result = mh.minimizeFluid(simulation, force)
    positions = simulation.context.getState(positions=True).getPositions(asNumpy=True)
    return mh.Mesh(positions, force.getTrianglesInContext(simulation.context)), result


figure = Figure(figsize=(8, 4), layout="constrained")
print("shape,reducedVolume,energy,reference,error,tether,iterations,flips,seconds,end")
for row, kind in enumerate(("prolate", "oblate")):
    for column, v in enumerate(reducedVolumes):
        start = time.perf_counter()
        mesh, result = minimize(kind, v)
        seconds = time.perf_counter()-start
        energy, tether = (result.energies[name]/unit.kilojoules_per_mole/sphere for name in ("bending", "tether"))
        reference = REFERENCE.get((kind, v), math.nan)
        print(f"{kind},{v},{energy:.5f},{reference:.5f},{energy/reference-1:+.2%},{tether:.1e},{result.iterations},{result.flips},{seconds:.1f},{result.reason}")
        axes = figure.add_subplot(2, len(reducedVolumes), row*len(reducedVolumes)+column+1)
        x = mesh.vertices[mesh.edges][..., [2, 0]]  # seen from the side
        for edge in x[np.mean(mesh.vertices[mesh.edges][..., 1], axis=1) > 0]:
            axes.plot(*edge.T, color="C0", lw=0.3)
        axes.set(aspect="equal", xlim=(-2.2, 2.2), ylim=(-1.5, 1.5), title=f"{kind}, v = {v}: E/8πκ = {energy:.3f}")
        axes.title.set_fontsize("small")
        axes.set_axis_off()
figure.savefig("minima.png", dpi=120)
