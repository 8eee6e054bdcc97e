"""The configuration of a run: a TOML file, read and validated before anything else happens, without OpenMM."""

import contextlib
import datetime
import difflib
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, PrivateAttr, ValidationError, model_validator
from pydantic_core import ErrorDetails

from ..files import PathLike
from ..geometry.formats import WRITTEN
from ..io.runfiles import prefixOf
from ..messages import quoted, shortened
from ..units import Scales, lengthUnit, multipleOfUnit, plainNumber, thermalEnergy
from .sections import (
    GREATEST,
    LEAST,
    Conditions,
    MembraneSection,
    MeshSection,
    OutputSection,
    PlatformSection,
    RepulsionSection,
    SamplingSection,
    Section,
    SpeciesChange,
    SpeciesSection,
    SystemSection,
    TetherSection,
    checkMaterial,
    checkSpecies,
)
from .stagesettings import STAGES, AnnealStage, AnyStage, SampleStage, checkCooling, givenConditions

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


# So many known words end a sentence about one that is not.
MOST_WORDS = 16
# What is left out where there is nothing in it.
_EMPTY: dict[str, Any] = {"system": {}, "species": []}
# What a file with stages has not: these have their own.
_OWN_OF_STAGES = ("[sampling]", "steps")
# Keys whose default is a length of 1, and the key that brings them into use.
_DEFAULT_LENGTHS = (
    ("membrane", "leaflet_separation", None),
    ("tether", "length_scale", "modulus"),
    ("repulsion", "length_scale", "modulus"),
)


class Config(Section):
    """A whole configuration.

    Attributes
    ----------
    source : str
        where it comes from, for messages
    """

    _source: str = PrivateAttr("configuration")

    mesh: MeshSection
    membrane: MembraneSection = MembraneSection()
    tether: TetherSection = TetherSection()
    repulsion: RepulsionSection = RepulsionSection()
    system: SystemSection = SystemSection()
    sampling: SamplingSection = SamplingSection()
    platform: PlatformSection = PlatformSection()
    output: OutputSection = OutputSection()
    species: list[SpeciesSection] = Field(default_factory=list)
    stages: list[AnyStage] = Field(default_factory=list)

    @property
    def source(self) -> str:
        return self._source

    @model_validator(mode="after")
    def _material(self) -> "Config":
        checkSpecies(self.species, self.mesh, self.membrane, self.sampling)
        checkMaterial(self.species, self.membrane, givenConditions(self.stages))
        checkCooling(self.stages, self.sampling.temperature)
        return self


def valueOf(config: Config, name: str) -> Any:
    """Return the value of a key of a Config by its name, like "tether.modulus"."""
    section, key = name.split(".")
    return getattr(getattr(config, section), key)


def during(config: Config, index: int) -> Config:
    """Return a Config with the moduli and the like that its membrane has during one of its stages, at the end of it, or
    where it turns back, or before all stages: -1.
    """
    before = after(config, index - 1)
    return _changed(before, config.stages[index].conditions()) if index >= 0 else before


def after(config: Config, index: int) -> Config:
    """Return a Config with the moduli and the like that its membrane has after one of its stages, or before all: -1."""
    for stage in config.stages[: max(0, index + 1)]:
        if not stage.returns:
            config = _changed(config, stage.conditions())
    return config


def _changed(config: Config, conditions: Mapping[str, float]) -> Config:
    """Return a Config with other moduli and the like, by the names that stages give."""
    membrane, species = config.membrane, list(config.species)
    update: dict[str, Any] = {name: value for name, value in conditions.items() if "[" not in name}
    for name, value in conditions.items():
        key, inside = conditionParts(name)
        if key == "line_tension" and inside:
            update[key] = {**pairTable(config, update.get(key, membrane.line_tension)), inside: value}
        elif key == "pair_energy":
            update["pair_energies"] = {**update.get("pair_energies", membrane.pair_energies), inside: value}
        elif inside:
            species = [each.model_copy(update={key: value}) if each.name == inside else each for each in species]
    return config.model_copy(update={"membrane": membrane.model_copy(update=update), "species": species})


