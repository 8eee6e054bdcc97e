"""Time other programs and this package on the same spheres: one thread, in turns, processor time.

    python benchmarks/peers.py --trimem trimem/bin/python --mem3dg mem3dg/bin/python --freedts FreeDTS/version_2.1/DTS
    python benchmarks/peers.py --freedts DTS --sizes 2562 --output results/peers.json

Each option names the program: the Python of an environment in which TriMem, TriLMP or Mem3DG is installed, or the
executable of FreeDTS.  Those that are not given are left out.  Meshes are rough icospheres with vertices about 1 apart,
and for FreeDTS what it makes of an icosphere in some sweeps.  The bending modulus is 30 kT, area and volume are held,
and edges have bounds.  Prints what each program needs for what it counts in, and what this package needs beside it, in
the same minutes: the least of some rounds, which other work disturbed least.

Processor time is that of the whole process, and differences of long and short runs where a program is a command, so
that other work on the machine disturbs little.  What is compared is not always the same work, as
docs/results/comparison.md says.
"""

import argparse
import functools
import itertools
import json
import math
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmark import (
    KT,
    SIZES,
    createContext,
    createForce,
    createMembrane,
    describeMachine,
    measureTriMem,
    timeCalls,
)

BENDING = 30  # kT
SECONDS = 0.3  # of a measurement

# --- this package


def measureOurs(mesh, bounds=(0.7, 1.5), fraction=0.1):
    """Return the processor time, in ns, of an energy and of a leapfrog step per vertex, and of an attempt to flip an
    edge in sweeps over a fraction of them; and the part of attempts that is accepted.
    """
    import openmm as mm

    import openmmhelfrich as mh

    def contextOf(integrator):
        force = createForce(mesh)
        force.setBendingModulus(BENDING * KT)
        force.setTether(1e2 * KT, *bounds, 2)
        return createContext(mesh, force, integrator, "CPU", 1)

    def seconds(call):
        return timeCalls(call, SECONDS, 3, time.process_time)[0]

    size = len(mesh.vertices)
    context = contextOf(mm.VerletIntegrator(1e-12))
    force = mh.HelfrichForce.cast(context.getSystem().getForce(0))
    results = {"energy": seconds(lambda: force.getEnergyTermsInContext(context)) / size}
    trajectory = mh.HamiltonianTrajectoryIntegrator(300, 1e-9, 10)
    context = contextOf(trajectory)
    times = []
    for steps in (10, 40):
        trajectory.setStepsPerTrajectory(steps)
        times.append(seconds(lambda: trajectory.step(1)))
    results["forces"] = (times[1] - times[0]) / 30 / size
    flips = mh.EdgeFlipIntegrator(300, fraction)
    flips.setRandomNumberSeed(1)
    context = contextOf(flips)
    results["flip"] = seconds(lambda: flips.step(1)) / (fraction * (3 * size - 6))
    return {
        **{name: 1e9 * value for name, value in results.items()},
        "accepted": flips.getNumAccepted() / flips.getNumAttempted(),
    }


# --- programs that are Python packages, measured by this script in their own environments


def insideTriMem(mesh):
    figures = measureTriMem(mesh["vertices"], mesh["triangles"], BENDING, clock=time.process_time)
    return {
        ours: figures[theirs][0]
        for theirs, ours in (("energy", "energy"), ("gradient", "forces"), ("flip attempt", "flip"))
    }


def insideMem3DG(mesh):
    """An energy, and with forces, after new positions: what each step of its integrators computes."""
    import pymem3dg

    positions = mesh["vertices"]
    geometry = pymem3dg.Geometry(mesh["triangles"].astype("uint64"), positions)
    area, volume = geometry.getSurfaceArea(), geometry.getVolume()
    parameters = pymem3dg.Parameters()
    parameters.bending.Kb = BENDING
    parameters.tension.form = lambda x: (2e4 * (x / area - 1) / area, 1e4 * (x / area - 1) ** 2)
    parameters.osmotic.form = lambda x: (-2e4 * (x / volume - 1) / volume, 1e4 * (x / volume - 1) ** 2)
    system = pymem3dg.System(geometry, parameters)
    system.initialize()

    def energy():
        geometry.setInputVertexPositions(positions)
        system.updateConfigurations()
        system.computeTotalEnergy()

    def forces():
        energy()
        system.computeConservativeForcing()

    return {
        name: 1e9 * timeCalls(call, SECONDS, 3, time.process_time)[0] / len(positions)
        for name, call in (("energy", energy), ("forces", forces))
    }


