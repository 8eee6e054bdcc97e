"""The files that a run writes."""
import os
from dataclasses import dataclass
from pathlib import Path


@dataclass
class Outputs:
    """The files that a run writes, all of which begin with its prefix."""
    trajectory: Path
    topology: Path
    table: Path
    mesh: Path
    plot: Path
    picture: Path

    @classmethod
    def of(cls, config):
        """Return the names that a Config asks for, or raise a ValueError if its prefix is only a folder."""
        if Path(config.output.prefix+"x").stem == "x":
            raise ValueError(f"[output] prefix is '{config.output.prefix}'; the first part of the files' names must follow the folder")
        endings = (".dcd", ".psf", ".csv", "."+config.output.mesh_format, "_observables.png", "_shape.png")
        return cls(*(Path(config.output.prefix+ending) for ending in endings))

    def paths(self):
        """Return all paths."""
        return list(vars(self).values())

    def prepare(self, source, overwrite=False):
        """Make sure that every file can be written, and create their folder, before the first is opened.

        Raises FileExistsError if one exists already and is not to be overwritten, or is the mesh file that the run reads, and
        another OSError if their folder does not take files.
        """
        if any(path.exists() and path.samefile(source) for path in self.paths()):
            raise FileExistsError(f"the results would replace the mesh file {source}; choose another output prefix or mesh_format")
        existing = [path for path in self.paths() if path.exists()]
        if existing and not (overwrite and all(path.is_file() for path in existing)):
            raise FileExistsError(f"{', '.join(map(str, existing))} exist{'s' if len(existing) == 1 else ''} already; "
                                  "choose another output prefix, or ask to overwrite files")
        folder = self.table.parent
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError):
            raise NotADirectoryError(f"{folder} is not a folder; choose another output prefix") from None
        for path in [folder]+existing:
            if not os.access(path, os.W_OK):
                raise PermissionError(f"{path} is not writable; choose another output prefix")