def conditionParts(name: str) -> tuple[str, str]:
    """Return the name of a condition without what it is of, and that: a species or a pair of these, or nothing."""
    key, _, inside = name.partition("[")
    return key, inside.removesuffix("]")


def pairTable(config: Config, lineTension: Any) -> dict[str, float]:
    """Return line tensions by pairs of species, of such a table or of a number for all."""
    if isinstance(lineTension, dict):
        return lineTension
    names = [each.name for each in config.species]
    return {", ".join(sorted((a, b))): lineTension for i, b in enumerate(names) for a in names[:i]}


def conditionOf(config: Config, name: str) -> float:
    """Return what a membrane has of a condition, by the name that stages give."""
    key, inside = conditionParts(name)
    if not inside:
        return float(getattr(config.membrane, key))
    if key == "pair_energy":
        return config.membrane.pair_energies.get(inside, 0.0)
    if key == "line_tension":
        return pairTable(config, config.membrane.line_tension).get(inside, 0.0)
    own = next(getattr(each, key) for each in config.species if each.name == inside)
    return float(getattr(config.membrane, key) if own is None else own)


def hasBurnIn(config: Config) -> bool:
    """Return whether a step size or an amplitude of a Config adapts during a burn-in."""
    return _isAutomatic(config) or config.sampling.shear_wave_probability > 0


def hasAim(config: Config) -> bool:
    """Return whether a step size of a Config follows the part of trajectories that are accepted."""
    return _isAutomatic(config) or any(isinstance(stage, AnnealStage) for stage in config.stages)


def _isAutomatic(config: Config) -> bool:
    return "auto" in [config.sampling.step_size, *(getattr(stage, "step_size", None) for stage in config.stages)]


def stagesOf(config: Config) -> list[Any]:
    """Return the stages of a Config: those it lists, or one that samples.

    Raises a ValueError if [sampling] has steps that no stage would make.
    """
    if not config.stages:
        return [SampleStage(kind="sample", steps=config.sampling.steps)]
    if "steps" in config.sampling.model_fields_set:
        raise ValueError("[sampling] steps is given, and stages too; stages have steps of their own")
    return config.stages


def readConfig(file: PathLike) -> Config:
    """Read and validate a configuration file.

    Returns a Config whose mesh file and output prefix are paths that can be opened from the working folder.

    Raises
    ------
    FileNotFoundError
        if there is no such file
    ValueError
        if it is not TOML, or has an unknown key or a value out of range; the message names section, key and what is
        allowed
    """
    path = Path(file)
    config = parseConfig(anchored(readTOML(path), path.parent), str(path))
    if config.output.prefix is None:
        config.output.prefix = path.stem
    return config


def asConfig(config: Config | dict[str, Any] | PathLike, hasMesh: bool = False) -> Config:
    """Return a Config as it is, or that of a nested dict, or of a file.

    With `hasMesh`, a dict may leave out [mesh]: a mesh from elsewhere takes its place.
    """
    if isinstance(config, Config):
        return config
    if isinstance(config, dict):
        return parseConfig({"mesh": {"file": "mesh"}, **config} if hasMesh else config)
    return readConfig(config)


