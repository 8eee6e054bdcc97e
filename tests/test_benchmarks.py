"""The scripts of benchmarks/ run, at small sizes, and print what they say that they print, whatever they measure."""

import importlib.util
import math
import re
import subprocess
import sys

import pytest

from conftest import ROOT

BENCHMARKS = ROOT / "benchmarks"
NEEDS = {"remeshing.py": "mmgpy", "meshes.py": "pyvista"}  # of the extras

# A command, and parts of what it prints, where # is a positive number.
RUNS = [
    ("benchmark.py --sizes 642 --threads 1 --seconds 0.01 --output a", "642 CPU 1 #"),
    ("benchmark.py --terms --sizes 642 --seconds 0.01", "all but repulsion", "all the same", "Gaussian moduli"),
    ("breathing.py 2 --frames 3 --widths 1 --sizes 0.05 --settle 10", "same cost 1 | 0.05 | #% | # | # | #"),
    ("budding.py minima --vertices 60 --tensions 5", "5.00 # # # # # # energy/kappa #, flat 31.42"),
    ("budding.py fluid --subdivisions 2 --steps 50 --tensions 5", "5.0 50 steps, converged # # # # #"),
    ("demixing.py frozen --sweeps 1000 --J 0.5 --plot a.png", "162 vertices, J = 0.5000 kT: U # +- #, |m| #, #"),
    ("large_vesicle.py 162 --computations 200 100 --runs 2 --write a.ply", '642, "runs": 2,', '"bending": [#, #],'),
    ("large_vesicle_plot.py {folder}/large_vesicle.jsonl a.png",),
    ("limits.py run 2 --evaluations 75000 --aim 0", '"vertices": 162,', '"orientation": [#, #],', '"edge": [#, #],'),
    ("limits.py laws {folder}/limits.jsonl", "2 | 10 | 0.1 | 1 | #% |", "bending N^("),
    ("long_waves.py 2 2 1e-3 10 0.2", '"vertices": 162,', '"accepted": #,', '"evaluations": #,'),
    ("long_waves_angles.py 2 2 2e-3 5 --degree 4 --trajectories 40", "accepted #%: l = 2: #, l = 3: #, l = 4: #"),
    ("long_waves_comparison.py {folder}/long_waves_ellipsoids.jsonl", "elongation | # ± "),
    ("long_waves_comparison.py {folder}/long_waves.jsonl", "at 40962 vertices as at 10242,"),
    ("long_waves_cost.py --subdivisions 2 --steps 5 --turns 1", "162 double # # # # # #", "162 mixed # # # # # #"),
    ("long_waves_minimization.py 642 2", "# iterations, #, within 1e-6 after #, # s: the forces fell below"),
    ("long_waves_plot.py {folder}/long_waves.jsonl a.png",),
    ("long_waves_spectrum.py 2 1e-3 10 0.3", '"frames": #,', '"powers": [#, #,', '"overTheory": [#, #,'),
    ("meshes.py --triangles 320 --repeat 1", "repair: corners apart |", "| 320 | "),
    ("minimization_scenes.py --vertices 162 --limit 20 sheet two", "sheet 162 0 # #", "two 162 2 # #"),
    ("moves.py waves --subdivisions 2 --moves 20 --settle 400", "N = 162: 1 #, 1.5 #, 2 #,"),
    ("moves.py momenta --rounds 2 --seconds 0.1 --settle 50", "accepted #%: l = 2: # +- ", "gain: l = 2: #"),
    ("remeshing.py --vertices 300", "| 300 | 162 | ", "| # to # |"),
    ("spontaneous_curvature.py neck --vertices 100", "c_0 = 3, radii 0.8307 and 0.5567: v #, energy #"),
    ("threads.py --sizes 642 --rounds 1", "642 nothing # # (#) # (#) 642 a busy process # # (#) # (#)"),
]  # fmt: skip

REFUSALS = [
    ("limits.py run 2 --steps 1000 --evaluations 1e5", "for --steps 1000 it must be at least 120000"),
    (
        "long_waves_comparison.py {folder}/long_waves_equality.jsonl",
        "has runs of [162] vertices; it must have two sizes",
    ),
    ("peers.py", "no program is named"),
    ("peers.py --freedts nothing", "argument --freedts: {here}/nothing must be a file that can be executed"),
    ("peers.py --mem3dg {here}/python", "python must be a Python that can import pymem3dg: No module of that name"),
    ("spontaneous_curvature.py seifert --volumes 0.9", "--volumes: invalid choice: 0.9"),
]


def execute(command, here):
    arguments = command.format(folder=BENCHMARKS, here=here).split()
    return subprocess.run(
        [sys.executable, BENCHMARKS / arguments[0], *arguments[1:]], cwd=here, capture_output=True, text=True
    )


def numbersOf(part, text):
    """Return the numbers of a text where a part has #, or None if the part is not there."""
    found = re.search(re.escape(part).replace(r"\#", r"([^\s,|%()\]]+)"), text)
    return found and [float(number) for number in found.groups()]


@pytest.mark.parametrize("command, parts", [(command, parts) for command, *parts in RUNS])
def testRuns(tmp_path, command, parts):
    needed = NEEDS.get(command.split()[0])
    if needed and not importlib.util.find_spec(needed):
        pytest.skip(f"there is no {needed}")
    done = execute(command, tmp_path)
    assert done.returncode == 0, done.stderr
    text = " ".join(done.stdout.split())
    for part in parts:
        numbers = numbersOf(part, text)
        assert numbers is not None, f"{part!r} is not in {text}"
        assert all(0 < number < math.inf for number in numbers), f"{part!r}: {numbers}"
    for name in command.split():
        assert not name.endswith((".png", ".ply")) or (tmp_path / name).stat().st_size > 5000


@pytest.mark.parametrize("command, message", REFUSALS)
def testRefusals(tmp_path, command, message):
    """One sentence, before anything is measured."""
    (tmp_path / "python").write_text("#!/bin/sh\necho 'No module of that name' >&2\nexit 1\n")
    (tmp_path / "python").chmod(0o755)
    done = execute(command, tmp_path)
    assert done.returncode == 2 and message.format(here=tmp_path) in done.stderr.splitlines()[-1] and not done.stdout


def testNoneIsLeftOut():
    scripts = {path.name for path in BENCHMARKS.glob("*.py")}
    assert {command.split()[0] for command, *_ in RUNS + REFUSALS} == scripts
