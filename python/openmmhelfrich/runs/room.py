"""How much room a run takes on the disk, before it begins, and whether it and the memory are there.

What is compared with what is there are the least that was measured (docs/explanation/safety.md), so that nothing is
refused that would have gone well.
"""

import shutil
from pathlib import Path

from ..files import PathLike
from .config import Config
from .memory import requireMemory, sizeText
from .outputs import Outputs
from .scene import Scene

# In bytes: a vertex in a frame of each trajectory, and in the files that are there once (of a checkpoint there are two
# while one takes the place of the other); a row of the table; pictures.
DCD_FRAME, MESH_FRAME, SINGLE_FILES, PSF, ROW, PICTURES = 12, 30, 192, 149, 250, 200e3


def requireRoom(scene: Scene, outputs: Outputs, step: int = 0) -> None:
    """Raise a ValueError if the memory, or the room on the disk, is not enough for a run from some step on.

    Files that the run replaces count as room.
    """
    numVertices = len(scene.mesh.vertices)
    requireMemory(numVertices)
    replaced = sum(path.stat().st_size for path in outputs.paths() if path.is_file()) if step == 0 else 0
    requireDisk(diskSize(scene.config, numVertices, step) - replaced, outputs.table.parent)


def requireDisk(size: float, folder: PathLike) -> None:
    """Raise a ValueError if there is not so much room where a folder is, or will be."""
    place = Path(folder).absolute()
    while not place.exists():
        place = place.parent
    disk = shutil.disk_usage(place)
    if size > disk.free and disk.total > 0:  # else it is no disk
        raise ValueError(
            f"the results take at least {sizeText(size)}, and {sizeText(disk.free)} are free in {place}; ask for fewer "
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
