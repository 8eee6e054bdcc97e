"""How much memory a run takes, before it begins.

What is compared with what is there is the least that was measured (docs/explanation/safety.md), so that nothing is
refused that would have gone well.
"""

import resource
from pathlib import Path

# In bytes: what is loaded when pictures are drawn, and what a vertex adds at the most, which is then.
PICTURES_LIBRARY, VERTEX = 40e6, 5000


def requireMemory(numVertices: int) -> None:
    """Raise a ValueError if there is not the memory that so many vertices take."""
    needed, free = PICTURES_LIBRARY + VERTEX * numVertices, _freeMemory()
    if needed > free:
        raise ValueError(
            f"a run of {numVertices} vertices takes about {sizeText(needed)} of memory, and {sizeText(free)} are free; "
            "take a mesh of fewer vertices"
        )


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


def sizeText(size: float) -> str:
    """Return a number of bytes, in GB or MB."""
    return f"{size / 1e9:.1f} GB" if size >= 1e8 else f"{size / 1e6:.1f} MB"