def insideTriLMP(mesh):
    """A step of LAMMPS with TriMem's gradient, from the difference of a long and a short run without flips."""
    from trimem.mc.trilmp import TriLmp

    extent = 2 * float(abs(mesh["vertices"]).max())
    program = TriLmp(
        initialize=True,
        num_particle_types=1,
        mass_particle_type=[1.0],
        group_particle_type=["vertices"],
        mesh_points=mesh["vertices"],
        mesh_faces=mesh["triangles"],
        kappa_b=BENDING,
        kappa_a=1e4,
        kappa_v=1e4,
        kappa_c=1e2,
        kappa_t=1e2,
        kappa_r=1e2,
        step_size=1e-4,
        traj_steps=100,
        flip_ratio=0.0,
        initial_temperature=1.0,
        pure_MD=True,
        switch_mode="alternating",
        box=(-extent, extent) * 3,
        info=10**9,
        thin=10**9,
        performance_increment=10**9,
        energy_increment=10**9,
        checkpoint_every=10**9,
    )
    for command in (
        "fix NVEMEM vertices nve",
        "pair_style none",
        "pair_style hybrid/overlay table linear 2000",
        "pair_modify pair table special lj/coul 0.0 0.0 0.0 tail no",
        "pair_coeff 1 1 table trimem_srp.table trimem_srp",
    ):
        program.lmp.command(command)
    times = []
    for steps in (100, 300):
        start = time.process_time()
        program.run(steps)
        times.append(time.process_time() - start)
    return {"step": 1e9 * (times[1] - times[0]) / 200 / len(mesh["vertices"])}


INSIDE = {"trimem": insideTriMem, "mem3dg": insideMem3DG, "trilmp": insideTriLMP}
MODULES = {"trimem": "trimem.core", "mem3dg": "pymem3dg", "trilmp": "trimem.mc.trilmp"}  # that these import


def programOf(name, path):
    """Return the absolute path of a program, which a Python has to import."""
    path = os.path.abspath(path)
    if not (os.path.isfile(path) and os.access(path, os.X_OK)):
        raise argparse.ArgumentTypeError(f"{path} must be a file that can be executed")
    if name in MODULES:
        tried = subprocess.run([path, "-c", f"import {MODULES[name]}"], capture_output=True, text=True)
        if tried.returncode:
            reason = (tried.stderr.strip() or "it failed").splitlines()[-1]
            raise argparse.ArgumentTypeError(f"{path} must be a Python that can import {MODULES[name]}: {reason}")
    return path


def measureInside(name, python, mesh):
    """Return what this script measures in another environment."""
    import numpy as np

    with tempfile.TemporaryDirectory() as folder:
        np.savez(Path(folder) / "mesh.npz", vertices=mesh.vertices, triangles=mesh.triangles)
        command = [python, os.path.abspath(__file__), "--inside", name, "mesh.npz"]
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        result = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
        if result.returncode:
            sys.exit(f"peers: {name} failed in {python}:\n{(result.stderr or result.stdout)[-2000:]}")
        return json.loads((Path(folder) / "result.json").read_text())


# --- FreeDTS, a command

FREEDTS = """\
Kappa                    = {bending} 0 0
Temperature              = 1 0
Min_Max_Lenghts          = 1 3
TotalAreaCoupling        = HarmonicPotential {area} {gamma}
VolumeCoupling           = SecondOrder 0 20000 {volume}
VertexPositionIntegrator = MetropolisAlgorithm {moves} 1 0.05
AlexanderMove            = MetropolisAlgorithm {flips}
TimeSeriesData_Period    = 0
NonbinaryTrajectory      = TSI frames {interval}
Set_Steps                = 1 {steps}
"""
WARMUP = 40  # sweeps over vertices and edges, before anything is timed
SWEEPS = {"move": (5, 25), "flip": (20, 120)}  # of a short and of a long run


def meshOfFreeDTS(program, size):
    """Return what FreeDTS makes of an icosphere in some sweeps, with edges within its bounds."""
    import openmmhelfrich as mh

    sphere = mh.Mesh.icosphere(SIZES[size])
    sphere = mh.Mesh(sphere.vertices * 1.05 / sphere.edgeLengths.min(), sphere.triangles)
    with tempfile.TemporaryDirectory() as folder:
        _runFreeDTS(program, folder, sphere, ("move", "flip"), WARMUP, WARMUP)
        return mh.Mesh.read(Path(folder) / "frames/dts1.tsi")


def measureFreeDTS(program, mesh):
    """Return the processor time, in ns, of an attempt to move a vertex, and to flip an edge, from the difference of a
    long and a short run with one of the two alone; and the part of attempts to flip that is accepted.
    """
    results = {}
    for move, count in (("move", len(mesh.vertices)), ("flip", 3 * len(mesh.vertices) - 6)):
        times = []
        for steps in SWEEPS[move]:
            with tempfile.TemporaryDirectory() as folder:
                seconds, text = _runFreeDTS(program, folder, mesh, (move,), steps)
                times.append(seconds)
        short, long = SWEEPS[move]
        results[move] = 1e9 * (times[1] - times[0]) / (long - short) / count
    results["accepted"] = float(re.findall(r"alexander move = ([\d.]+)%", text)[-1]) / 100
    return results


