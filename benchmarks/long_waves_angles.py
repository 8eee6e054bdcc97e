"""The angle by which the modes of a vesicle rotate in one trajectory, with coarser meshes and without.

    python benchmarks/long_waves_angles.py SUBDIVISIONS WEIGHT STEP STEPS [--degree 12] [--trajectories 1600] [--seed 3]

The scene is that of long_waves.py, with all momenta drawn anew and no jitter.  On a mesh without flips a mode u is an
oscillator about a mean of its own, whose momentum is drawn at the start: cos(angle) = 1 - <du^2> / 2 <u^2>, with the
change du in a trajectory.  Means are over the modes of a degree and four meshes, which flips lead to.  STEP is in ps.
"""

import numpy as np
from long_waves import begin, createParser, modesOf

MESHES, SWEEPS, SETTLE = 4, 20, 200
PART = 8  # of the trajectories on a mesh one in so many is left out, in which modes come to their means


def measure(arguments):
    """Return the angles of degrees from 2 on, in degrees, and the part of trajectories that were accepted."""
    force, context, _, trajectories, flips = begin(arguments)
    degrees = np.repeat(np.arange(2, arguments.degree + 1), 2 * np.arange(2, arguments.degree + 1) + 1)

    def modes():
        x = context.getState(positions=True).getPositions(asNumpy=True)._value
        return modesOf(x, force.getTrianglesInContext(context), arguments.degree)

    def relax(count):
        for _ in range(count):
            trajectories.step(1)
            flips.step(1)

    def sample(count):
        for _ in range(count):
            trajectories.step(1)
            yield modes()

    relax(SETTLE)
    changes, squares = np.zeros(len(degrees)), np.zeros(len(degrees))
    before = trajectories.getNumAccepted(), trajectories.getNumAttempted()
    for _ in range(MESHES):
        relax(SWEEPS)
        rows = np.array(list(sample(arguments.trajectories // MESHES)))
        rows = rows[len(rows) // PART :]
        changes += np.mean(np.diff(rows, axis=0) ** 2, axis=0)
        squares += rows.var(axis=0)
    accepted, attempted = trajectories.getNumAccepted() - before[0], trajectories.getNumAttempted() - before[1]
    cosines = 1 - np.bincount(degrees, changes)[2:] / (2 * np.bincount(degrees, squares)[2:])
    return np.degrees(np.arccos(np.clip(cosines, -1, 1))), accepted / attempted


if __name__ == "__main__":
    parser = createParser(__doc__)
    parser.add_argument("--degree", type=int, default=12, help="the greatest")
    parser.add_argument("--trajectories", type=int, default=1600)
    parser.set_defaults(flips=1.0, jitter=0.0, seed=3)
    angles, accepted = measure(parser.parse_args())
    print(f"accepted {accepted:.0%}: " + ", ".join(f"l = {l}: {a:.1f}" for l, a in enumerate(angles, 2)))
