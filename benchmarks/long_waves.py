"""What an independent sample of the lowest modes of a fluid vesicle costs, with momenta on coarser meshes and without.

    python benchmarks/long_waves.py SUBDIVISIONS WEIGHT STEP STEPS SECONDS [--volume 0.95] [--flips 0.3] [--seed 1]

One line of JSON: the integrated autocorrelation times of the modes of degree 2, 3 and 4, of the sum of squares of each
degree ("ofShape": it stays when the vesicle turns), of the elongation and of the bending energy, in computations of
forces and in processor time of one thread.  The scene is the sphere of docs/results/sampling.md: bending modulus
30 kT, area and volume 1e6 kT unless said otherwise, edges of length 1, a tether of modulus 100 kT between 0.85 and
1.35.  Each trajectory is followed by a sweep.  STEP is in ps.  The first fifth of the run is left out.
"""

import argparse
import json
import math
import time

import numpy as np
import openmm as mm

import openmmhelfrich as mh
from openmmhelfrich.analysis.fluctuations import _solidAngles, realHarmonics

KT = 300 * 8.31446261815324e-3
DEGREES = (2, 3, 4)
PARTS = 6  # of a run, from which errors are
AVERAGES = ("bending", "areaOverTarget", "volumeOverTarget")  # of a row, after the modes


def ofUnitEdges(mesh):
    return mh.Mesh(mesh.vertices / mesh.edgeLengths.mean(), mesh.triangles)


def createScene(arguments, mesh):
    """Return the force, the integrator and the context of a sphere of edges of length 1."""
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(30 * KT)
    force.setAreaModulus(arguments.penalty * KT)
    force.setTargetArea(mesh.area)
    force.setVolumeModulus(arguments.penalty * KT)
    force.setTargetVolume(arguments.volume * mesh.volume)
    modulus, shortest, longest = arguments.tether
    force.setTether(modulus * KT, shortest, longest, 2)
    integrator = mh.HybridMonteCarloIntegrator(300, arguments.step, arguments.steps, arguments.flips, 0)
    integrator.setMultilevelWeight(arguments.weight)
    integrator.setTrajectoryJitter(arguments.jitter)
    integrator.setMomentumRefreshment(arguments.refreshment)
    integrator.setForcePrecision(arguments.precision)
    integrator.setRandomNumberSeed(arguments.seed)
    system = mesh.createSystem(mass=1.0)
    system.addForce(force)
    context = mm.Context(system, integrator, mm.Platform.getPlatform("CPU"), {"Threads": str(arguments.threads)})
    context.setPositions(mesh.vertices)
    return force, integrator, context


def setShape(force, context, mesh):
    """Begin with the shape of a mesh, scaled to the target of the area."""
    context.setPositions(mesh.vertices * (force.getTargetArea()._value / mesh.area) ** 0.5)
    force.setTrianglesInContext(context, mesh.triangles)


def deflate(force, context, volume, moves):
    """Bring a volume to its target: a sudden change would crumple the vesicle."""
    target = force.getTargetVolume()._value
    while volume > target * 1.0001:
        volume = max(0.998 * volume, target)
        context.setParameter(force.getTargetVolumeParameter(), volume)
        for _ in range(3):
            for move in moves:
                move.step(1)


def autocorrelationTime(a):
    """Return the integrated autocorrelation time of vectors whose mean is zero, in samples, with a window of five times
    itself.

    The mean of modes is zero, since all orientations are alike.  That of a run is not: without it the time would be too
    short, the more so the fewer independent samples there are.
    """
    n, total = len(a), 1.0
    c = np.fft.irfft(np.abs(np.fft.rfft(a, 2 * n, axis=0)) ** 2, axis=0)[:n].sum(axis=1)
    for k in range(1, n):
        total += 2 * c[k] / c[0]
        if k > 5 * total:
            break
    return total


