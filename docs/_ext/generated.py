"""What pages of the reference take from the code: configuration keys, commands, and names in docstrings.

A line "<!-- NAME -->" of a page is replaced by what the function of that name in `TEXTS` returns.
"""

import inspect
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import typer
from pydantic.fields import FieldInfo
from sphinx.application import Sphinx

import openmmhelfrich as mh
from openmmhelfrich.cli.commands import app as commands
from openmmhelfrich.runs import sections as keys
from openmmhelfrich.runs.config import sections
from openmmhelfrich.runs.stagesettings import STAGES
from openmmhelfrich.sampling.observables import OBSERVABLES

ROOT = Path(__file__).resolve().parents[2]
SOURCES = "https://github.com/openmm-helfrich/openmm-helfrich/blob/main/"

# What a type of the sections is called, and its unit where it has no other.
KINDS = {
    "Energy": "energy, kT",
    "Length": "length",
    "Area": "area",
    "Volume": "volume",
    "Tension": "energy per area, kT per squared length",
    "Force": "energy per length, kT per length",
    "Pressure": "energy per volume, kT per cubed length",
    "Curvature": "one over a length",
    "LineTensions": "energy per length, kT per length, or a table of pairs of species",
    "PairEnergies": "table of pairs of species, with energies, kT",
    "Time": "time, ps",
    "Mass": "mass, Da",
    "Temperature": "temperature, K",
    "StepSize": 'positive time, ps, or "auto"',
    "Amplitude": 'positive length, or "auto"',
    "MultilevelWeight": 'number from 0 to 1000, or "auto"',
    "TargetArea": "positive area, or one for each surface",
    "TargetVolume": "positive volume, or one for each surface",
    "ReducedVolume": "number above 0 and at most 1, or one for each surface",
    "TargetAreaDifference": "area, or one for each surface",
}
_BY_VALIDATOR = {id(get_args(getattr(keys, name))[1]): text for name, text in KINDS.items()}
# What an observable is, where its title does not say all.
MEANINGS = {
    "step": "the number of the Monte Carlo step",
    "energy": "the whole energy of the membrane, the sum of its terms",
    "meanCurvature": "the integrated mean curvature M, 4πR on a sphere",
    "reducedAreaDifference": "M over that of a sphere of the same area",
    "acceptance": "fraction of trajectories accepted since the start",
    "flipAcceptance": "fraction of attempted flips accepted since the start",
    "waveAcceptance": "fraction of shear waves accepted since the start",
    "waveAmplitude": "standard deviation of the amplitude of the longest shear waves",
    "exchangeAcceptance": "fraction of attempted exchanges of species accepted since the start",
    "exchangesAlike": "fraction of attempted exchanges that would have changed nothing",
    "flipRate": "flips accepted per edge and sweep since the start",
    "flipsForbidden": "fraction of attempted flips that the rules forbid",
    "diverged": "number of trajectories that diverged, which are rejected",
    "temperature": "temperature of the moves",
    "stepSize": "size of a leapfrog step",
    "stage": "the number of the stage, from 1",
    "window": "the number of the window of a stage that continues",
    "equilibrated": "1 where a window is equilibrated, so that the row is averaged",
}
PLAIN = {bool: "true or false", int: "whole number", float: "number", str: "text"}
# What stands for the value of an option, by its type.
PLACEHOLDERS = {int: "N", float: "X", str: "TEXT", Path: "PATH"}
LIMITS = {"ge": "at least {:g}", "gt": "more than {:g}", "le": "at most {:g}", "lt": "less than {:g}"}


def configuration() -> str:
    """Return the description of every key of a configuration."""
    parts = [f"## `[{name}]`\n\n{_section(name, model)}" for name, model in sections().items()]
    parts.append(f"## `[[species]]`\n\n{_section('species', keys.SpeciesSection)}")
    parts.append(
        "## `[[stages]]`\n\nA stage has a `kind`, and the keys of that kind. Each may also give targets, moduli and "
        "the like, as `continue` does.\n"
    )
    parts += [f'### `kind = "{kind}"`\n\n{_section(f"stages.{kind}", model)}' for kind, model in STAGES.items()]
    return "\n\n".join(parts)


