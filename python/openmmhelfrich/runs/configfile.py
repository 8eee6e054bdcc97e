"""Configuration files written: the commented defaults, and the settings of a run."""

import textwrap
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

import tomli_w

from ..files import PathLike, replacing
from .config import Config, asDict, sections
from .sections import Conditions, Section, SpeciesSection, Targets
from .stagesettings import STAGES

_HEAD = """\
Configuration of openmm-helfrich run.  Keys that are left out have the values shown here; a mesh is all that must be \
given.
Numbers without a unit: lengths in the mesh's length_unit, energies in kT, temperatures in K, times in ps, masses in Da.
A number with a unit in quotes may stand for each of them: "80 kJ/mol", "0.5 um", "12 um^2", "90 fL", "37 C", "1 fs"."""
_STAGES = """\
Stages, one after the other, each a table [[stages]] with its kind; without any, [sampling] steps is one that samples.
Take away the first "# " of each line to use one.  All may also set targets, moduli and the like, which stay: \
target_area, target_volume or reduced_volume, target_area_difference; bending_modulus, gaussian_modulus, \
spontaneous_curvature, line_tension, pair_energies, species, area_modulus, volume_modulus, area_difference_modulus, \
tension, pressure."""


def defaultText() -> str:
    """Return the text of a configuration file with all keys, their defaults, and the reasons for these."""
    parts = [_comment(_HEAD)]
    for name, model in sections().items():
        parts.append(f"{_purpose(model)}\n[{name}]\n{_keys(model)}")
    parts.append(_commentedOut(f"{_purpose(SpeciesSection)}\n[[species]]\n{_keys(SpeciesSection)}"))
    parts.append(_comment(_STAGES))
    for kind, model in STAGES.items():
        keys = _keys(model, leaveOut={"kind", *Conditions.model_fields})
        parts.append(_commentedOut(f'{_purpose(model)}\n[[stages]]\nkind = "{kind}"\n{keys}'))
    return "\n\n".join(parts) + "\n"


def _commentedOut(text: str) -> str:
    return "\n".join("# " + line for line in text.splitlines())


def settingsText(config: Config, comments: Iterable[str] = ()) -> str:
    """Return the text of a configuration file of a Config, after some comments."""
    return configText(asDict(config), comments)


def configText(data: Mapping[str, Any], comments: Iterable[str] = ()) -> str:
    """Return the text of a configuration file of a nested dict, after some comments."""
    head = "".join(_comment(line) + "\n" for line in comments)
    sectionsText = tomli_w.dumps({name: values for name, values in data.items() if name != "stages"})
    return "\n".join([head, sectionsText, *map(_stageText, data.get("stages", ()))]).lstrip("\n")


def writeSettings(file: PathLike, config: Config, comments: Iterable[str] = ()) -> None:
    """Write a configuration file of a Config, after some comments, replacing one that exists in a single step."""
    with replacing(file) as part:
        part.write_text(settingsText(config, comments), encoding="utf-8")


def _stageText(stage: dict[str, Any]) -> str:
    keys, path = {name: value for name, value in stage.items() if name != "path"}, stage.get("path")
    plain = {name: value for name, value in keys.items() if not isinstance(value, dict)}
    tables = "".join(f"{line}\n" for name, value in keys.items() if name not in plain for line in _dotted(name, value))
    return "[[stages]]\n" + tomli_w.dumps(plain) + tables + (f"[stages.path]\n{tomli_w.dumps(path)}" if path else "")


def _dotted(prefix: str, table: Mapping[str, Any]) -> Iterator[str]:
    """Yield a line for each value of nested tables, with a dotted key."""
    for name, value in table.items():
        if isinstance(value, dict):
            quoted = tomli_w.dumps({name: 0}).removesuffix(" = 0\n")
            yield from _dotted(f"{prefix}.{quoted}", value)
        else:
            yield f"{prefix}.{tomli_w.dumps({name: value}).strip()}"


def _keys(model: type[Section], leaveOut: Collection[str] = ()) -> str:
    """Return a description and a line for each key; those without a default are commented out."""
    lines = []
    for name, field in sorted(
        model.model_fields.items(), key=lambda item: item[0] in Targets.model_fields
    ):  # what a class adds comes first
        if name in leaveOut:
            continue
        lines.append(_comment(field.description or ""))
        hasValue = field.default is not None and not field.is_required() and field.default not in ({}, [])
        lines.append(tomli_w.dumps({name: field.default}).strip() if hasValue else f"# {name} =")
    return "\n".join(lines)


def _purpose(model: type[Section]) -> str:
    return _comment(" ".join(line.strip() for line in (model.__doc__ or "").strip().splitlines()))


def _comment(text: str) -> str:
    return "\n".join("# " + line for line in _wrap(text))


def _wrap(text: str) -> list[str]:
    return [line for paragraph in text.splitlines() for line in textwrap.wrap(paragraph, 118) or [""]]
