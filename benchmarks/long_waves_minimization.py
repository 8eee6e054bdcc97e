"""How many iterations a minimization takes, with a multilevel weight and without.

    python benchmarks/long_waves_minimization.py VERTICES WEIGHT [--noise 0.08] [--stiffness 1e6] [--fluid]

One line: the iterations, the bending energy over that of a sphere, the iterations after which the energy was within a
millionth of the last, and seconds of processor time.  The mesh is a prolate spheroid of a reduced volume, whose
vertices are moved at random by NOISE edges; the moduli of area and volume are STIFFNESS bending moduli, and their
targets those of the smooth spheroid.
"""

import argparse
import time

import numpy as np
from minimization_scenes import roughened, simulationOf, withTether

import openmmhelfrich as mh


def createSimulation(arguments):
    smooth = mh.spheroid(arguments.vertices, mh.spheroidAspectRatio(arguments.volume, "prolate"))
    mesh = roughened(smooth, arguments.noise)
    force = withTether(mesh, float(smooth.edgeLengths.mean()))
    force.setAreaModulus(arguments.stiffness)
    force.setTargetArea(smooth.area)
    force.setVolumeModulus(arguments.stiffness)
    force.setTargetVolume(smooth.volume)
    return force, simulationOf(mesh, force)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("vertices", type=int)
    parser.add_argument("weight", type=float)
    parser.add_argument("--volume", type=float, default=0.9)
    parser.add_argument("--noise", type=float, default=0.08)
    parser.add_argument("--stiffness", type=float, default=1e6)
    parser.add_argument("--fluid", action="store_true")
    arguments = parser.parse_args()
    force, simulation = createSimulation(arguments)
    begin = time.process_time()
    search = mh.minimizeFluid if arguments.fluid else mh.minimize
    result = search(simulation, force, maxIterations=10000, multilevelWeight=arguments.weight)
    far = np.flatnonzero(np.abs(result.history - result.history[-1]) > 1e-6 * result.history[-1])
    near = far[-1] + 1 if len(far) else 0
    ratio = result.energies["bending"]._value / (8 * np.pi)
    print(vars(arguments), f"{result.iterations} iterations, {ratio:.5f}, within 1e-6 after {near}, "
          f"{time.process_time() - begin:.2f} s: {result.reason}", flush=True)  # fmt: skip