def _section(name: str, model: Any) -> str:
    isStage = name.startswith("stages.")
    leftOut = {"kind", *keys.Conditions.model_fields} if isStage else set()
    if name == "stages.approach" or name == "stages.continue":
        leftOut = {"kind"}
    return "\n\n".join(
        [" ".join((inspect.getdoc(model) or "").split())]
        + [_key(f"{name}.{key}", field) for key, field in model.model_fields.items() if key not in leftOut]
    )


def _key(name: str, field: FieldInfo) -> str:
    hasDefault = field.default is not None and not field.is_required() and field.default not in ({}, [])
    lines = [f"```{{confval}} {name}", f":type: {'; '.join([kindOf(field), *_limits(field)])}"]
    if hasDefault:
        lines.append(f":default: `{_toml(field.default)}`")
    text = (field.description or "").replace("<", "&lt;")
    return "\n".join([*lines, "", text[:1].upper() + text[1:] + ("" if text.endswith(".") else "."), "```"])


def _toml(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return str(value).lower() if isinstance(value, bool) else f'"{value}"' if isinstance(value, str) else f"{value:g}"


def kindOf(field: FieldInfo) -> str:
    """Return what a key's value is, with its unit."""
    for mark in field.metadata:
        if id(mark) in _BY_VALIDATOR:
            return _BY_VALIDATOR[id(mark)]
    return _kind(field.annotation)


def _kind(annotation: Any) -> str:
    for mark in getattr(annotation, "__metadata__", ()):
        if id(mark) in _BY_VALIDATOR:
            return _BY_VALIDATOR[id(mark)]
    if annotation in PLAIN:
        return PLAIN[annotation]
    if isinstance(annotation, type) and issubclass(annotation, keys.Section):
        return f"table of {', '.join(annotation.model_fields)}"
    origin, arguments = get_origin(annotation), [a for a in get_args(annotation) if a is not type(None)]
    if origin is Literal:
        return "one of " + ", ".join(_toml(choice) for choice in arguments)
    if origin is list:
        return f"list ({_kind(arguments[0])})"
    if origin is dict:
        return f"table of {_kind(arguments[1])}"
    if not arguments:
        raise ValueError(f"a key has the type {annotation}; give it a word in KINDS of docs/_ext/generated.py")
    return _kind(arguments[0])


def _limits(field: FieldInfo) -> Iterator[str]:
    for mark in [*field.metadata, *getattr(field.annotation, "__metadata__", ())]:
        for name, text in LIMITS.items():
            if getattr(mark, name, None) is not None:
                yield text.format(getattr(mark, name))


def commandTexts() -> str:
    """Return the description of every command."""
    group: Any = typer.main.get_command(commands)
    return "\n\n".join(_command(name, command) for name, command in commandsIn(group))


def commandsIn(group: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the whole name of each command of a group, and of the groups in it, and the command."""
    for command in group.commands.values():
        name = before + command.name
        if hasattr(command, "commands"):
            yield from commandsIn(command, f"{name} ")
        else:
            yield name, command


def _command(name: str, command: Any) -> str:
    help_, epilog = (_plain(inspect.cleandoc(text or "")) for text in (command.help, command.epilog))
    text, *examples = re.split(r"\n*Examples?:", help_)
    arguments = [parameter for parameter in command.params if not parameter.opts[0].startswith("-")]
    usage = " ".join(["openmm-helfrich", name, *map(_value, arguments), "[OPTIONS]"])
    parts = [f"## {name}", f"```text\n{usage}\n```", text, *map(_parameter, command.params)]
    runs = re.findall(r"openmm-helfrich [^\n]*", "\n".join([*examples, epilog]))
    return "\n\n".join([*parts, *(["```bash\n" + "\n".join(runs) + "\n```"] if runs else [])])


def _parameter(parameter: Any) -> str:
    """Return what an argument or an option of a command is."""
    isOption, isFlag = parameter.opts[0].startswith("-"), getattr(parameter, "is_flag", False)
    names = [f"`{name}`" for name in [*parameter.opts, *parameter.secondary_opts]] if isOption else []
    value = [] if isFlag else [f"`{_value(parameter)}`"]
    default = parameter.default
    hasDefault = isinstance(default, (int, float, str)) and not isFlag and default != ""
    described = _plain(parameter.help or "") + (f" By default {default}." if hasDefault else "")
    return f"{' '.join([', '.join(names), *value]).strip()}\n: {described}"


def _value(parameter: Any) -> str:
    """Return what stands for the value of an argument or an option."""
    kind = parameter.type_descriptor.annotation
    if parameter.metavar or kind in PLACEHOLDERS:
        return str(parameter.metavar or PLACEHOLDERS[kind])
    return "|".join(get_args(kind)) if get_origin(kind) is Literal else PLACEHOLDERS[get_args(kind)[0]] + " ..."


def _plain(text: str) -> str:
    return text.replace("\\[", "[")


def observables() -> str:
    """Return the columns of tables of observables."""
    rows = (f"| `{o.name}` | {_unit(o.unit)} | {_meaning(o)} |" for o in OBSERVABLES)
    return "\n".join(["| column | unit | what it is |", "|---|---|---|", *rows])


def _unit(unit: str) -> str:
    """Return a unit in words."""
    words = {"energy": "kT", "length^2": "squared length", "length^3": "cubed length", "1": "one"}
    return " per ".join(words.get(part, part) for part in unit.split("/"))


def _meaning(observable: Any) -> str:
    where = ", where stages change it" if observable.condition else ""
    return MEANINGS.get(observable.name) or f"{observable.title}{where}"


TEXTS: dict[str, Callable[[], str]] = {
    "configuration": configuration,
    "commands": commandTexts,
    "observables": observables,
}


def _fill(app: Sphinx, page: str, source: list[str]) -> None:
    """Put what is generated into a page, and lead links out of the site to the repository."""
    folder = (ROOT / "docs" / page).parent

    def link(found: re.Match[str]) -> str:
        path = Path(os.path.normpath(folder / found[2].partition("#")[0]))
        if "://" in found[2] or path.is_relative_to(ROOT / "docs") or not path.exists():
            return found[0]
        return f"{found[1]}{SOURCES}{path.relative_to(ROOT)})"

    if source[0].startswith("# ") and page.endswith("/index"):
        source[0] += _rest(folder, source[0])
    text = re.sub(r"^<!-- (\w+) -->$", lambda found: TEXTS[found[1]](), source[0], flags=re.MULTILINE)
    source[0] = re.sub(r"(\]\()([^)\s]+)\)", link, text)


def _rest(folder: Path, index: str) -> str:
    """Return the list of the pages of a folder that its index does not name."""
    pages = sorted(file.stem for file in folder.iterdir() if file.suffix in (".md", ".py", ".ipynb"))
    rest = [page for page in pages if page != "index" and not re.search(rf"^{page}$", index, re.MULTILINE)]
    return "\n```{toctree}\n:maxdepth: 1\n\n" + "\n".join(rest) + "\n```\n" if rest else ""


def _clean(app: Sphinx, what: str, name: str, object_: Any, options: Any, lines: list[str]) -> None:
    """Let bars be bars, and write names of C++ in docstrings as those of Python, with links to methods."""
    lines[:] = ["" if line.strip() == "|" else re.sub(r"\|(\w+)\|", r"\\|\1\\|", line) for line in lines]
    home = name.removeprefix("openmmhelfrich.").removeprefix("helfrich.").partition(".")[0]
    if getattr(mh.helfrich, home, None) is None:
        return
    for number, line in enumerate(lines):
        line = re.sub(r"\b([A-Z]\w+)::(\w+)", r"\1.\2", line)
        line = re.sub(r":py:class:`(Integrator|Force|Context)`", r"openmm.\1", line)
        line = re.sub(r"^ (?=- |  \S)", "", line)  # SWIG indents lists
        lines[number] = re.sub(r"(?<![\w.:`])([a-z]\w+)\(\)", lambda found: _method(home, found), line)


def _method(home: str, found: re.Match[str]) -> str:
    hasMethod = found[1] in vars(getattr(mh.helfrich, home))
    public = "openmmhelfrich" if home in mh.__all__ else "openmmhelfrich.helfrich"
    return f":meth:`~{public}.{home}.{found[1]}`" if hasMethod else f"``{found[0]}``"


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("source-read", _fill)
    app.connect("autodoc-process-docstring", _clean, priority=100)  # before napoleon
    return {"parallel_read_safe": True}