def _runFreeDTS(program, folder, mesh, moves, steps, interval=0):
    """Return the processor time of a run in a folder, in seconds, and what it prints."""
    triangles = len(mesh.triangles)
    mesh.write(Path(folder) / "start.tsi")
    Path(folder, "input.dts").write_text(
        FREEDTS.format(
            bending=BENDING,
            area=2 * 1e4 / triangles,
            gamma=(mesh.area / (triangles * 3**0.5 / 4) - 1) / 2,
            volume=mesh.volume * 6 * math.pi**0.5 / mesh.area**1.5,
            moves=int("move" in moves),
            flips=int("flip" in moves),
            steps=steps,
            interval=interval,
        )
    )
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [program, "-in", "input.dts", "-top", "start.tsi", "-nt", "1", "-seed", "1"]
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    if result.returncode or "Simulation has ended" not in result.stdout:
        sys.exit(f"peers: {' '.join(command)} failed:\n{(result.stdout + result.stderr)[-2000:]}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, result.stdout


# --- side by side

QUANTITIES = {
    "energy": "an energy, a vertex",
    "forces": "energy and forces, a vertex",
    "step": "a step of dynamics, a vertex; ours: of a trajectory",
    "move": "an attempt to move a vertex; ours: a step of a trajectory, a vertex",
    "flip": "an attempt to flip an edge",
    "accepted": "the part of these that is accepted",
}


def compare(programs, sizes, rounds):
    """Return the cases: the least of a number of rounds, in each of which a program has its turn and then ours."""
    cases = []
    for size, (name, path) in itertools.product(sizes, programs.items()):
        mesh = meshOfFreeDTS(path, size) if name == "freedts" else createMembrane(size)
        theirs, ours = [], []
        for _ in range(rounds):
            if name == "freedts":
                theirs.append(measureFreeDTS(path, mesh))
                ours.append(measureOurs(mesh, (1, 3**0.5), 1.0))
            else:
                theirs.append(measureInside(name, path, mesh))
                ours.append(measureOurs(mesh))
        for quantity in theirs[0]:
            mine = [figures["forces" if quantity in ("move", "step") else quantity] for figures in ours]
            each = {"theirs": [figures[quantity] for figures in theirs], "ours": mine}
            least = {whose: min(values) for whose, values in each.items()}
            cases.append({"program": name, "size": size, "quantity": quantity, **least, "rounds": each})
            _print(cases[-1])
    return cases


def _print(case):
    places = 3 if case["quantity"] == "accepted" else 1
    ratio = case["theirs"] / case["ours"]
    print(
        f"{case['program']:>8} {case['size']:>8} {case['theirs']:>8.{places}f} {case['ours']:>8.{places}f} "
        f"{ratio:>6.1f}  {QUANTITIES[case['quantity']]}",
        flush=True,
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("trimem", "mem3dg", "trilmp"):
        of, what = functools.partial(programOf, name), "the Python of the environment that has it"
        parser.add_argument(f"--{name}", type=of, metavar="PYTHON", help=what)
    of = functools.partial(programOf, "freedts")
    parser.add_argument("--freedts", type=of, metavar="DTS", help="FreeDTS's executable")
    parser.add_argument("--sizes", type=int, nargs="+", choices=sorted(SIZES), default=[2562, 10242])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--output", type=Path, help="a JSON file for the figures of each round")
    parser.add_argument("--inside", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.inside:
        import numpy as np

        result = INSIDE[options.inside[0]](np.load(options.inside[1]))
        Path("result.json").write_text(json.dumps(result))  # LAMMPS writes to the standard output until it ends
        return
    programs = {name: getattr(options, name) for name in (*INSIDE, "freedts") if getattr(options, name)}
    if not programs:
        parser.error("no program is named: use --trimem, --mem3dg, --trilmp or --freedts")
    machine = describeMachine()
    print(f"{machine['processor']}, {machine['cores']} cores, SIMD {machine['SIMD']}; processor time in ns, one thread")
    print(" program vertices   theirs     ours  ratio")
    cases = compare(programs, options.sizes, options.rounds)
    if options.output:
        options.output.parent.mkdir(parents=True, exist_ok=True)
        options.output.write_text(json.dumps({"machine": machine, "cases": cases}, indent=1) + "\n")


if __name__ == "__main__":
    main()
