"""Two programs never write the files of one prefix, and no lock outlives its holder."""

import errno
import fcntl
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import mdtraj
import numpy as np
import pytest

import openmmhelfrich as mh
from openmmhelfrich.io import locks
from openmmhelfrich.io.conversion import convert
from openmmhelfrich.io.locks import InUseError, locked, lockOf
from openmmhelfrich.runs.studies import resume, run

CONFIG = """
mesh.icosphere = 1
platform.threads = 1
sampling = {seed = 3, steps = STEPS, steps_per_trajectory = 5}
output = {trajectory_interval = 7, observables_interval = 3, checkpoint_interval = 20, mesh_trajectory = false}
"""
HOLD = """
import sys, time
from openmmhelfrich.io.locks import locked
with locked(sys.argv[1]):
    print("locked", flush=True)
    time.sleep(60)
"""
COUNT = """
import sys, time
from openmmhelfrich.io.locks import locked
for _ in range(40):
    with locked("count", 60):
        with open("number") as file:
            number = int(file.read())
        time.sleep(0.001)
        with open("number", "w") as file:
            file.write(str(number + 1))
"""


@pytest.fixture
def holder(tmp_path):
    """A process that holds the lock of a prefix."""
    process = subprocess.Popen([sys.executable, "-c", HOLD, tmp_path / "a"], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "locked\n"
    yield process
    process.kill()
    process.wait()


@pytest.fixture
def noLocks(monkeypatch):
    """A file system without locks."""

    def flock(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", flock)


def leave(prefix, **changes):
    """Leave the lock of a holder that differs from this process in something."""
    lockOf(prefix).write_text(json.dumps(locks._myself() | changes))


def command(*arguments, folder="."):
    return subprocess.Popen(
        [sys.executable, "-m", "openmmhelfrich.cli", *arguments, "--quiet"],
        cwd=folder,
        stderr=subprocess.PIPE,
        text=True,
    )


def waitUntil(condition):
    end = time.monotonic() + 100
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def compete(first, second):
    """Wait until one of two processes gives way, let the other make some steps, and stop it."""
    waitUntil(lambda: first.poll() is not None or second.poll() is not None)
    loser, winner = (first, second) if first.poll() is not None else (second, first)
    message = loser.stderr.read()
    assert loser.returncode == 1 and message.startswith("openmm-helfrich: ") and "Traceback" not in message
    # The winner has the lock a moment before it has written its name.
    holders = f"process {winner.pid} on {os.uname().nodename}, since 20", "another process;"
    assert any(f"is in use by {holder}" in message for holder in holders), message
    size = os.path.getsize("real/a.csv")
    waitUntil(lambda: os.path.getsize("real/a.csv") > size + 2000)
    winner.send_signal(signal.SIGTERM)
    assert winner.wait() == 128 + signal.SIGTERM, winner.stderr.read()
    assert not lockOf("real/a").exists()


def testTwoRunsAtOnce(inFolder):
    """One goes on as if it were alone, the other says so; whatever the command and the spelling of the prefix."""
    Path("run.toml").write_text(CONFIG.replace("STEPS", "1000000"))
    Path("real").mkdir()
    Path("link").symlink_to("real")
    absolute = str(inFolder / "real" / "a")
    compete(command("run", "run.toml", "--output", "link/a"), command("run", "run.toml", "--output", absolute))
    compete(command("resume", "./real/../link/a"), command("resume", "a", folder="real"))
    compete(command("run", "run.toml", "--output", "link/a", "--overwrite"), command("resume", "real/a"))
    rows, frames = mh.readObservables("real/a.csv")["step"], mdtraj.load_dcd("real/a.dcd", top="real/a.psf")
    assert np.all(np.diff(rows) == 3)
    assert len(frames) in (rows[-1] // 7, (rows[-1] + 2) // 7)  # the run ends up to two steps after its last row


def testPrefixesInOneFolder(inFolder):
    """They do not disturb each other."""
    Path("run.toml").write_text(CONFIG.replace("STEPS", "100"))
    processes = [command("run", "run.toml", "--accept-anything", "--output", f"out/{name}") for name in ("a", "a.b")]
    assert [process.wait() for process in processes] == [0, 0], [process.stderr.read() for process in processes]
    assert Path("out/a.csv").read_bytes() == Path("out/a.b.csv").read_bytes()
    assert Path("out/a.dcd").read_bytes() == Path("out/a.b.dcd").read_bytes()


def testPythonFunctions(tmp_path, holder):
    config = {"mesh": {"icosphere": 1}, "sampling": {"steps": 2}, "output": {"prefix": str(tmp_path / "a")}}
    with pytest.raises(InUseError, match=f"a is in use by process {holder.pid} on .*; wait for its end"):
        run(config)
    assert [path.name for path in tmp_path.iterdir()] == [".a.lock"]
    (tmp_path / "a.checkpoint").write_bytes(b"")
    with pytest.raises(InUseError):
        resume(tmp_path / "a")
    with pytest.raises(InUseError):
        mh.tradeoff.tradeoff({"mesh": {"icosphere": 1}}, tmp_path / "a")
    mh.Mesh.icosphere(1).write(tmp_path / "mesh.ply")
    with pytest.raises(InUseError):
        convert(tmp_path / "mesh.ply", tmp_path / "a.vtkhdf")
    assert not (tmp_path / "a.vtkhdf").exists() and (tmp_path / "a.checkpoint").read_bytes() == b""


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError, SystemExit])
def testNoLockStaysAfterAnError(tmp_path, error):
    def stop(study):
        raise error

    config = {"mesh": {"icosphere": 1}, "sampling": {"steps": 2}, "output": {"prefix": str(tmp_path / "a")}}
    if error is KeyboardInterrupt:
        assert run(config, stop).interrupted
    else:
        with pytest.raises(error):
            run(config, stop)
    with pytest.raises(FileExistsError, match="exist already"):
        run(config)
    assert not lockOf(tmp_path / "a").exists()


def testHolderThatIsKilled(tmp_path, holder):
    with pytest.raises(InUseError), locked(tmp_path / "a", seconds=0.3):
        pass
    holder.kill()
    holder.wait()
    assert lockOf(tmp_path / "a").exists()  # what it left is no lock
    with locked(tmp_path / "a"), pytest.raises(InUseError):
        assert json.loads(lockOf(tmp_path / "a").read_text())["process"] == os.getpid()
        inThread(tmp_path / "a")
    assert not lockOf(tmp_path / "a").exists()


def inThread(prefix):
    """Take a lock in another thread."""
    errors = []

    def take():
        try:
            with locked(prefix):
                pass
        except InUseError as error:
            errors.append(error)

    thread = threading.Thread(target=take)
    thread.start()
    thread.join()
    if errors:
        raise errors[0]


def testThreads(tmp_path):
    """A thread that holds a lock may take it again, and keeps it; another may not."""
    with locked(tmp_path / "a"):
        with locked(tmp_path / "a"):
            pass
        with pytest.raises(InUseError):
            inThread(tmp_path / "a")
        inThread(tmp_path / "b")
    inThread(tmp_path / "a")


@pytest.mark.parametrize("hasLocks", [True, False])
def testNobodyIsInTwice(inFolder, hasLocks):
    """Processes that take turns at a lock never lose a count, nor if they find that of a dead process first."""
    Path("number").write_text("0")
    if hasLocks:
        leave("count", process=2**22 + 1)
    program = COUNT if hasLocks else NO_LOCKS + COUNT
    processes = [subprocess.Popen([sys.executable, "-c", program]) for _ in range(3)]
    assert [process.wait() for process in processes] == [0, 0, 0]
    assert Path("number").read_text() == "120" and not lockOf("count").exists()


NO_LOCKS = """
import errno, fcntl
def flock(*_):
    raise OSError(errno.ENOSYS, "Function not implemented")
fcntl.flock = flock
"""


def testHolderOnAHostThatLocksReach(tmp_path):
    """The file system says that it is gone."""
    leave(tmp_path / "a", host="elsewhere", boot="another")
    with locked(tmp_path / "a"):
        pass


def testHolderOnAHostThatLocksDoNotReach(tmp_path, monkeypatch):
    monkeypatch.setattr(locks, "_reachesAllHosts", lambda file: False)
    leave(tmp_path / "a", host="elsewhere", boot="another", since="2026-01-02 03:04:05 UTC", process=77)
    with pytest.raises(
        FileExistsError,
        match=r"a is in use by process 77 on elsewhere, since 2026-01-02 03:04:05 UTC, as .*\.a\.lock says, and locks "
        r"do not tell here whether it still is; if it has ended, delete .*\.a\.lock",
    ):
        run({"mesh": {"icosphere": 1}, "output": {"prefix": str(tmp_path / "a")}})
    lockOf(tmp_path / "a").unlink()
    leave(tmp_path / "a")  # of this host
    with locked(tmp_path / "a"):
        pass


@pytest.mark.parametrize(
    "changes, error",
    [
        ({}, InUseError),
        ({"process": 2**22 + 1}, None),  # larger than any
        ({"started": ["17"]}, None),  # the number is another process's now
        ({"boot": "another"}, None),
        ({"processes": "pid:[1]", "host": "container"}, FileExistsError),
        ({"boot": "another", "host": "elsewhere"}, FileExistsError),
    ],
)
def testWithoutLocks(tmp_path, noLocks, changes, error):
    leave(tmp_path / "a", **changes)
    if error:
        with pytest.raises(error), locked(tmp_path / "a"):
            pass
        assert lockOf(tmp_path / "a").exists()
    else:
        with locked(tmp_path / "a"), pytest.raises(InUseError):
            inThread(tmp_path / "a")
        assert not lockOf(tmp_path / "a").exists()


MOUNTS = r"""
22 1 8:1 / / rw,relatime shared:1 - ext4 /dev/sda1 rw
30 22 0:40 / /home rw shared:2 - nfs4 server:/home rw,vers=4.2,local_lock=none,addr=10.0.0.1
31 22 0:41 / /old rw - nfs server:/old rw,vers=3,nolock,local_lock=all
32 22 0:42 / /work rw - lustre mds@tcp:/work rw,flock,lazystatfs
33 22 0:43 / /scratch rw - lustre mds@tcp:/scratch rw,localflock
34 22 0:44 / /mnt/my\040disk rw - fuse.sshfs me@there: rw,user_id=0
35 34 0:45 / /mnt/my\040disk/in rw master:1 propagate_from:2 - xfs /dev/sdb rw
"""


@pytest.mark.parametrize(
    "file, isReached",
    [
        ("/tmp/a", True),
        ("/home/me/a", True),
        ("/homely/a", True),
        ("/old/a", False),
        ("/work/a", True),
        ("/scratch/a", False),
        ("/mnt/my disk/a", False),
        ("/mnt/my disk/in/a", True),
    ],
)
def testMounts(monkeypatch, file, isReached):
    monkeypatch.setattr(locks, "_text", lambda name: MOUNTS.strip())
    assert locks._reachesAllHosts(Path(file)) == isReached


def testFolderThatDoesNotWork(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"there is no folder .*nowhere"), locked(tmp_path / "nowhere" / "a"):
        pass
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="file"), locked(tmp_path / "file" / "a"):
        pass
    lockOf(tmp_path / "a").mkdir()
    with pytest.raises(OSError, match=r"\.a\.lock cannot be written \(Is a directory\)"), locked(tmp_path / "a"):
        pass


def testFullDisk(tmp_path, monkeypatch):
    def pwrite(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "pwrite", pwrite)
        with pytest.raises(OSError, match=r"\.a\.lock cannot be written \(No space left"), locked(tmp_path / "a"):
            pass
    assert not lockOf(tmp_path / "a").exists()
    with locked(tmp_path / "a"):
        pass


def testErrorsWhileALockIsClosedDoNoHarm(tmp_path, monkeypatch):
    close = os.close

    def fail(descriptor):
        close(descriptor)
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    with monkeypatch.context() as patch, locked(tmp_path / "a"):
        patch.setattr(os, "close", fail)
    assert not lockOf(tmp_path / "a").exists()
    with locked(tmp_path / "a"):
        assert lockOf(tmp_path / "a").exists()
