"""Mesh trajectories on disks that fail and in programs that are killed, at each operation on the disk in turn."""

import errno
import gzip
import os
import pickle
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import openmmhelfrich as mh
from openmmhelfrich import files
from openmmhelfrich.io import drafts
from openmmhelfrich.io.vtkhdf import MeshTrajectoryWriter
from test_mesh_trajectory import same, simulate

MESH = mh.Mesh.icosphere(0)


def createFrame(step):
    random = np.random.default_rng(step)
    mesh = mh.Mesh(MESH.vertices + 0.1 * random.random(MESH.vertices.shape), MESH.triangles)
    return mh.MeshFrame(step, mesh, {"Area": random.random(12, dtype=np.float32)})


def framesOf(file):
    """Return all frames of a file, which must be those of the first steps, to the last bit."""
    with mh.readMeshTrajectory(file) as trajectory:
        found = trajectory[:]
    assert all(same(frame, createFrame(step)) for step, frame in enumerate(found))
    return found


CHANGES = ("fsync", "replace", "link", "open", "close")


class Disk:
    """Counts what drafts and files do on the disk, and calls `fail(operation, *arguments)` instead of the n-th.

    Nothing waits for it.
    """

    def __init__(self, monkeypatch, n=0, fail=None, counted=CHANGES):
        self.count, self.bytes, self._n, self._fail, self._counted = 0, 0, n, fail, counted
        for module in (drafts, files):
            monkeypatch.setattr(module, "os", self)
            monkeypatch.setattr(module, "open", self._openFile, raising=False)
        monkeypatch.setattr(drafts, "shutil", self)

    def __getattr__(self, name):
        function = (lambda _: None) if name == "fsync" else getattr(os, name)
        return (lambda *arguments: self.call(function, *arguments)) if name in self._counted else function

    def copyfile(self, *arguments):
        return self.call(shutil.copyfile, *arguments)

    def call(self, function, *arguments):
        self.count += 1
        return self._fail(function, *arguments) if self.count == self._n else function(*arguments)

    def _openFile(self, *arguments, **options):
        return DiskFile(self, self.call(lambda *_: open(*arguments, **options)))


