from types import SimpleNamespace

import numpy as np
import pytest
from openmm import app, unit

import openmmhelfrich as mh
from openmmhelfrich.io.dcd import TrajectoryReporter

DATE = slice(180, 260)
MESH = mh.Mesh.icosphere(1)
SIMULATION = SimpleNamespace(
    topology=MESH.topology(), currentStep=7, integrator=SimpleNamespace(getStepSize=lambda: 0.003 * unit.picosecond)
)


def stateOf(positions):
    return SimpleNamespace(
        getPositions=lambda asNumpy: positions * unit.nanometer, getPeriodicBoxVectors=lambda asNumpy=False: None
    )


STATES = [stateOf(MESH.vertices * factor) for factor in (1.0, 1 / 3, 2e-8, 7e5)]


def write(reporter, states):
    for state in states:
        reporter.report(SIMULATION, state)


def withoutDate(file):
    content = bytearray(file.read_bytes())
    content[DATE] = bytes(80)
    return content


@pytest.mark.parametrize("interval", [1, 10, 1 << 29])
@pytest.mark.parametrize("kept", [0, 1, 3])
def testTheFileIsOpenMMs(tmp_path, interval, kept):
    """Also if it goes on after some of its frames, and if there are more steps than a header can tell."""
    own, theirs = tmp_path / "own.dcd", tmp_path / "theirs.dcd"
    reporter = TrajectoryReporter(own, interval)
    write(reporter, STATES[:kept])
    size = reporter.sync()
    write(reporter, STATES[:1])
    reporter.close()
    reporter = TrajectoryReporter(own, interval, size)
    write(reporter, STATES[kept:])
    reporter.close()
    reporter = app.DCDReporter(str(theirs), interval)
    write(reporter, STATES)
    del reporter
    assert withoutDate(own) == withoutDate(theirs)
    assert own.read_bytes()[DATE].startswith(b"Written by openmm-helfrich\0")


def testFramesAreThereAtOnce(tmp_path):
    mdtraj = pytest.importorskip("mdtraj")
    reporter = TrajectoryReporter(tmp_path / "a.dcd", 2)
    for i, state in enumerate(STATES[:3], 1):
        reporter.report(SIMULATION, state)
        with mdtraj.formats.DCDTrajectoryFile(str(tmp_path / "a.dcd")) as file:
            assert len(file.read()[0]) == i
    reporter.close()


@pytest.mark.parametrize("value", [np.nan, np.inf])
def testPositionsAreFinite(tmp_path, value):
    reporter = TrajectoryReporter(tmp_path / "a.dcd", 2)
    reporter.report(SIMULATION, STATES[0])
    size = reporter.sync()
    positions = MESH.vertices.copy()
    positions[3, 1] = value
    with pytest.raises(ValueError, match=r"a\.dcd: a position in step 7 is not finite"):
        reporter.report(SIMULATION, stateOf(positions))
    assert reporter.sync() == size
    reporter.close()


def testWhatIsNoWholeFrame(tmp_path):
    reporter = TrajectoryReporter(tmp_path / "a.dcd", 2)
    reporter.report(SIMULATION, STATES[0])
    size = reporter.sync()
    reporter.close()
    with pytest.raises(ValueError, match="does not hold whole frames up to byte"):
        TrajectoryReporter(tmp_path / "a.dcd", 2, size - 4)
