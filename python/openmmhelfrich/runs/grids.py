"""Grids of runs: a configuration, and the values that some of its keys take, each with each.

A grid is a TOML file with a configuration, ``base``, which is a file's name or a table, and lists of values by the
names of keys::

    base = "vesicle.toml"
    seeds = 2
    [grid]
    membrane.reduced_volume = {start = 0.5, stop = 0.9, step = 0.1}
    stages.cool.end_temperature = [3, 30]

Tables ``[variants.NAME]`` are one more axis: each is a part of a configuration, which takes the place of the base's
keys.  Where it, or an axis, gives one of two keys that exclude each other (file and icosphere, target_volume and
reduced_volume), it takes the place of the other one, too.  The value "unset" takes a key of the base away.
"""

import copy
import hashlib
import itertools
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, ValidationError, ValidationInfo, field_validator, model_validator
from pydantic_core import ErrorDetails

from ..files import PathLike
from ..geometry.mesh import Mesh
from ..messages import quoted, shortened
from .config import Config, anchored, asWritten, nearest, parseConfig, readTOML, requirement
from .effects import requireEffect
from .memory import requireMemory
from .meshsource import loadMesh
from .readiness import Coarse, coarseness
from .room import diskSize
from .scene import Scene
from .sections import Section
from .stages import checkStages

MOST_POINTS = 100_000
# What a variant may give instead of a value, to have a key at its default.
UNSET = "unset"
# Keys that exclude each other.
_ALTERNATIVES = {
    "file": "icosphere",
    "icosphere": "file",
    "target_volume": "reduced_volume",
    "reduced_volume": "target_volume",
}
_RANGE = "a list of values, or a table of start, stop and step"


@dataclass(frozen=True)
class GridPoint:
    """One run of a grid.

    Attributes
    ----------
    name : str
        what tells it from the others, fit for a folder's name
    parameters : dict
        its place in the grid: values by the short names of the axes
    config : Config
        what to do.  Its seed follows from the point's name, so that neither the order of points nor their number
        matters
    diskSize : float
        how many bytes its results take, at least
    coarse : sequence of Coarse
        the surfaces that have too few vertices for where their targets lead
    """

    name: str
    parameters: dict
    config: Config
    diskSize: float = 0.0
    coarse: Sequence[Coarse] = ()


class Range(Section):
    """Equal steps from start to stop, which is among the values if a whole number of steps leads there."""

    start: int | float
    stop: int | float
    step: int | float

    @model_validator(mode="after")
    def _count(self) -> "Range":
        if self.step == 0 or (self.stop - self.start) / self.step < 0:
            raise ValueError(f"leads from {self.start} to {self.stop} by steps of {self.step}, which never arrive")
        if (self.stop - self.start) / self.step >= MOST_POINTS:
            raise ValueError(f"has more than {MOST_POINTS} values")
        return self

    def values(self) -> list[int | float]:
        """Return the values, without the rounding errors of sums."""
        count = math.floor((self.stop - self.start) / self.step * (1 + 1e-12) + 1e-9) + 1
        return [
            value if isinstance(value, int) else round(value, 12)
            for value in (self.start + i * self.step for i in range(count))
        ]


def _axes(tables: Any) -> dict[str, list[Any]]:
    """Return the values of each axis by its key, "section.key", of nested tables."""
    if not isinstance(tables, dict):
        raise ValueError("it must be a table")
    return {key: _valuesOf(key, value) for key, value in _flat(tables)}


