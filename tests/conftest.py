import os
import signal
from pathlib import Path

# Tests have small meshes, which one thread serves best, also beside other work.
os.environ.setdefault("OPENMM_CPU_THREADS", "1")

import numpy as np
import pytest

import openmmhelfrich as mh
from membranes import flipped

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session", autouse=True)
def hearingCtrlC():
    """Jobs in the background of a script do not get Ctrl-C, nor would the programs that tests start."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def sphere():
    return mh.Mesh.icosphere(2)


@pytest.fixture
def inFolder(tmp_path, monkeypatch):
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def examples():
    return ROOT / "examples"


@pytest.fixture(scope="module")
def frames():
    """Six frames with different positions and triangles."""
    mesh = mh.Mesh.icosphere(2)
    return [mh.meshFrame(10 * i, flipped(mesh, i, seed=i + 1)) for i in range(6)]


def together(*meshes):
    """Return several meshes as one."""
    start = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    return mh.Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.triangles + first for mesh, first in zip(meshes, start)]),
    )
