"""Commands on disks that fail or fill up, killed at any moment, and on files that are damaged.

Here is a sample, the same each time; tests/faults/attacks.py and tests/faults/mutations.py make every attack.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

FAULTS = Path(__file__).parent / "faults"
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="libraries are preloaded as Linux does it")
needsCompiler = pytest.mark.skipif(
    not shutil.which(os.environ.get("CXX", "c++")), reason="there is no C++ compiler for the library that is preloaded"
)


def findFaults(script, *arguments):
    """Return what a script finds, in lines."""
    done = subprocess.run(
        [sys.executable, FAULTS / script, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    return [line for line in done.stdout.splitlines() if ", 0 faults" not in line] if done.returncode else []


MODES = [f"--mode={mode}" for mode in ("fail", "full", "kill", "torn", "short")]


@needsCompiler
@pytest.mark.parametrize(
    "scene, every",
    [("run", 41), ("resume", 61), ("more", 61), ("overwrite", 101), ("sweep", 301), ("sweepAgain", 301)],
)
def testErrorsAndKillsOfRuns(scene, every):
    assert not findFaults("attacks.py", scene, *MODES, "--every", every)


@needsCompiler
def testErrorsAndKillsOfWhatLooks():
    scenes = ("xyz", "pvd", "ply", "vtkhdf", "plot", "report", "render", "film", "mp4")
    assert not findFaults("attacks.py", *scenes, *MODES, "--every", 17)


@needsCompiler
def testAnotherProcessFillsTheDisk(tmp_path):
    mount = ["unshare", "--user", "--map-root-user", "--mount", "mount", "-t", "tmpfs", "none", tmp_path]
    if not shutil.which("unshare") or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("this system does not let a program mount a disk of its own")
    assert not findFaults("attacks.py", "run", "more", "--mode=filled", "--every", 75)


def testDamagedInput():
    kinds = ("toml", "grid", "trimem", "stl", "ply", "obj", "off", "vtk", "vtu", "msh", "tsi", "q", "h5", "gltf", "glb")
    assert not findFaults("mutations.py", *kinds, "--count", 100)


def testDamagedResults():
    kinds = ("vtkhdf", "dcd", "psf", "csv", "checkpoint", "system", "integrator", "state")
    assert not findFaults("mutations.py", *kinds, "--count", 100)
