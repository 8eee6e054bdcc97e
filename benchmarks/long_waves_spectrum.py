"""The spectrum of a fluid vesicle that is sampled with momenta on coarser meshes, beside theory.

    python benchmarks/long_waves_spectrum.py SUBDIVISIONS STEP STEPS SECONDS [--refreshment 0.2]

The scene is the sphere of long_waves.py.  One line of JSON: the mean squares of the modes of degree 2 to 10, their
standard errors, the bending modulus and the tension that fit them with the stiffness of a mesh, and each mean square
over that of theory.  Theory has the modulus of the scene, 30 kT, less what shorter undulations take of it, and the
tension that fits then.  The first fifth of the run is left out.
"""

import argparse
import json
import math
import time

import numpy as np
from long_waves import begin
from scipy.optimize import minimize_scalar

import openmmhelfrich as mh
from openmmhelfrich.analysis import fluctuationSpectrum, meshStiffness

KAPPA, MAX_DEGREE = 30, 10


def sample(arguments):
    """Return positions, the mean edge length, and the computations that there were from one to the next."""
    force, context, _, trajectories, flips = begin(arguments)
    frames, edgeLengths, before, computations = [], [], time.process_time(), 0
    while time.process_time() - before < arguments.seconds:
        for _ in range(arguments.every):
            trajectories.step(1)
            computations += trajectories.getLastNumSteps()
            flips.step(1)
        frames.append(context.getState(positions=True).getPositions(asNumpy=True)._value)
        edgeLengths.append(mh.Mesh(frames[-1], force.getTrianglesInContext(context)).edgeLengths.mean())
    first = len(frames) // 5
    return frames[first:], float(np.mean(edgeLengths[first:])), computations / len(frames)


def theory(spectrum, tension, numVertices, edgeLength):
    """Return the mean squares of modes on a mesh (Milner and Safran, Phys. Rev. A 36, 4371, 1987), whose modulus
    undulations renormalize (Peliti and Leibler, Phys. Rev. Lett. 54, 1690, 1985), as many as there are vertices.
    """
    l = spectrum.degrees
    kappa = KAPPA - 3 / (4 * math.pi) * np.log((math.sqrt(numVertices) - 1) / l)
    stiffness = (l - 1) * (l + 2) * (l * (l + 1) + tension) * meshStiffness(l, edgeLength / spectrum.radius)
    return 1 / (kappa * stiffness)


def compare(frames, edgeLength):
    spectrum = fluctuationSpectrum(frames, MAX_DEGREE)
    fit = spectrum.fit(2, MAX_DEGREE, edgeLength)

    def expected(tension):
        return theory(spectrum, tension, len(frames[0]), edgeLength)

    def misfit(tension):
        return float(np.sum(((spectrum.powers - expected(tension)) / spectrum.errors) ** 2))

    tension = float(minimize_scalar(misfit, bounds=(-5, 100), method="bounded").x)
    return {
        "degrees": spectrum.degrees.tolist(),
        "powers": spectrum.powers.tolist(),
        "errors": spectrum.errors.tolist(),
        "bendingModulus": [fit.bendingModulus, fit.bendingModulusError],
        "tension": [fit.tension, fit.tensionError],
        "tensionOfTheory": tension,
        "overTheory": (spectrum.powers / expected(tension)).tolist(),
        "overTheoryErrors": (spectrum.errors / expected(tension)).tolist(),
        "chiSquared": misfit(tension),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("subdivisions", type=int)
    parser.add_argument("step", type=float)
    parser.add_argument("steps", type=int)
    parser.add_argument("seconds", type=float)
    parser.add_argument("--weight", type=float, default=2)
    parser.add_argument("--refreshment", type=float, default=0.2, help="the part of momenta that is drawn anew")
    parser.add_argument("--volume", type=float, default=0.99)
    parser.add_argument("--penalty", type=float, default=1e6, help="the moduli of area and volume, in kT")
    parser.add_argument("--every", type=int, default=10, help="trajectories from one measurement to the next")
    parser.add_argument("--seed", type=int, default=1)
    parser.set_defaults(start=None, flips=1, jitter=0.2, tether=[100, 0.85, 1.35], precision="mixed", threads=1)
    arguments = parser.parse_args()
    frames, edgeLength, computations = sample(arguments)
    found = {"frames": len(frames), "edgeLength": edgeLength, "computations": computations}
    print(json.dumps({**vars(arguments), **found, **compare(frames, edgeLength)}))