class DiskFile:
    """A file on such a disk."""

    def __init__(self, disk, file):
        self._disk, self._file, self.fileno, self.seek = disk, file, file.fileno, file.seek

    def write(self, data):
        self._disk.bytes += len(data)
        return self._disk.call(self._file.write, data)

    def truncate(self, size):
        return self._disk.call(self._file.truncate, size)

    def flush(self):
        return self._disk.call(self._file.flush)

    def close(self):
        if not self._file.closed:
            self._file.close()
            self._disk.call(lambda *_: None)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def failWith(number):
    """Return what fails with an error, half done if it is a write."""

    def fail(function, *arguments):
        if getattr(function, "__name__", "") == "write":
            function(arguments[0][: len(arguments[0]) // 2])
        raise OSError(number, os.strerror(number))

    return fail


def write(file, counted=lambda count: None):
    """Write a trajectory, cut it, and go on from there, as a run does that is resumed."""
    goOn(file, 0, counted, 3)
    goOn(file, 2, counted)


def goOn(file, count, counted=lambda count: None, end=4):
    writer = MeshTrajectoryWriter(file, numFrames=count)
    for step in range(count, end):
        writer._waiting.append(createFrame(step))
        writer.flush()
        counted(writer.numFrames)
    writer.close()


def numOperations(work, *arguments, counted=CHANGES):
    with pytest.MonkeyPatch.context() as patch:
        disk = Disk(patch, counted=counted)
        work(*arguments)
    return disk.count


@pytest.mark.parametrize("number", [errno.EIO, errno.ENOSPC])
def testErrorsOfTheWriter(tmp_path, monkeypatch, number):
    """After an error the file has every frame that was counted, and the same writer goes on when there is none."""
    file, told = tmp_path / "a", 0
    for n in range(1, numOperations(goOn, file, 0) + 1):
        writer = MeshTrajectoryWriter(file)
        counted = 0
        with monkeypatch.context() as patch:
            Disk(patch, n, failWith(number))
            try:
                for step in range(4):
                    writer._waiting.append(createFrame(step))
                    writer.flush()
                    counted = step + 1
            except OSError as error:
                assert f"{file} cannot be written: " in str(error) and os.strerror(number) in str(error)
                told += 1
        assert counted == 0 or len(framesOf(file)) >= counted
        writer.close()
        assert len(framesOf(file)) == writer.numFrames and os.listdir(tmp_path) == ["a"]
    assert told > 0.9 * n  # there is another way without links


@pytest.mark.parametrize("counted, every", [(CHANGES, 1), (("pread",), 7)])
def testErrorsWhereItGoesOn(tmp_path, monkeypatch, counted, every):
    start, file, told = tmp_path / "start", tmp_path / "a", 0
    mh.writeMeshTrajectory(start, map(createFrame, range(3)))
    shutil.copyfile(start, file)
    numbers = range(1, numOperations(goOn, file, 2, counted=counted) + 1, every)
    for n in numbers:
        shutil.copyfile(start, file)
        counts = [2]
        with monkeypatch.context() as patch:
            Disk(patch, n, failWith(errno.EIO), counted)
            try:
                goOn(file, 2, counts.append)
            except (OSError, ValueError) as error:
                assert "Input/output error" in str(error)
                told += 1
        assert len(framesOf(file)) >= counts[-1]
        goOn(file, counts[-1])
        assert len(framesOf(file)) == 4 and sorted(os.listdir(tmp_path)) == ["a", "start"]
    assert told > 0.9 * len(numbers)


def testKilledAtEachOperation(tmp_path):
    """The file has every frame that was counted before the program ended, and goes on from there.

    It ends in the midst of a write, or before another operation.
    """

    def kill(function, *arguments):
        if getattr(function, "__name__", "") == "write":
            function(arguments[0][: len(arguments[0]) // 2])
            function.__self__.flush()
        os._exit(9)

    file, count = tmp_path / "a", tmp_path / "count"
    for n in range(1, numOperations(write, file) + 1):
        file.unlink()
        count.write_text("0")
        child = os.fork()
        if child == 0:
            try:
                Disk(pytest.MonkeyPatch(), n, kill)
                write(file, lambda number: count.write_text(str(number)))
            finally:
                os._exit(1)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9
        counted = int(count.read_text())
        if counted:
            assert len(framesOf(file)) >= counted
        goOn(file, counted)
        assert len(framesOf(file)) == 4 and sorted(os.listdir(tmp_path)) == ["a", "count"]


def testErrorsOfASingleStep(tmp_path, monkeypatch):
    """A file that is written at once is the old one, to the last byte, or the new one."""
    file = tmp_path / "a"
    mh.writeMeshTrajectory(file, [createFrame(0)])
    old = file.read_bytes()

    def replace():
        mh.writeMeshTrajectory(file, map(createFrame, range(3)))

    told = []
    for n in range(1, numOperations(replace) + 1):
        file.write_bytes(old)
        with monkeypatch.context() as patch:
            Disk(patch, n, failWith(errno.EIO))
            try:
                replace()
            except OSError as error:
                told.append(str(error))
                assert "Input/output error" in str(error)
        assert file.read_bytes() == old or len(framesOf(file)) == 3
        assert os.listdir(tmp_path) == ["a"]
    assert len(told) > 0.9 * n


def testErrorsOfTheReporter(tmp_path, monkeypatch):
    """A run whose reporter fails goes on from its checkpoint to the same frames."""
    sphere = mh.Mesh.icosphere(1)

    def simulateFrom(checkpoint, count):
        simulation, force = simulate(sphere)
        if checkpoint:
            simulation.context.loadCheckpoint(checkpoint)
        reporter = mh.MeshReporter(tmp_path / "a", 1, force, append=count > 0, numFrames=count or None)
        simulation.reporters.append(reporter)
        return simulation, reporter

    def work(saved):
        simulation, reporter = simulateFrom(*saved[-1])
        while simulation.currentStep < 3:
            simulation.step(1)
            reporter.flush()
            saved.append((simulation.context.createCheckpoint(), reporter.getNumFrames()))
        reporter.close()

    total = numOperations(work, [(None, 0)])
    expected = mh.readMeshTrajectory(tmp_path / "a")[:]
    for n in range(1, total + 1, 3):
        (tmp_path / "a").unlink()
        saved = [(None, 0)]
        with monkeypatch.context() as patch:
            Disk(patch, n, failWith(errno.ENOSPC))
            try:
                work(saved)
            except OSError as error:
                assert "No space left on device" in str(error)
        work(saved)
        found = mh.readMeshTrajectory(tmp_path / "a")
        assert all(same(a, b) for a, b in zip(found, expected, strict=True)) and len(os.listdir(tmp_path)) == 1


def testSignalsWithinHDF5(tmp_path, monkeypatch):
    """Ctrl-C while HDF5 writes comes up after it; nothing is lost, and the interpreter ends as it should."""
    original, count = drafts.Draft.write, 0

    def interrupted(self, data):
        nonlocal count
        count += 1
        os.kill(os.getpid(), signal.SIGINT)
        original(self, data)

    writer = MeshTrajectoryWriter(tmp_path / "a")
    writer.add(createFrame(0))
    writer.add(createFrame(1))
    with monkeypatch.context() as patch:
        patch.setattr(drafts.Draft, "write", interrupted)
        before = signal.signal(signal.SIGINT, signal.default_int_handler)  # what runs in the background has none
        with pytest.raises(KeyboardInterrupt):
            writer.flush()
    signal.signal(signal.SIGINT, before)
    assert count > 10 and len(framesOf(tmp_path / "a")) == 1
    writer.close()
    assert len(framesOf(tmp_path / "a")) == 2


def testReaderWhileTheFileGrows(tmp_path):
    """A trajectory that is open reads the frames that it had, though their file is changed meanwhile."""
    writer = MeshTrajectoryWriter(tmp_path / "a")
    for step in range(70):
        writer.add(createFrame(step))
    writer.flush()
    trajectory = mh.readMeshTrajectory(tmp_path / "a")
    for step in range(70, 400):
        writer.add(createFrame(step))
        if step % 20 == 0:
            writer.flush()
            assert len(trajectory) == 70 and same(trajectory[step % 70], createFrame(step % 70))
    writer.close()
    assert all(same(frame, createFrame(step)) for step, frame in enumerate(trajectory))


def testFileOfAnEarlierVersion(tmp_path):
    """What version 0.1.0 wrote is read, and goes on."""
    content = gzip.decompress((Path(__file__).parent / "data" / "trajectory-0.1.0.vtkhdf.gz").read_bytes())
    (tmp_path / "a").write_bytes(content)
    assert len(framesOf(tmp_path / "a")) == 3
    goOn(tmp_path / "a", 2)
    assert len(framesOf(tmp_path / "a")) == 4 and mh.readMeshTrajectory(tmp_path / "a").lengthUnit == "um"


@pytest.mark.parametrize("hasLinks", [True, False])
def testOtherNamesOfTheFile(tmp_path, monkeypatch, hasLinks):
    """What has a second name, such as a backup, is not changed; and there are disks without such names."""
    if not hasLinks:
        monkeypatch.setattr(drafts.os, "link", failWith(errno.EPERM))
    file = tmp_path / "a"
    writer = MeshTrajectoryWriter(file)
    for step in range(6):
        writer.add(createFrame(step))
        writer.flush()
        if hasLinks and step % 2 == 0:
            (tmp_path / f"backup{step}").hardlink_to(file)
    writer.close()
    assert len(framesOf(file)) == 6
    assert [len(framesOf(tmp_path / f"backup{step}")) for step in (0, 2, 4) if hasLinks] == [1, 3, 5][: 3 * hasLinks]


def testWhatAFlushWritesDoesNotGrow(tmp_path, monkeypatch):
    writer, sizes = MeshTrajectoryWriter(tmp_path / "a"), {}
    for length in (20, 1500):
        while writer.numFrames < length:
            writer._waiting.append(createFrame(writer.numFrames))
        for _ in range(2):
            writer.flush()
            writer._waiting.append(createFrame(writer.numFrames))
        with monkeypatch.context() as patch:
            disk = Disk(patch)
            writer.flush()
        sizes[length] = disk.bytes
    assert (tmp_path / "a").stat().st_size > 9e5 and sizes[1500] < sizes[20] + 40000
    writer.close()


DAMAGED = """
import faulthandler, pickle, resource, signal, sys, openmmhelfrich as mh
from openmmhelfrich.io.vtkhdf import MeshTrajectoryWriter
import test_drafts
resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
faulthandler.register(signal.SIGPROF, chain=True)
contents = pickle.load(sys.stdin.buffer)
for content in contents:
    signal.setitimer(signal.ITIMER_PROF, 5)  # of computing: others may have the processor
    open(sys.argv[1], "wb").write(content)
    try:
        with mh.readMeshTrajectory(sys.argv[1]) as trajectory:
            [trajectory[i] for i in (0, len(trajectory) // 2, -1)]
        writer = MeshTrajectoryWriter(sys.argv[1], numFrames=None)
        writer.add(test_drafts.createFrame(70))
        writer.close()
    except (ValueError, IndexError, OSError) as error:
        print(str(error).splitlines()[0])
    else:
        print("fine")
# What getrusage says is at least what the process that started this one held.
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""


def damaged(content, random):
    """Return bytes of which some are others, or which end early."""
    kind, content = random.integers(4), bytearray(content)
    if kind == 0:
        return bytes(content[: random.integers(len(content))])
    for _ in range(random.choice([1, 1, 2, 8])):
        place = random.integers(random.choice([4096, len(content) - 8]))
        if kind == 1:
            content[place] ^= 1 << random.integers(8)
        elif kind == 2:
            content[place] = random.integers(256)
        else:
            claim = random.choice([0, 1, 10**9, 2**31, 2**63 - 1, len(content)])
            content[place & ~7 : (place & ~7) + 8] = int(claim).to_bytes(8, "little")
    return bytes(content)


def testDamagedFiles(tmp_path):
    """Each gives a sentence, or the frames and room for another, within seconds and bounded memory."""
    mh.writeMeshTrajectory(tmp_path / "good", map(createFrame, range(70)))
    content, random = (tmp_path / "good").read_bytes(), np.random.default_rng(1)
    contents = [content] + [damaged(content, random) for _ in range(500)]
    script = f"import sys; sys.path.insert(0, {os.path.dirname(__file__)!r})\n{DAMAGED}"
    done = subprocess.run(
        [sys.executable, "-c", script, tmp_path / "a"], input=pickle.dumps(contents), capture_output=True
    )
    assert done.returncode == 0, done.stderr.decode()
    first, *lines, memory = done.stdout.decode().splitlines()
    assert first == "fine" and len(lines) == 500 and int(memory) < 1e6
    assert 100 < lines.count("fine") < 400 and all(line == "fine" or f"{tmp_path}/a " in line for line in lines)
