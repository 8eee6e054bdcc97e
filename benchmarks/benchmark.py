"""Time the plugin on icospheres: the table of the method's paper (Siggel et al., J.

Chem. Phys. 157, 174801 (2022)), and more.

    python benchmarks/benchmark.py                    # 642 to 655,362 vertices, 1 and 2 threads, CPU platform
    python benchmarks/benchmark.py --sizes 2562 10242 --threads 1 --output results/benchmark
    python benchmarks/benchmark.py --terms            # what each term costs, at 10,242 vertices or --sizes
    python benchmarks/benchmark.py --precision mixed  # forces in trajectories in single precision
    python benchmarks/benchmark.py --sweeps           # sweeps of flips and exchanges, the fastest of many

Prints a table and writes it as JSON and as a plot.  Each size runs in a process of its own, so that its peak memory is
its own.  Where TriMem is importable, it is timed on the same meshes and parameters, and the ratio is printed.
"""

import argparse
import itertools
import json
import os
import platform as machine
import resource
import statistics
import subprocess
import sys
import time
import typing
from pathlib import Path

SIZES = {642: 3, 2562: 4, 10242: 5, 40962: 6, 163842: 7, 655362: 8, 2621442: 9, 10485762: 10}
KT = 2.494338785445972  # kJ/mol at 300 K
COLUMNS = {
    "energy": "ns/vertex",
    "gradient": "ns/vertex",
    "gradient+repulsion": "ns/vertex",
    "leapfrog step": "ns/vertex",
    "leapfrog+repulsion": "ns/vertex",
    "flip attempt": "ns",
    "flip attempt+repulsion": "ns",
    "full step": "ms",
    "memory": "bytes/vertex",
}


class Case(typing.NamedTuple):
    size: int
    platform: str
    threads: int
    precision: str
    seconds: float  # of a measurement


def createMembrane(size):
    """Return a Mesh of a rough icosphere of a number of vertices, 1 nm apart."""
    import numpy as np

    import openmmhelfrich as mh

    mesh = mh.Mesh.icosphere(SIZES[size], (3**0.5 * size / (8 * np.pi)) ** 0.5)
    vertices = mesh.vertices + np.random.default_rng(1).normal(scale=0.05, size=mesh.vertices.shape)
    return mh.Mesh(vertices, mesh.triangles)


TERMS = ("bending", "area", "volume", "area difference", "tether")


def createForce(mesh, repulsion=False, terms=TERMS):
    """Return a HelfrichForce with some terms on, by default all but the repulsion."""
    import openmmhelfrich as mh

    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setTargetArea(mesh.area)
    force.setTargetVolume(mesh.volume)
    force.setTargetAreaDifference((16 * 3.14159265 * mesh.area) ** 0.5)
    force.setBendingModulus(20 * KT * ("bending" in terms))
    force.setAreaModulus(1e4 * KT * ("area" in terms))
    force.setVolumeModulus(1e4 * KT * ("volume" in terms))
    force.setAreaDifferenceModulus(1e2 * KT * ("area difference" in terms))
    force.setTether(1e2 * KT * ("tether" in terms), 0.7, 1.5, 2)
    if repulsion:
        force.setRepulsion(1e2 * KT, 1.0, 2, 2)
    return force


def createContext(mesh, force, integrator, platform, threads):
    """Return a Context, of as many threads if the platform has them, of OpenMM's choice with None."""
    import openmm as mm

    system = mesh.createSystem(mass=1.0)
    system.addForce(force)
    chosen = mm.Platform.getPlatformByName(platform)
    properties = {"Threads": str(threads)} if platform == "CPU" and threads is not None else {}
    context = mm.Context(system, integrator, chosen, properties)
    context.setPositions(mesh.vertices)
    return context


def timeCalls(call, seconds=1.0, repeats=7, clock=time.perf_counter):
    """Return the median and the spread (max-min)/median of the time of a call, in seconds."""
    call()
    start = clock()
    call()
    count = max(1, int(seconds / repeats / max(clock() - start, 1e-9)))
    times = []
    for _ in range(repeats):
        start = clock()
        for _ in range(count):
            call()
        times.append((clock() - start) / count)
    median = statistics.median(times)
    return median, (max(times) - min(times)) / median


def stepSize(size):
    """A leapfrog step, in ps, with which most trajectories are accepted."""
    return 0.0015 * (642 / size) ** 0.4