def _flat(tables: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in tables.items():
        if (
            isinstance(value, dict)
            and value
            and not any(key in Range.model_fields and not isinstance(part, dict) for key, part in value.items())
        ):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def _valuesOf(key: str, value: Any) -> list[Any]:
    if isinstance(value, dict):
        try:
            value = Range.model_validate(value).values()
        except ValidationError as error:
            raise ValueError(f"{key} {_explainRange(error.errors()[0])}") from None
    if not isinstance(value, list) or not value:
        raise ValueError(f"{key} is {quoted(value)}; it must be {_RANGE}")
    texts = [_text(v) for v in value]
    twice = next((text for i, text in enumerate(texts) if text in texts[:i]), None)
    if twice is not None:
        raise ValueError(f"{key} has the value {shortened(twice)} twice")
    return value


def _explainRange(mistake: ErrorDetails) -> str:
    if mistake["type"] == "extra_forbidden":
        return f"has no key '{mistake['loc'][0]}'{nearest(mistake['loc'][0], Range.model_fields)}"
    if mistake["type"] == "missing":
        return f"has no {mistake['loc'][0]}; it must be {_RANGE}"
    return (
        requirement(mistake)
        if mistake["type"] == "value_error"
        else f"{mistake['loc'][0]} is {asWritten(mistake['input'])}; {requirement(mistake)}"
    )


class Grid(Section):
    """The file of a grid."""

    base: Annotated[
        Any, Field(description="the configuration from which the points differ: the name of a file, or a table")
    ]

    @field_validator("*")
    @classmethod
    def _range(cls, value: Any, info: ValidationInfo) -> Any:
        return value  # the points' configurations have ranges

    seeds: int = Field(
        1,
        ge=1,
        le=MOST_POINTS,
        description="how many runs each point of the grid stands for, each with random numbers of its own",
    )
    grid: Annotated[dict[str, list[Any]], BeforeValidator(_axes)] = Field(default_factory=dict)
    variants: dict[str, dict[str, Any]] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check(self) -> "Grid":
        if not isinstance(self.base, (str, dict)):
            raise ValueError(f"base is {quoted(self.base)}; it must be the name of a configuration file, or a table")
        if "sampling.seed" in self.grid and self.seeds > 1:
            raise ValueError("seeds and the axis sampling.seed are both given; give one of them")
        if "output.prefix" in self.grid:
            raise ValueError("output.prefix is an axis; each point has a folder of its own already")
        count = self.seeds * max(1, len(self.variants)) * math.prod(len(values) for values in self.grid.values())
        if count > MOST_POINTS:
            raise ValueError(f"the grid has {count} points; there may be {MOST_POINTS}")
        return self


def readGrid(file: PathLike) -> list[GridPoint]:
    """Read and check a grid and return its points.

    ::

        for point in mh.readGrid("grid.toml"):
            print(point.name)

    Parameters
    ----------
    file : path
        the TOML file of the grid

    Returns
    -------
    list of GridPoint
        each combination of values, with its name, values and configuration

    Raises
    ------
    FileNotFoundError
        if the file, or that of its base, does not exist
    ValueError
        if a key is unknown, or a value is not allowed or no simulation can begin with it: a line for each mistake,
        which names the points that have it
    """
    path = Path(file)
    grid = _parse(readTOML(path), path)
    base = grid.base if isinstance(grid.base, dict) else _readBase(path.parent / grid.base)
    mistakes = _Mistakes()
    meshes: dict[str, Mesh] = {}
    points = [
        _createPoint(base, variant, values, parameters, path, mistakes, meshes)
        for variant, values, parameters in _places(grid)
    ]
    mistakes.raiseAny(len(points))
    return [point for point in points if point is not None]


def _parse(data: Any, path: Path) -> Grid:
    try:
        return Grid.model_validate(data)
    except ValidationError as error:
        raise ValueError("\n".join(f"{path}: {_explain(mistake)}" for mistake in error.errors())) from None


def _explain(mistake: ErrorDetails) -> str:
    place, kind = ".".join(map(str, mistake["loc"])), mistake["type"]
    if kind == "extra_forbidden":
        isSection = place in Config.model_fields
        hint = f"; a configuration goes into [base]: [base.{place}]" if isSection else nearest(place, Grid.model_fields)
        return f"there is no key '{place}'{hint}"
    if kind == "missing":
        return f"{place} is missing; it must be the name of a configuration file, or a table"
    if kind == "value_error":
        return requirement(mistake)
    return f"{place} is {asWritten(mistake['input'])}; {requirement(mistake)}"


def _readBase(file: Path) -> dict[str, Any]:
    """Return the nested dict of a configuration whose files can be found from any folder."""
    return anchored(readTOML(file), file.parent.resolve())


def _places(grid: Grid) -> Iterator[tuple[dict[str, Any], dict[str, Any], dict[str, Any]]]:
    """Yield the part of a configuration, the values by key, the short names of the keys, and the number of the repeat,
    for each point.
    """
    names = _shortNames(grid.grid)
    for variant in grid.variants or [None]:
        for values in itertools.product(*grid.grid.values()):
            for repeat in range(1, grid.seeds + 1):
                parameters: dict[str, Any] = {} if variant is None else {"variant": variant}
                parameters.update(zip(names, values))
                if "sampling.seed" not in grid.grid:
                    parameters["seed"] = repeat
                yield grid.variants.get(variant or "", {}), dict(zip(grid.grid, values)), parameters


def _shortNames(keys: Iterable[str]) -> list[str]:
    last = [key.split(".")[-1] for key in keys]
    return [name if last.count(name) == 1 else key for name, key in zip(last, keys)]


def _createPoint(
    base: dict[str, Any],
    variant: dict[str, Any],
    values: dict[str, Any],
    parameters: dict[str, Any],
    path: Path,
    mistakes: "_Mistakes",
    meshes: dict[str, Mesh],
) -> GridPoint | None:
    """Return a GridPoint, or None if it cannot be, after noting why."""
    name = _nameOf(parameters)
    with mistakes.of(name):
        data = _merge(copy.deepcopy(base), variant)
        for key, value in values.items():
            _set(data, key, value, path)
        config = parseConfig(data, str(path))
        if "sampling.seed" not in values:
            config.sampling.seed = seedOf(config.sampling.seed, name)
        if config.mesh.file is not None:
            config.mesh.file = str((path.parent / config.mesh.file).resolve())
        if config.system.forces is not None:
            config.system.forces = [str((path.parent / name).resolve()) for name in config.system.forces]
        if config.platform.threads is None and config.platform.name == "CPU":
            config.platform.threads = 1  # what there is to do side by side are points
        return GridPoint(name, parameters, config, *_checkRun(config, meshes))
    return None


def _checkRun(config: Config, meshes: dict[str, Mesh]) -> tuple[float, list[Coarse]]:
    """Raise what a run would raise before its first step, and return how much room on the disk it takes, and where it
    has too few vertices.
    """
    key = config.mesh.model_dump_json()
    if key not in meshes:
        meshes[key] = loadMesh(config)
    scene = Scene.of(config, meshes[key])
    requireEffect(config, scene.config, scene.mesh)
    targets = checkStages(scene)
    requireMemory(len(scene.mesh.vertices))
    return diskSize(scene.config, len(scene.mesh.vertices)), coarseness(scene, targets)


def coarsePoints(points: Sequence[GridPoint]) -> list[str]:
    """Return which points have too few vertices, in a sentence for each number of vertices and of enough ones."""
    found: dict[tuple[int, int], list[tuple[GridPoint, Coarse]]] = {}
    for point in points:
        for coarse in point.coarse:
            found.setdefault((coarse.vertices, coarse.enough), []).append((point, coarse))
    sentences = []
    for (vertices, enough), pairs in sorted(found.items()):
        names = list(dict.fromkeys(point.name for point, _ in pairs))
        volumes = tuple(volume for _, coarse in pairs for volume in coarse.volumes)
        sentences.append(f"{Coarse(vertices, volumes, enough)} ({placesOf(names, len(points))})")
    return sentences


def _nameOf(parameters: dict[str, Any]) -> str:
    text = ",".join(f"{name}={_text(value)}" for name, value in parameters.items())
    plain = re.sub(r"[^\w.,=+-]+", "-", text)
    return (
        plain
        if plain == text and len(text) <= 150
        else f"{plain[:120]}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"
    )


def _text(value: Any) -> str:
    """Return a value as text, the same for 1 and 1.0."""
    return str(int(value) if isinstance(value, float) and value.is_integer() else value)


def seedOf(seed: int | None, name: str) -> int:
    """Return a seed that follows from another one, and a name: that of the base, and of a point."""
    return int.from_bytes(hashlib.sha256(f"{seed} {name}".encode()).digest()[:8], "big") % (2**31 - 1) + 1


def _merge(data: dict[str, Any], part: dict[str, Any]) -> dict[str, Any]:
    for name in part:
        if _ALTERNATIVES.get(name) not in part:
            data.pop(_ALTERNATIVES.get(name, ""), None)
    for name, value in part.items():
        if isinstance(value, dict) and isinstance(data.get(name, {}), dict):
            data[name] = _merge(data.get(name, {}), value)
        elif value == UNSET:
            data.pop(name, None)
        else:
            data[name] = copy.deepcopy(value)
    return data


def _set(data: Any, key: str, value: Any, path: Path) -> None:
    """Set a key, "section.key" or "stages.NAME.key", of a nested dict."""
    *home, last = key.split(".")
    if not home:
        raise ValueError(f"{path}: '{key}' names no section; a key is written like membrane.reduced_volume")
    for name in home:
        if isinstance(data, dict):
            data = data.setdefault(name, [] if name in _NAMED else {})
        elif isinstance(data, list):
            data = _entry(data, name, key, path)
    if not isinstance(data, dict):
        hint = f"; it is written like {home[0]}.NAME.{last}, with {_NAMED[home[0]]}" if home[0] in _NAMED else ""
        raise ValueError(f"{path}: there is nowhere to set '{key}'{hint}")
    _merge(data, {last: value})


# What is a list of tables in a configuration, and how keys of grids call one of these.
_NAMED = {"stages": "the stage's name, kind or number", "species": "the species' name or number"}


def _entry(entries: list[Any], name: str, key: str, path: Path) -> dict[str, Any]:
    """Return the stage, or the species, of a name, or if none has it of a kind or number."""
    entries = [entry for entry in entries if isinstance(entry, dict)]
    for which in (
        [entry.get("name") for entry in entries],
        [entry.get("kind") for entry in entries],
        [str(i + 1) for i in range(len(entries))],
    ):
        if which.count(name) == 1:
            return entries[which.index(name)]
    what, are = ("stage", "stages") if key.startswith("stages.") else ("of the species", "species")
    titles = [str(entry.get("name") or entry.get("kind")) for entry in entries]
    raise ValueError(
        f"{path}: '{key}' does not name one {what}; the {are} are "
        f"{', '.join(f'{i + 1} ({title})' for i, title in enumerate(titles)) or 'none'}"
    )


class _Mistakes:
    """Collects the mistakes of points, to tell each once."""

    def __init__(self) -> None:
        self._points: dict[str, list[str]] = {}

    def of(self, name: str) -> "_Mistakes":
        """Return a context that notes the errors in it as those of a point."""
        self._name = name
        return self

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: object) -> bool:
        if kind is None or not issubclass(kind, (ValueError, OSError)):
            return False
        for line in str(error).splitlines():
            self._points.setdefault(line, []).append(self._name)
        return True

    def raiseAny(self, count: int) -> None:
        """Raise a ValueError of all mistakes, if there are any, out of a number of points."""
        if self._points:
            raise ValueError("\n".join(f"{line} ({placesOf(names, count)})" for line, names in self._points.items()))


def placesOf(names: Sequence[str], count: int) -> str:
    """Return which points some of a number of points are, in a few words."""
    if len(names) == count and count > 1:
        return "every point"
    return f"point {names[0]}" + (f" and {len(names) - 1} more" if len(names) > 1 else "")