def anchored(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return the nested dict of a configuration whose files, relative to a folder, can be found from the working
    folder.
    """
    result = dict(data)
    for section, key in (("mesh", "file"), ("system", "forces")):
        values = result.get(section)
        if isinstance(values, dict) and key in values:
            files = values[key]
            found = [str(folder / name) if name and isinstance(name, str) else name for name in _listed(files)]
            result[section] = {**values, key: found if isinstance(files, list) else found[0]}
    return result


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def readTOML(file: PathLike) -> dict[str, Any]:
    """Return the nested dict of a configuration file; raise a FileNotFoundError or ValueError that names the file."""
    path = Path(file)
    if not path.exists():
        raise FileNotFoundError(f"there is no configuration file {path}")
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder; the name of a configuration file is expected")
    try:
        text = path.read_text(encoding="utf-8-sig")
        return tomllib.loads(text)
    except UnicodeDecodeError:
        raise ValueError(
            f"{path} is {_otherThanTOML(path) or 'not TOML, which is text in UTF-8; save it so'}"
        ) from None
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise ValueError(f"{path} is {_otherThanTOML(path) or _notTOML(text, error)}") from None


def _otherThanTOML(path: Path) -> str:
    """Return what a file is that cannot be read as TOML, by its name, and what to do; nothing if this does not say."""
    prefix = prefixOf(path)
    if path.suffix.lower() in WRITTEN:
        return (
            f'a mesh; a configuration is expected, for instance a file with these two lines:\n[mesh]\nfile = "{path}"'
        )
    if path.suffix.lower() != ".toml" and prefix != path:
        return f"a file of the run {prefix}; a configuration is expected, and resume {prefix} goes on with that run"
    return ""


def _notTOML(text: str, error: Exception) -> str:
    """Return what is wrong with a text that is not TOML, the line where, and what lines are like."""
    place = re.search(r"at line (\d+)", str(error))
    line = f": {quoted(text.splitlines()[int(place[1]) - 1].strip())}" if place else ""
    return f'not TOML: {error}{line}; lines are like [section], key = 20.5 and key = "text", and each key stands once'


def parseConfig(data: Mapping[str, Any], source: str = "configuration") -> Config:
    """Return the Config that a nested dict describes, or raise a ValueError with a sentence for each mistake.

    Numbers and arrays of NumPy, tuples and paths are taken for what a file would have in their place.
    """
    data, multiple = _inNamedUnit(_asInFile(data))
    try:
        config = Config.model_validate(data, context=_scales(data, multiple))
        config._source = source
        return config
    except ValidationError as error:
        raise ValueError("\n".join(f"{source}: {_explain(mistake)}" for mistake in error.errors())) from None


@contextlib.contextmanager
def namingSource(config: Config) -> Iterator[None]:
    """Say in a ValueError where the configuration comes from that has the mistake."""
    try:
        yield
    except ValueError as error:
        raise ValueError("\n".join(f"{config.source}: {line}" for line in str(error).splitlines())) from None


def asDict(config: Config, onlyGiven: bool = False) -> dict[str, Any]:
    """Return the nested dict of a Config, which :func:`parseConfig` takes back, if asked for only of what was given."""
    exclude = {"sampling": {"steps"}} if config.stages else None  # stages have steps of their own
    data = config.model_dump(mode="json", exclude_none=True, exclude_unset=onlyGiven, exclude=exclude)
    return {name: values for name, values in data.items() if values != _EMPTY.get(name, ...)}


def sections() -> dict[str, type[Section]]:
    """Return the sections of a configuration by name, in order; stages are none of them."""
    models = {name: field.annotation for name, field in Config.model_fields.items()}
    return {name: model for name, model in models.items() if isinstance(model, type) and issubclass(model, Section)}


def _asInFile(value: Any) -> Any:
    """Return a value of Python as a file has it: a table, a list, a number or a string."""
    if isinstance(value, Mapping):
        return {key: _asInFile(each) for key, each in value.items()}
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_asInFile(each) for each in value]
    return str(value) if isinstance(value, Path) else value


def _inNamedUnit(data: Any) -> tuple[Any, float]:
    """Return the nested dict of a file with lengths of the mesh in a named unit, and how many of these a plain 1 is.

    That is 100 where length_unit is "100 nm".  Where a file has a scale and no length_unit, its coordinates are nm, and
    a plain step size takes vertices as far beside the mesh as it did when results were in scaled coordinates.
    """
    try:
        mesh = data["mesh"]
        scale, name = mesh.get("scale", 1.0), mesh.get("length_unit")
        if name is None and "file" in mesh and LEAST <= scale <= GREATEST:
            multiple, name = 1 / scale, "nm"
            data = _withStepSizes(data, multiple)
        else:
            multiple, name = multipleOfUnit(name)
        if multiple == 1 and name == mesh.get("length_unit", "nm"):
            return data, 1.0
        scale = 1.0 if mesh.get("length_unit") is None else scale * multiple
        result = {**data, "mesh": {**mesh, "scale": scale, "length_unit": name}}
        # What is 1 by default is 1 of the file's unit.
        for section, key, switch in _DEFAULT_LENGTHS:
            given = data.get(section, {})
            if key not in given and (switch is None or switch in given):
                result[section] = {**given, key: 1.0}
        return result, multiple
    except (KeyError, TypeError, AttributeError):
        return data, 1.0


def _withStepSizes(data: Any, factor: float) -> dict[str, Any]:
    """Return a nested dict with the plain step sizes of sampling and stages multiplied by a factor."""

    def changed(section: Any) -> Any:
        size = section.get("step_size")
        return {**section, "step_size": size * factor} if isinstance(size, (int, float)) else section

    result = {**data, "sampling": changed(data.get("sampling", {}))}
    return result | ({"stages": [changed(stage) for stage in data["stages"]]} if "stages" in data else {})


def _scales(data: Any, multiple: float) -> Scales:
    """Return the units of the plain numbers of a file, as far as they can be told before it is validated."""
    try:
        kT = thermalEnergy(plainNumber(data["sampling"]["temperature"], "temperature", Scales(1.0)))
    except (KeyError, TypeError, ValueError, AttributeError):
        kT = thermalEnergy(SamplingSection.model_fields["temperature"].default)
    try:
        name = data["mesh"].get("length_unit", "nm")
        return Scales(kT, lengthUnit(name), name, multiple)
    except (KeyError, TypeError, AttributeError):
        return Scales(kT)


def _explain(mistake: ErrorDetails) -> str:
    """Return a sentence for one of pydantic's errors."""
    place, kind = mistake["loc"], mistake["type"]
    if kind == "extra_forbidden":
        return _explainUnknown(place)
    name = _placeName(place)
    if not place and kind == "value_error":  # of several sections
        return requirement(mistake)
    if kind == "missing":
        return f"{name} is missing{'; the mesh to begin with has no default' if place[0] == 'mesh' else ''}"
    message = requirement(mistake)
    if kind == "union_tag_not_found":
        return f"{name} has no kind; it must be one of {', '.join(STAGES)}"
    if kind == "union_tag_invalid":
        return (
            f"{name} has the kind "
            f"{quoted(mistake['ctx']['tag'])}{nearest(mistake['ctx']['tag'], STAGES, 'it must be one of')}"
        )
    if kind == "value_error" and isinstance(mistake["input"], dict):  # a key of this table, or all of it
        return f"{name}{':' if message.startswith(('it ', 'each ', 'the ')) else ''} {message}"
    return f"{name} is {asWritten(mistake['input'])}; {message}"


def asWritten(value: Any) -> str:
    """Return a value for a message as a file has it."""
    if isinstance(value, bool):
        return str(value).lower()
    return str(value) if isinstance(value, datetime.date | datetime.time) else quoted(value)


def requirement(mistake: ErrorDetails) -> str:
    """Return what one of pydantic's errors says must be."""
    message, limits = mistake["msg"].removeprefix("Value error, "), mistake.get("ctx", {})
    if mistake["type"] == "string_too_short":
        return "it must not be empty"
    if mistake["type"] in ("model_type", "model_attributes_type"):
        return "it must be a table of keys"
    if mistake["type"] in ("bool_type", "bool_parsing"):
        return "it must be true or false"
    if mistake["type"] in ("too_short", "too_long"):
        bound = "at least {min_length}" if "min_length" in limits else "at most {max_length}"
        return f"it must have {bound.format(**limits)} values"
    if mistake["type"] == "list_type" and isinstance(mistake["input"], dict):
        return f"it must be a list of tables, each under [[{mistake['loc'][0]}]]"
    return (
        message.replace("Input should be", "it must be")
        .replace("a valid integer", "a whole number")
        .replace("a valid dictionary", "a table")
        .replace("a valid ", "a ")
    )


def _placeName(place: Sequence[Any]) -> str:
    """Return where a mistake is: "[sampling] steps", "[system] fixed[0]" or "stage 2 (anneal) rate"."""
    if not place:
        return "the file"
    if place[0] == "stages":
        kind = f" ({place[2]})" if len(place) > 2 else ""
        stage = f"stage {place[1] + 1}{kind}" if len(place) > 1 else "stages"
        return stage + _insideName(place[3:])
    if place[0] == "species":
        number = f" {place[1] + 1}" if len(place) > 1 else ""
        return f"[[species]]{number}{_insideName(place[2:])}"
    return f"[{place[0]}]{_insideName(place[1:])}"


def _insideName(place: Sequence[Any]) -> str:
    """Return where a mistake is inside a section: keys, and the number of a value of a list, from 0, in brackets."""
    return "".join(f"[{part}]" if isinstance(part, int) else f" {shortened(str(part))}" for part in place)


def _modelOf(home: Sequence[Any]) -> type[Section]:
    """Return what describes the keys of a table."""
    if home[0] == "stages":
        return SpeciesChange if "species" in home[3:] else STAGES[home[2]]
    return SpeciesSection if home[0] == "species" else sections()[home[0]]


def _explainUnknown(place: Sequence[Any]) -> str:
    *home, key = place
    where = f"{_placeName(home)} has no key" if home else "there is no section or key"
    isOfStage = home[:1] == ["stages"]
    homes = [name for name in _homesOf(key) if not (isOfStage and (name, key) == _OWN_OF_STAGES)]
    kinds = [kind for kind, model in STAGES.items() if key in _ownKeys(model)]
    model = _modelOf(home) if home else Config
    if model is SpeciesChange or not (homes or kinds):
        return f"{where} {quoted(key)}{nearest(key, _ownFirst(model))}"
    places = [*homes[:1], *([f"a stage of kind {_either(kinds)}"] if kinds else [])]
    own = f"; {home[2]} has {', '.join(_ownKeys(STAGES[home[2]]))}" if isOfStage and not homes else ""
    return f"{where} {quoted(key)}; it belongs in {', or in '.join(places)}{own}"


def _homesOf(key: Any) -> list[str]:
    """Return the sections that have a key, as a file names them."""
    models = {f"[{name}]": model for name, model in sections().items()} | {"[[species]]": SpeciesSection}
    return [name for name, model in models.items() if key in model.model_fields]


def _ownFirst(model: type[Section]) -> list[str]:
    """Return the keys of a table, those of a kind of stage before those of all stages."""
    return sorted(model.model_fields, key=lambda name: name in Conditions.model_fields)


def _ownKeys(model: type[Section]) -> list[str]:
    """Return the keys that not every stage has."""
    return [name for name in model.model_fields if name not in {"name", "kind", *Conditions.model_fields}]


def _either(words: Sequence[str]) -> str:
    return " or ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def nearest(word: Any, known: Iterable[str], otherwise: str = "it has") -> str:
    """Return the end of a sentence about an unknown word: the known one that it resembles, or all of them, or some of
    many.
    """
    words = list(known)
    match = difflib.get_close_matches(str(word).lower(), words, n=1)
    if match:
        return f"; did you mean '{match[0]}'?"
    rest = ", and more, which openmm-helfrich config prints" if len(words) > MOST_WORDS else ""
    return f"; {otherwise} {', '.join(words[:MOST_WORDS])}{rest}"