def timeGradient(mesh, force, platform, threads, seconds, precision="double"):
    """Return the median time of a force evaluation with a leapfrog step of next to no size, in ns per vertex, and its
    spread.
    """
    import openmmhelfrich as mh

    integrator = mh.HamiltonianTrajectoryIntegrator(300, 1e-9, 10)
    integrator.setForcePrecision(precision)
    context = createContext(mesh, force, integrator, platform, threads)
    times = []
    # What a trajectory does besides its steps is in the difference of a long and a short one no more.
    for steps in (10, 40):
        integrator.setStepsPerTrajectory(steps)
        times.append(timeCalls(lambda: integrator.step(1), seconds))
    del context
    return (times[1][0] - times[0][0]) / 30 / len(mesh.vertices) * 1e9, times[1][1]


def timeTerms(size, threads, seconds):
    """Print what each combination of terms costs."""
    mesh = createMembrane(size)
    combinations = {
        "area and volume": ("area", "volume"),
        "tether": ("tether",),
        "area difference": ("area difference",),
        "bending": ("bending",),
        "bending, area, volume": ("bending", "area", "volume"),
        "bending, area, volume, area difference": TERMS[:4],
        "all but repulsion": TERMS,
    }
    print(
        f"{size} vertices, {threads} thread{'s' * (threads > 1)}: a force evaluation and a leapfrog step, ns per vertex"
    )
    for name, terms in combinations.items():
        print(f"{timeGradient(mesh, createForce(mesh, terms=terms), 'CPU', threads, seconds)[0]:>8.1f}  {name}")
    print(f"{timeGradient(mesh, createForce(mesh, True), 'CPU', threads, seconds)[0]:>8.1f}  all")
    timeMaterials(mesh, threads, seconds)


def createMaterial(mesh, species, gaussianModulus=0.0, spontaneousCurvature=0.0):
    """Return a force with all terms but the repulsion, of one material or of two species that differ in everything."""
    force, radius = createForce(mesh), mesh.vertices.max()
    force.setSpontaneousCurvature(spontaneousCurvature / radius)
    if species is not None:
        force.addSpecies(20 * KT, 1 / radius)
        force.addSpecies(10 * KT, -1 / radius, gaussianModulus)
        force.setLineTension(0, 1, 2 * KT)
        force.setVertexSpecies(species.astype(int))
    return force


def timeMaterials(mesh, threads, seconds):
    """Print the time of a force evaluation with a leapfrog step, and of an attempt to flip an edge, by material."""
    import numpy as np

    cap = mesh.vertices[:, 2] > 0.3 * mesh.vertices.max()
    random = np.random.default_rng(2).random(len(mesh.vertices)) < 0.5
    print("the same with all but repulsion, and a flip attempt, ns, by material")
    for name, material in {
        "one material": (None,),
        "one with a spontaneous curvature": (None, 0.0, 0.7),
        "a cap of another species": (cap,),
        "two species in random places": (random,),
        "a cap, Gaussian moduli": (cap, -10 * KT),
        "random places, Gaussian moduli": (random, -10 * KT),
    }.items():
        gradient = timeGradient(mesh, createMaterial(mesh, *material), "CPU", threads, seconds)[0]
        flips = timeFlipsOf(mesh, createMaterial(mesh, *material), threads, seconds)
        print(f"{gradient:>8.1f} {flips:>8.1f}  {name}")


def timeFlipsOf(mesh, force, threads, seconds):
    """Return the median time of an attempt to flip an edge, in ns."""
    import openmmhelfrich as mh

    flips = mh.EdgeFlipIntegrator(300, 1.0)
    flips.setRandomNumberSeed(1)
    context = createContext(mesh, force, flips, "CPU", threads)
    median = timeCalls(lambda: context.getIntegrator().step(1), seconds)[0]
    return 1e9 * median / (3 * len(mesh.vertices) - 6)


def timeExchanges(sizes, threads, seconds):
    """Print the time of an attempt to exchange species, with what a sweep does before its attempts."""
    print("an attempt to exchange species of neighbors, two of them in random places, ns; and the spread")
    for size, fraction, count in itertools.product(sizes, (1.0, 0.1), threads):
        mesh = createMembrane(size)
        for name, gaussianModulus in (("bending, line tension", 0.0), ("and Gaussian moduli", -10 * KT)):
            median, spread = timeExchangesOf(mesh, gaussianModulus, fraction, count, seconds)
            print(f"{median:>8.1f} {spread:>5.0%}  {size} vertices, {count} threads, {fraction} of the edges, {name}")