def squaredChanges(series, evaluations):
    """Return the mean squared changes after some numbers of computations, in each of PARTS parts of the run.

    Parameters
    ----------
    series : array
        of shape (samples,) or (samples, modes)
    evaluations : float
        the computations that a sample takes
    """
    most = min(len(series) // 3, round(51200 / evaluations))
    steps = np.unique(np.geomspace(1, most, 1 + round(3 * math.log2(most))).round().astype(int)) if most > 0 else []
    changes = {round(k * evaluations): (series[k:] - series[:-k]) ** 2 for k in steps}
    return {lag: [float(f"{part.mean():.5g}") for part in np.array_split(c, PARTS)] for lag, c in changes.items()}


def decayTimes(runs, evaluations):
    """Return what an independent sample takes, in computations, by the correlation that is left after some numbers of
    them, and the standard error of its logarithm.

    If the correlation decays exponentially, it is twice the time constant.  That is known better than the integrated
    time, which adds up the noise of long lags.  Errors are from a bootstrap over modes and parts of each run.

    Parameters
    ----------
    runs : list of array
        the modes of each run, of shape (samples, modes), whose mean is zero
    evaluations : float
        the computations that a sample takes
    """
    parts = [part[:, [mode]] for run in runs for part in np.array_split(run, PARTS) for mode in range(run.shape[1])]
    random, found = np.random.default_rng(1), {}
    for lag in (800 * 2**n for n in range(8)):
        k = round(lag / evaluations)
        if not 0 < k < min(map(len, parts)) / 2:
            continue
        sums = np.array([((p[k:] * p[:-k]).sum(), len(p) - k, (p**2).sum(), len(p)) for p in parts])
        drawn = [sums[random.integers(0, len(parts), len(parts))] for _ in range(300)]
        kept = [_correlation(each) for each in [sums, *drawn]]
        if min(kept) > 0 and max(kept) < 1:
            times = -2 * lag / np.log(kept)
            found[lag] = [float(times[0]), float(np.std(np.log(times[1:])))]
    return found


def _correlation(sums):
    products, pairs, squares, count = sums.sum(axis=0)
    return products / pairs / (squares / count)


def modesOf(x, triangles, greatest=DEGREES[-1]):
    """Return the coefficients of the radius, in units of its mean, in real spherical harmonics of degrees from 2 on.

    The direction of each vertex counts with its solid angle, by the live triangles: the vesicle is nearly a sphere.
    """
    x = x - x.mean(axis=0)
    r = np.linalg.norm(x, axis=1)
    directions = x / r[:, np.newaxis]
    weights = _solidAngles(directions, triangles)
    return (weights * r) @ realHarmonics(directions, greatest)[:, 4:] / np.average(r, weights=weights)


def elongations(modes):
    """Return the greatest eigenvalue of the tensor that the modes of degree 2 are, for each row of modes.

    It does not see orientation, and tells prolates from oblates: sqrt(2/3) and sqrt(1/6) times the norm of the modes.
    """
    xy, yz, zz, xz, xx = modes[..., :5].T
    third = zz / math.sqrt(3)
    tensors = np.array([[xx - third, xy, xz], [xy, -xx - third, yz], [xz, yz, 2 * third]]) / math.sqrt(2)
    return np.linalg.eigvalsh(np.moveaxis(tensors, (0, 1), (-2, -1)))[..., -1]


def begin(arguments):
    """Return the force and the context of a vesicle that is deflated, or has the shape of a file, its sphere, and its
    trajectories and flips.
    """
    sphere = ofUnitEdges(mh.Mesh.icosphere(arguments.subdivisions))
    force, integrator, context = createScene(arguments, sphere)
    trajectories, flips = integrator.getMove(0), integrator.getMove(1)
    if arguments.start:
        setShape(force, context, mh.Mesh.read(arguments.start))
    else:
        deflate(force, context, sphere.volume, (trajectories, flips))
    return force, context, sphere, trajectories, flips


def measure(arguments):
    force, context, sphere, trajectories, flips = begin(arguments)
    for _ in range(arguments.settle):
        trajectories.step(1)
        flips.step(1)
    rows, changes, evaluations, used = [], [], 0, 0.0
    accepted, attempted = trajectories.getNumAccepted(), trajectories.getNumAttempted()
    while used < arguments.seconds:
        before = time.process_time()
        trajectories.step(1)
        evaluations += trajectories.getLastNumSteps()
        if not arguments.frozen:
            flips.step(1)
        used += time.process_time() - before
        changes.append(trajectories.getLastEnergyChange()._value / KT)
        if len(changes) % arguments.every == 0:
            rows.append(measured(force, context))
    n = len(changes)
    return {
        **vars(arguments),
        "vertices": len(sphere.vertices),
        "trajectories": n,
        "accepted": (trajectories.getNumAccepted() - accepted) / (trajectories.getNumAttempted() - attempted),
        "flipsAccepted": flips.getNumAccepted() / max(1, flips.getNumAttempted()),
        "meanExp": float(np.mean(np.exp(-np.array(changes)))),
        **summary(np.array(rows)[len(rows) // 5 :], arguments.every * evaluations / n, used / evaluations),
    }


def measured(force, context):
    """Return the modes of degrees 2, 3 and 4, E_B in kT, and the area and volume over their targets."""
    x = context.getState(positions=True).getPositions(asNumpy=True)._value
    modes, geometry = modesOf(x, force.getTrianglesInContext(context)), force.getGeometryInContext(context)
    bending = force.getEnergyTermsInContext(context)["bending"]._value / KT
    return [*modes, bending, geometry.area / force.getTargetArea(), geometry.volume / force.getTargetVolume()]


def summary(rows, evaluations, seconds):
    """Return what a run's rows of modes and averages tell.

    Parameters
    ----------
    rows : array
        of shape (samples, 24)
    evaluations, seconds : float
        the computations that a sample takes, and the processor time that a computation takes
    """
    result, first = {}, 0
    for l in DEGREES:
        modes = rows[:, first : first + 2 * l + 1]
        first += 2 * l + 1
        power = average(np.mean(modes**2, axis=1), evaluations, seconds)
        result[f"l{l}"] = {
            **costs(modes, evaluations, seconds),
            "power": power.pop("mean"),
            "powerError": power.pop("error"),
            "squaredChanges": squaredChanges(modes, evaluations),
            "ofShape": power,
        }
    result["elongation"] = average(elongations(rows), evaluations, seconds)
    averages = {name: average(rows[:, first + k], evaluations, seconds) for k, name in enumerate(AVERAGES)}
    return {**result, **averages}


def average(numbers, evaluations, seconds):
    """Return what an independent sample of numbers costs, their mean, its standard error, their variance, and how far
    they change in some numbers of computations.
    """
    found = costs((numbers - numbers.mean())[:, np.newaxis], evaluations, seconds)
    return {
        **found,
        "mean": float(numbers.mean()),
        "error": float(numbers.std() / found["samples"] ** 0.5),
        "variance": float(numbers.var()),
        "squaredChanges": squaredChanges(numbers, evaluations),
    }


def costs(columns, evaluations, seconds):
    """Return what an independent sample of columns whose mean is zero costs, by the integrated time and by the decay of
    the correlation, and how many independent numbers the run has.
    """
    tau = autocorrelationTime(columns)
    return {
        "evaluations": tau * evaluations,
        "seconds": tau * evaluations * seconds,
        "samples": columns.size / tau,
        "decayTimes": decayTimes([columns], evaluations),
    }


def createParser(description):
    """Return a parser of what begin() takes."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("subdivisions", type=int)
    parser.add_argument("weight", type=float)
    parser.add_argument("step", type=float)
    parser.add_argument("steps", type=int)
    parser.add_argument("--volume", type=float, default=0.99)
    parser.add_argument("--flips", type=float, default=0.3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jitter", type=float, default=0.2)
    parser.add_argument("--refreshment", type=float, default=1, help="the part of momenta that is drawn anew")
    parser.add_argument("--penalty", type=float, default=1e6, help="the moduli of area and volume, in kT")
    what = "modulus in kT, shortest and longest in mean edges"
    parser.add_argument("--tether", type=float, nargs=3, default=[100, 0.85, 1.35], help=what)
    parser.add_argument("--precision", default="mixed")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--start", help="a mesh file to begin with, of large_vesicle.py, instead of a sphere")
    return parser


if __name__ == "__main__":
    parser = createParser(__doc__)
    parser.add_argument("seconds", type=float)
    parser.add_argument("--settle", type=int, default=0, help="trajectories, with flips, before the run")
    parser.add_argument("--frozen", action="store_true", help="no flips in the run: the mesh is elastic")
    parser.add_argument("--every", type=int, default=4, help="trajectories from one measurement to the next")
    print(json.dumps(measure(parser.parse_args()), default=float), flush=True)
