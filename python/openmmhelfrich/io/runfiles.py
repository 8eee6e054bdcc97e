"""The files of a run, found by the name of any of them."""

from pathlib import Path

from ..files import PathLike
from ..geometry.formats import WRITTEN

TRAJECTORY = ".vtkhdf"
# Endings of the configuration, and of all that a run and the commands on it write; of two that a name may have, the
# longer comes first.
_ENDINGS = (
    "_observables.png",
    "_report.html",
    "_shape.png",
    "_plot.png",
    "_path.csv",
    "_path.png",
    ".resolved.toml",
    ".toml",
    ".checkpoint",
    TRAJECTORY,
    ".dcd",
    ".psf",
    ".csv",
    ".png",
    *WRITTEN,
)


def prefixOf(name: PathLike) -> Path:
    """Return the prefix of a run that is named by it, by any of its files, by a configuration of the same name, or by
    the folder that has them alone.

    A name that is none of these is returned as it is.  Raises a ValueError if a folder has several runs.
    """
    path = Path(name)
    if beside(path, ".checkpoint").exists():
        return path
    if path.is_dir():
        runs = sorted(file.with_suffix("") for file in path.glob("*.checkpoint") if not file.name.startswith("."))
        if len(runs) > 1:
            raise ValueError(f"{path} has several runs: {', '.join(map(str, runs[:5]))}; name one of them")
        return runs[0] if runs else path
    for ending in _ENDINGS:
        prefix = path.with_name(path.name.removesuffix(ending))
        if path.name.endswith(ending) and prefix.name and beside(prefix, ".checkpoint").exists():
            return prefix
    return path


def beside(prefix: Path, ending: str) -> Path:
    """Return the file of a run with an ending."""
    return prefix.with_name(prefix.name + ending)


def finalMesh(prefix: Path) -> Path | None:
    """Return the file of the final mesh of a run, or None if there is none."""
    return next((beside(prefix, suffix) for suffix in WRITTEN if beside(prefix, suffix).exists()), None)


def shapesOf(name: PathLike, topology: PathLike | None = None) -> Path:
    """Return the file with the shapes that a name means: itself, if it holds some, and else those of the run that it
    names: the mesh trajectory, or the final mesh.  A DCD file holds shapes if there is a topology.

    Raises a FileNotFoundError if there is neither.
    """
    path, prefix = Path(name), prefixOf(name)
    isWhole = path.suffix.lower() in (TRAJECTORY, ".hdf", *WRITTEN) or topology is not None
    if (isWhole and path.is_file()) or not beside(prefix, ".checkpoint").exists():
        return path
    file = beside(prefix, TRAJECTORY) if beside(prefix, TRAJECTORY).exists() else finalMesh(prefix)
    if file is None:
        raise FileNotFoundError(f"the run {prefix} has neither a mesh trajectory {prefix}{TRAJECTORY} nor a final mesh")
    return file