def timeExchangesOf(mesh, gaussianModulus, fraction, threads, seconds):
    """Return the median time of an attempt, in ns, and its spread."""
    import numpy as np

    import openmmhelfrich as mh

    random = np.random.default_rng(2).random(len(mesh.vertices)) < 0.5
    exchange = mh.SpeciesExchangeIntegrator(300, fraction)
    exchange.setRandomNumberSeed(1)
    context = createContext(mesh, createMaterial(mesh, random, gaussianModulus), exchange, "CPU", threads)
    context.getIntegrator().step(int(10 / fraction))
    median, spread = timeCalls(lambda: context.getIntegrator().step(1), seconds)
    return 1e9 * median / (fraction * (3 * len(mesh.vertices) - 6)), spread


def timeSmallSweeps(sizes, threads, count=300):
    """Print the time of an attempt in sweeps over 10% of the edges: the fastest sweep of many, one after the other and
    after trajectories, which leave another part of the membrane in the cache.
    """
    import numpy as np

    import openmmhelfrich as mh

    print("an attempt in sweeps over 10% of the edges, ns: one sweep after the other, and after a trajectory")
    for size, numThreads in itertools.product(sizes, threads):
        mesh = createMembrane(size)
        random = np.random.default_rng(2).random(size) < 0.5
        pairs = createForce(mesh, terms=TERMS[1:])
        pairs.addSpecies(0, 0)
        pairs.addSpecies(0, 0)
        pairs.setPairEnergy(0, 1, KT)
        pairs.setVertexSpecies(random.astype(int))
        for name, force in {
            "flips": createForce(mesh),
            "flips, repulsion": createForce(mesh, True),
            "exchanges, bending, line tension": createMaterial(mesh, random),
            "exchanges, and Gaussian moduli": createMaterial(mesh, random, -10 * KT),
            "exchanges, pair energies alone": pairs,
        }.items():
            integrator = mh.HybridMonteCarloIntegrator(300, stepSize(size), 10, 0.1, 0.3)
            integrator.setRandomNumberSeed(1)
            if "exchanges" in name:
                integrator.addMove(mh.SpeciesExchangeIntegrator(300, 0.1), 0.2)
            context = createContext(mesh, force, integrator, "CPU", numThreads)
            sweeps = integrator.getIntegrator(integrator.getNumIntegrators() - 1)
            fastest = [timeFastest(sweeps, before, count) for before in (None, integrator.getIntegrator(0))]
            ns = [1e9 * seconds / (0.1 * (3 * size - 6)) for seconds in fastest]
            print(f"{ns[0]:>8.1f} {ns[1]:>8.1f}  {size} vertices, {numThreads} threads, {name}", flush=True)
            del context


def timeFastest(move, before, count):
    """Return the time of the fastest of many steps of a move, in seconds, each after one of another move or None."""
    times = []
    for _ in range(count):
        if before is not None:
            before.step(1)
        start = time.perf_counter()
        move.step(1)
        times.append(time.perf_counter() - start)
    return min(times)


def timeForces(results, case, repulsion):
    """Time energy, gradient and the steps of a trajectory."""
    import openmm as mm

    import openmmhelfrich as mh

    mesh = createMembrane(case.size)
    suffix = "+repulsion" if repulsion else ""
    force = createForce(mesh, repulsion)
    results["gradient" + suffix] = timeGradient(mesh, force, case.platform, case.threads, case.seconds, case.precision)
    if not repulsion:
        context = createContext(mesh, createForce(mesh), mm.VerletIntegrator(1e-12), case.platform, case.threads)
        energyForce = mh.HelfrichForce.cast(context.getSystem().getForce(0))
        median, spread = timeCalls(lambda: energyForce.getEnergyTermsInContext(context), case.seconds)
        results["energy"] = (median / case.size * 1e9, spread)
        del context
    integrator = mh.HamiltonianTrajectoryIntegrator(300, stepSize(case.size), 100)
    integrator.setForcePrecision(case.precision)
    integrator.setRandomNumberSeed(1)
    context = createContext(mesh, createForce(mesh, repulsion), integrator, case.platform, case.threads)
    median, spread = timeCalls(lambda: integrator.step(1), case.seconds, 5)
    results["leapfrog" + (suffix or " step")] = (median / case.size / 101 * 1e9, spread)


