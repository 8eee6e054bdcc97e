"""How much memory a run takes, and how much room on the disk, before it begins.

What is compared with what is there are the least that was measured (docs/explanation/safety.md), so that nothing is
refused that would have gone well.
"""

import resource
import shutil
from pathlib import Path

from ..files import PathLike
from .config import Config
from .outputs import Outputs
from .scene import Scene

# Of memory, in bytes: what is loaded when pictures are drawn, and what a vertex adds at the most, which is then.
PICTURES_LIBRARY, VERTEX = 40e6, 5000
# Of the disk, in bytes: a vertex in a frame of each trajectory, and in the files that are there once (of a checkpoint
# there are two while one takes the place of the other); a row of the table; pictures.
DCD_FRAME, MESH_FRAME, SINGLE_FILES, PSF, ROW, PICTURES = 12, 30, 226, 149, 250, 200e3


def requireRoom(scene: Scene, outputs: Outputs, step: int = 0) -> None:
    """Raise a ValueError if the memory, or the room on the disk, is not enough for a run from some step on.

    Files that the run replaces count as room.
    """
    numVertices = len(scene.mesh.vertices)
    requireMemory(numVertices)
    replaced = sum(path.stat().st_size for path in outputs.paths() if path.is_file()) if step == 0 else 0
    requireDisk(diskSize(scene.config, numVertices, step) - replaced, outputs.table.parent)


def requireMemory(numVertices: int) -> None:
    """Raise a ValueError if there is not the memory that so many vertices take."""
    needed, free = PICTURES_LIBRARY + VERTEX * numVertices, _freeMemory()
    if needed > free:
        raise ValueError(
            f"a run of {numVertices} vertices takes about {_text(needed)} of memory, and {_text(free)} are free; take "
            "a mesh of fewer vertices"
        )


def requireDisk(size: float, folder: PathLike) -> None:
    """Raise a ValueError if there is not so much room where a folder is, or will be."""
    place = Path(folder).absolute()
    while not place.exists():
        place = place.parent
    disk = shutil.disk_usage(place)
    if size > disk.free and disk.total > 0:  # else it is no disk
        raise ValueError(
            f"the results take at least {_text(size)}, and {_text(disk.free)} are free in {place}; ask for fewer "
            "frames by a longer trajectory_interval, or leave out the mesh_trajectory"
        )


def diskSize(config: Config, numVertices: int, step: int = 0) -> float:
    """Return how many bytes the results of a resolved Config take from some step on, at least."""
    output, steps = config.output, sum(stage.totalSteps for stage in config.stages)

    def count(interval: int) -> int:
        return steps // interval - step // interval

    frames = count(output.trajectory_interval)
    size = frames * DCD_FRAME * numVertices + count(output.observables_interval) * ROW
    if output.mesh_trajectory:  # of which a second copy lies beside it while it grows
        size += (frames + steps // output.trajectory_interval) * MESH_FRAME * numVertices
    once = SINGLE_FILES + (PSF if output.psf else 0)
    return size + (once * numVertices + PICTURES if step == 0 else 0)


def _freeMemory() -> float:
    """Return how many bytes this process can still have; infinity where the system does not tell."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    free = float("inf") if limit == resource.RLIM_INFINITY else limit - _kilobytes("/proc/self/status", "VmSize") * 1024
    available = _kilobytes("/proc/meminfo", "MemAvailable") + _kilobytes("/proc/meminfo", "SwapFree")
    return min(free, available * 1024 or float("inf"), _freeInContainer())


def _freeInContainer() -> float:
    """Return how many bytes a container leaves; infinity without a limit."""
    folder = Path("/sys/fs/cgroup")
    try:
        return int((folder / "memory.max").read_text()) - int((folder / "memory.current").read_text())
    except (OSError, ValueError):
        return float("inf")


def _kilobytes(file: str, name: str) -> int:
    """Return a number of a file of the system; 0 if it is not there."""
    try:
        lines = Path(file).read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith(name + ":")), 0)


def _text(size: float) -> str:
    return f"{size / 1e9:.1f} GB" if size >= 1e8 else f"{size / 1e6:.1f} MB"