def timeSweeps(results, case, repulsion):
    """Time sweeps of flips, and the paper's full step: a trajectory of 100 steps and a sweep over 10% of the edges."""
    import openmmhelfrich as mh

    mesh = createMembrane(case.size)
    suffix = "+repulsion" if repulsion else ""
    integrator = mh.HybridMonteCarloIntegrator(300, stepSize(case.size), 100, 0.1, 0.5)
    integrator.setForcePrecision(case.precision)
    integrator.setRandomNumberSeed(1)
    context = createContext(mesh, createForce(mesh, repulsion), integrator, case.platform, case.threads)
    flips, trajectories = integrator.getIntegrator(1), integrator.getIntegrator(0)
    trajectories.step(2)
    median, spread = timeCalls(lambda: flips.step(1), case.seconds)
    results["flip attempt" + suffix] = (median / (0.3 * case.size) * 1e9, spread)
    if not repulsion:

        def fullStep():
            trajectories.step(1)
            flips.step(1)

        median, spread = timeCalls(fullStep, case.seconds, 5)
        results["full step"] = (median * 1e3, spread)
    del context


def residentMemory():
    """Return the resident memory of this process, in bytes."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize()


def measureMemory(results, case):
    """Measure the resident memory that the plugin adds to a Context of OpenMM that makes trajectories and flips."""
    import openmm as mm

    import openmmhelfrich as mh
    import openmmhelfrich.helfrich  # the library is loaded before anything is measured

    mesh = createMembrane(case.size)
    sizes = []
    for plain in (True, False):
        before = residentMemory()
        integrator = (
            mm.VerletIntegrator(1e-12) if plain else mh.HybridMonteCarloIntegrator(300, stepSize(case.size), 10)
        )
        context = createContext(
            mesh, mm.CustomExternalForce("0*x") if plain else createForce(mesh), integrator, case.platform, case.threads
        )
        if plain:
            integrator.step(2)
        else:
            integrator.setForcePrecision(case.precision)
            integrator.getIntegrator(0).step(1)
            integrator.getIntegrator(1).step(1)
            integrator.getIntegrator(0).step(1)
        sizes.append(residentMemory() - before)
        del context, integrator
    results["memory"] = ((sizes[1] - sizes[0]) / case.size, 0)


def measure(case):
    """Return all figures of one case, each a pair of the median and its relative spread."""
    results = {}
    measureMemory(results, case)
    for repulsion in (False, True):
        timeForces(results, case, repulsion)
        timeSweeps(results, case, repulsion)
    results["peak"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return results


def measureTriMem(vertices, triangles, bendingModulus=20, seconds=1.0, clock=time.perf_counter):
    """Return the figures of TriMem for a mesh and the same moduli on one thread, or {} if it cannot be imported."""
    try:
        import trimem.core as core
    except ImportError:
        return {}
    import numpy as np

    size = len(vertices)
    triMesh = core.TriMesh(vertices, triangles)
    bonds, repulsion, continuation = core.BondParams(), core.SurfaceRepulsionParams(), core.ContinuationParams()
    bonds.lc0, bonds.lc1, bonds.r, bonds.type = 1.5, 0.7, 2, core.BondType.Edge
    repulsion.n_search, repulsion.rlist, repulsion.exclusion_level, repulsion.lc1, repulsion.r = (
        "verlet-list",
        0.2,
        2,
        0.1,
        2,
    )
    continuation.delta, continuation.lam = 0, 1
    parameters = core.EnergyParams()
    (
        parameters.kappa_b,
        parameters.kappa_a,
        parameters.kappa_v,
        parameters.kappa_c,
        parameters.kappa_t,
        parameters.kappa_r,
    ) = bendingModulus, 1e4, 1e4, 1e2, 1e2, 0
    parameters.area_frac = parameters.volume_frac = parameters.curvature_frac = 1
    parameters.bond_params, parameters.repulse_params, parameters.continuation_params = bonds, repulsion, continuation
    manager = core.EnergyManager(triMesh, parameters)
    energy, spread = timeCalls(lambda: manager.energy(triMesh), seconds, clock=clock)
    gradient, gradientSpread = timeCalls(lambda: np.asarray(manager.gradient(triMesh)), seconds, clock=clock)
    # TriMem counts a sweep's attempts by the fraction of edges too.
    flips, flipSpread = timeCalls(lambda: core.flip(triMesh, manager, 0.1), seconds, clock=clock)
    return {
        "energy": (energy / size * 1e9, spread),
        "gradient": (gradient / size * 1e9, gradientSpread),
        "flip attempt": (flips / (0.3 * size) * 1e9, flipSpread),
    }


def describeMachine():
    """Return what the figures depend on."""
    import openmm as mm

    import openmmhelfrich as mh

    lines = Path("/proc/cpuinfo").read_text().splitlines()
    model = next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), machine.processor())
    return {
        "processor": model,
        "cores": os.cpu_count(),
        "OpenMM": mm.Platform.getOpenMMVersion(),
        "openmm-helfrich": mh.__version__,
        "SIMD": os.environ.get("OPENMM_HELFRICH_SIMD", "best"),
        "load": os.getloadavg()[0],
    }


def runCase(case):
    """Measure a case in a process of its own."""
    command = [sys.executable, __file__, "--case", json.dumps(case)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()[-1])


def printTable(cases):
    """Print the figures, a line a case."""
    print(
        f"{'vertices':>9} {'platform':>9} {'threads':>7} "
        + " ".join(f"{name:>{max(len(name), 8)}}" for name in COLUMNS)
        + f" {'peak':>8}"
    )
    print(" " * 28 + " ".join(f"{unit:>{max(len(name), 8)}}" for name, unit in COLUMNS.items()) + f" {'MiB':>8}")
    for case in cases:
        figures = case["results"]
        print(
            f"{case['size']:>9} {case['platform']:>9} {case['threads']:>7} "
            + " ".join(f"{figures[name][0]:>{max(len(name), 8)}.1f}" for name in COLUMNS)
            + f" {figures['peak']:>8.0f}"
        )
        for name, (theirs, _) in case["TriMem"].items():
            print(
                f"{'':>28}TriMem's {name}: {theirs:.0f} {COLUMNS[name]}, {theirs / figures[name][0]:.0f} times as long"
            )


def plot(cases, path):
    """Draw time per vertex against the number of vertices."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(9, 4.5), layout="constrained")
    for threads in sorted({case["threads"] for case in cases}):
        for name in ("energy", "gradient", "leapfrog step", "leapfrog+repulsion"):
            points = [(case["size"], case["results"][name][0]) for case in cases if case["threads"] == threads]
            axes.plot(
                *zip(*points),
                marker="o",
                linestyle="-" if threads == 1 else "--",
                label=f"{name}, {threads} thread{'s' * (threads > 1)}",
            )
    axes.set(xscale="log", xlabel="vertices", ylabel="ns per vertex", ylim=(0, None))
    axes.legend(fontsize="small", loc="upper left", bbox_to_anchor=(1, 1))
    figure.savefig(path, dpi=150)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", choices=sorted(SIZES))
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--platforms", nargs="+", default=["CPU"])
    parser.add_argument(
        "--precision", choices=["double", "mixed"], default="double", help="of the forces in trajectories"
    )
    parser.add_argument(
        "--output", type=Path, default=Path("benchmark"), help="first part of the names of the JSON file and the plot"
    )
    parser.add_argument("--terms", action="store_true", help="time each combination of terms instead")
    parser.add_argument("--exchanges", action="store_true", help="time exchanges of species instead")
    parser.add_argument("--sweeps", action="store_true", help="time sweeps over 10%% of the edges instead")
    parser.add_argument("--seconds", type=float, default=1, help="of each measurement, but of --sweeps")
    parser.add_argument("--case", type=json.loads, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.case:
        print(json.dumps(measure(Case(*options.case))))
        return
    if options.terms:
        for size in options.sizes or [10242]:
            timeTerms(size, 1, options.seconds)
        return
    options.sizes = options.sizes or sorted(SIZES)[:6]
    if options.exchanges:
        timeExchanges(options.sizes, options.threads, options.seconds)
        return
    if options.sweeps:
        timeSmallSweeps(options.sizes, options.threads)
        return
    cases = []
    for platform in options.platforms:
        for threads in options.threads if platform == "CPU" else [1]:
            for size in options.sizes:
                mesh = createMembrane(size)
                case = Case(size, platform, threads, options.precision, options.seconds)
                isTheirs = threads == 1 and platform == "CPU"
                cases.append(
                    {
                        "size": size,
                        "platform": platform,
                        "threads": threads,
                        "results": runCase(case),
                        "TriMem": measureTriMem(mesh.vertices, mesh.triangles, seconds=options.seconds)
                        if isTheirs
                        else {},
                    }
                )
                print(f"{size} vertices, {platform}, {threads} threads: done", file=sys.stderr)
    printTable(cases)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.with_suffix(".json").write_text(
        json.dumps(
            {"machine": describeMachine(), "units": COLUMNS, "precision": options.precision, "cases": cases}, indent=1
        )
    )
    plot(cases, options.output.with_suffix(".png"))


if __name__ == "__main__":
    main()
