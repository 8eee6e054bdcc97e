"""Configurations of TriMem (https://github.com/bio-phys/trimem) converted to ours.

TriMem's energies are multiples of a unit in which its initial temperature is a number, 1 as a rule; ours are multiples
of kT at that temperature, which is called 300 K here.  Its targets are fractions of the mesh's own area, volume and
mean curvature; ours are areas and volumes.  Terms and their exponents are the same.
"""

import configparser
import contextlib
import difflib
import io
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from ..files import PathLike
from ..geometry.mesh import Mesh
from ..messages import quoted, shortened
from ..units import thermalEnergy
from .config import parseConfig
from .configfile import configText
from .sections import GREATEST, GREATEST_COUNT, GREATEST_WHOLE, LEAST

TEMPERATURE = 300.0
MINIMAL_TEMPERATURE = 1e-6  # in TriMem's unit
LARGEST_WINDOWS = 20
ANY = (-GREATEST_WHOLE, GREATEST_WHOLE)  # whole numbers

Targets: TypeAlias = Callable[[float], dict[str, Any]]


class Key(NamedTuple):
    """A key of TriMem's.

    Attributes
    ----------
    ours : str or None
        the section and key here that have its value, "" if it decides on more, None if it is not needed
    default : object
        of the type that its values have; NaN and None where it depends on the mesh or the file
    least, most : float
        what is allowed, if its values are numbers
    choices : tuple of str
        what is allowed, if only some words are
    """

    ours: str | None
    default: Any = None
    least: float = 0.0
    most: float = GREATEST
    choices: tuple[str, ...] = ()


# Every key of TriMem's.
_KEYS = {
    "GENERAL": {
        "algorithm": Key("", "hmc", choices=("hmc", "minimize")),
        "input": Key("mesh.file"),
        "info": Key("output.observables_interval", 1, *ANY),
        "output_prefix": Key("output.prefix"),
        "restart_prefix": Key(None),
        "checkpoint_every": Key("output.checkpoint_interval", 0, *ANY),
        "output_format": Key(None, "vtu", choices=("vtu", "xyz", "xdmf")),
    },
    "BONDS": {
        "bond_type": Key("", "Edge", choices=("Edge", "Area")),
        "r": Key("tether.exponent", 2, 1, 100),
        "lc0": Key("tether.max_length", math.nan, LEAST),
        "lc1": Key("tether.min_length", math.nan, LEAST),
        "a0": Key(None),
    },
    "SURFACEREPULSION": {
        "n_search": Key(None, "cell-list", choices=("cell-list", "verlet-list")),
        "rlist": Key(None),
        "refresh": Key(None),
        "exclusion_level": Key("repulsion.exclusion_level", 2, 0, 2),
        "lc1": Key("repulsion.onset", 0.0),
        "r": Key("repulsion.exponent", 2, 1, 100),
    },
    "ENERGY": {
        "kappa_b": Key("membrane.bending_modulus", 1.0),
        "kappa_a": Key("membrane.area_modulus", 1.0),
        "kappa_v": Key("membrane.volume_modulus", 1.0),
        "kappa_c": Key("membrane.area_difference_modulus", 1.0),
        "kappa_t": Key("tether.modulus", 1.0),
        "kappa_r": Key("repulsion.modulus", 1.0),
        "area_fraction": Key("membrane.target_area", 1.0, LEAST),
        "volume_fraction": Key("membrane.target_volume", 1.0, LEAST),
        "curvature_fraction": Key("membrane.target_area_difference", 1.0, -GREATEST),
        "continuation_delta": Key("", 0.0),
        "continuation_lambda": Key("", 1.0),
    },
    "HMC": {
        "num_steps": Key("stages.steps", 10, 1, GREATEST_WHOLE),
        "init_step": Key("", "{}"),
        "step_size": Key("sampling.step_size", 1.0, LEAST),
        "traj_steps": Key("sampling.steps_per_trajectory", 10, 1, GREATEST_COUNT),
        "momentum_variance": Key("sampling.mass", 1.0, LEAST),
        "thin": Key("output.trajectory_interval", 10, *ANY),
        "flip_ratio": Key("sampling.flip_fraction", 0.1),
        "flip_type": Key("", "serial", choices=("none", "serial", "parallel")),
        "initial_temperature": Key("", 1.0, LEAST),
        "cooling_factor": Key("stages.rate", 1e-4),
        "start_cooling": Key("stages.cooling_start", 0, *ANY),
    },
    "MINIMIZATION": {"maxiter": Key("stages.max_iterations", 10, 1, GREATEST_COUNT), "out_every": Key(None)},
}
_EACH = [(section, name, key) for section, keys in _KEYS.items() for name, key in keys.items()]
# What else advice names that is not TriMem's, and what there is instead, the longer before its parts.
_CONVERSION = "what openmm-helfrich config --from-trimem {file} writes"
_WORDS = {
    "sampling.approach, or a stage of kind approach or continue that takes longer": (
        "continuation_lambda = 0, a smaller continuation_delta and a larger num_steps"
    ),
    "in a stage of kind approach or continue": "by continuation_lambda = 0 and a smaller continuation_delta",
    "in a stage of kind approach that has them": "by continuation_delta in a run with algorithm = hmc",
    "in a stage of kind sample or approach": "by a run with algorithm = hmc",
    "a stage of kind approach before it": "a run with algorithm = hmc and continuation_delta before it",
    "max_iterations, tolerance": "maxiter",
    ', or step_size = "auto"': f', or one that is found, as step_size = "auto" put into {_CONVERSION} asks for',
    ', or "auto", or none': "",
    "a multilevel_weight": "a weight of momenta on coarser meshes",
    "more steps, or a shorter burn_in or equilibration": "a larger num_steps",
    "flip_probability = 0": "flip_type = none",
    "bounds of the tether let": "bounds of the tether (lc0, lc1) let",
    "bounds of the tether keep": "bounds of the tether (lc0, lc1) keep",
    "onset of the repulsion": "lc1 of [SURFACEREPULSION]",
    "out of [tether]": "out of [BONDS]",
    "[output] psf = true": f"psf = true in [output] of {_CONVERSION}",
}


def convertConfig(file: PathLike) -> str:
    """Return the text of our configuration file for one of TriMem's.

    Parameters
    ----------
    file : path
        TriMem's configuration, in INI format; the mesh that it names is read too

    Raises
    ------
    FileNotFoundError
        if the file or the mesh is missing
    ValueError
        if it is not a configuration of TriMem, or asks for what there is no counterpart of
    """
    path = Path(file)
    source = Source(path)
    data, comments = converted(source)
    with source.namingItsKeys():
        parseConfig(data, str(path))
    return configText(
        data, [f"Converted from TriMem's {path.name}.  300 K stands for its initial temperature.", *comments]
    )


class Source:
    """TriMem's configuration."""

    def __init__(self, path: Path) -> None:
        if not path.exists():
            raise FileNotFoundError(f"there is no configuration file {path}")
        self.stem = str(path.with_suffix(""))
        self._parser, self.path = configparser.ConfigParser(inline_comment_prefixes=("#", ";")), path
        self.stepsDone = 0  # before this run
        try:
            self._parser.read_string(path.read_text(encoding="utf-8"))
        except (configparser.Error, UnicodeDecodeError) as error:
            raise ValueError(
                f"{path} is not a configuration of TriMem: {shortened(' '.join(str(error).split()))}"
            ) from None
        if not self._parser.has_section("ENERGY"):
            raise ValueError(f"{path} is not a configuration of TriMem: it has no section [ENERGY]")
        self._checkChoices()
        self.mesh = Path(self.text("GENERAL", "input", str(path.with_suffix(".stl"))))
        if not self.mesh.exists():
            raise FileNotFoundError(
                f"there is no mesh file {self.mesh}, which {path} names; its area and edge lengths are needed"
            )
        self.stepsDone = self._counted(self.text("HMC", "init_step"))

    @property
    def minimizes(self) -> bool:
        """Whether it asks for a minimization, rather than for sampling."""
        return bool(self.text("GENERAL", "algorithm") == "minimize")

    def goOnFrom(self, checkpoint: Mapping[str, str]) -> None:
        """Take from a checkpoint what TriMem takes: continuation_lambda, continuation_delta, and init_step unless the
        configuration has it.
        """
        for key in ("continuation_lambda", "continuation_delta"):
            if key in checkpoint:
                self._parser["ENERGY"][key] = checkpoint[key]
        if not self._parser.has_option("HMC", "init_step"):
            self.stepsDone = self._counted(checkpoint.get("init_step", "{}"))

    def textAfter(self, steps: int) -> str:
        """Return the text of the configuration that goes on after a number of steps, as checkpoints have it."""
        progress, delta = (self.number("ENERGY", f"continuation_{name}") for name in ("lambda", "delta"))
        reached = progress if progress >= 1 else min(1.0, progress + delta * steps)
        parser = configparser.ConfigParser(interpolation=None)
        for section in self._parser.sections():
            parser[section] = {key: self._parser.get(section, key, raw=True) for key in self._parser[section]}
        for section in ("ENERGY", "HMC"):
            if not parser.has_section(section):
                parser.add_section(section)
        parser["ENERGY"]["continuation_lambda"] = repr(reached)
        parser["ENERGY"]["continuation_delta"] = repr(delta)
        counters = {} if self.minimizes else {"move": self.stepsDone + steps, "flip": 0}
        parser["HMC"]["init_step"] = json.dumps(counters)
        text = io.StringIO()
        parser.write(text)
        return text.getvalue()

    def _counted(self, text: str) -> int:
        """Return the sum of TriMem's counters of steps."""
        try:
            counters = json.loads(text)
            if not all(isinstance(count, int) and count >= 0 for count in counters.values()):
                raise ValueError
        except (ValueError, AttributeError):
            raise ValueError(
                f'{self.path}: [HMC] init_step is {quoted(text)}; it must be like {{"move": 10, "flip": 5}}'
            ) from None
        return sum(counters.values())

    def _checkChoices(self) -> None:
        """Raise a ValueError if a key has none of the words that TriMem allows."""
        for section, name, key in _EACH:
            text = self.text(section, name)
            if key.choices and text not in key.choices:
                raise ValueError(
                    f"{self.path}: [{section}] {name} is {quoted(text)}; it must be one of {', '.join(key.choices)}"
                )

    def text(self, section: str, key: str, default: str | None = None) -> Any:
        """Return a value as a string, or a default, or TriMem's."""
        try:
            return self._parser.get(section, key, fallback=_KEYS[section][key].default if default is None else default)
        except configparser.Error as error:
            raise ValueError(f"{self.path}: {shortened(' '.join(str(error).split()))}") from None

    def number(self, section: str, key: str, default: float | None = None) -> Any:
        """Return a value as a number, or a default, or TriMem's.  Raise a ValueError if it is not allowed."""
        allowed, given = _KEYS[section][key], self.text(section, key)
        if not isinstance(given, str):
            return given if default is None else default
        try:
            value = type(allowed.default)(given)
        except ValueError:
            value = math.nan
        if not allowed.least <= value <= allowed.most:
            kind = "a whole number" if isinstance(allowed.default, int) else "a number"
            limits = f"from {allowed.least:g} to {allowed.most:g}"
            shown = quoted(given) if math.isnan(value) else shortened(given)
            raise ValueError(f"{self.path}: [{section}] {key} is {shown}; it must be {kind} {limits}")
        return value

    @contextlib.contextmanager
    def namingItsKeys(self) -> Iterator[None]:
        """Name, in a ValueError about keys of ours, the keys that they come from, and their values."""
        try:
            yield
        except ValueError as error:
            text = str(error)
            for section, name, key in _EACH:
                if key.ours:
                    text = self._renamed(text, section, name, *key.ours.split("."))
            text = self.inItsWords(text)
            if text == str(error):
                raise
            raise ValueError(text) from None

    def inItsWords(self, text: str) -> str:
        """Return advice or a note with TriMem's keys in the place of ours, and with what there is instead where it has
        none.  Keys of one word, as prefix, are left where they have no section, and so are names of files.
        """
        for ours, its in _WORDS.items():
            text = text.replace(ours, its.format(file=self.path))
        for section, name, key in _EACH:
            if key.ours:
                ourSection, ourKey = key.ours.split(".")
                text = re.sub(rf"\[{ourSection}\] {ourKey}\b", f"[{section}] {name}", text)
                if "_" in ourKey:
                    text = re.sub(rf"(?<![\w./-]){ourKey}(?![\w/-]|\.\w)", name, text)
        return text

    def _renamed(self, text: str, section: str, key: str, ourSection: str, ourKey: str) -> str:
        """Return a message with a key of TriMem's in the place of ours, and its value beside another one of ours."""
        own = self.text(section, key)

        def renamed(match: re.Match[str]) -> str:
            value = match["value"]
            if value is None or not isinstance(own, str):
                return f"[{section}] {key}" + ("" if value is None else f" is {value}")
            return f"[{section}] {key} is {shortened(own)}" + ("" if _areSame(own, value) else f", here {value}")

        place = rf"(?:\[{ourSection}\]|stage \d+ \(\w+\)) {ourKey}\b(?:\[\d+\])?"
        return re.sub(rf"{place}(?: is (?P<value>\[.*?\]|[^\s;,]+))?", renamed, text)

    def meshForAnyFolder(self) -> Path:
        """Return the mesh file as our configuration names it, relative to its own folder: that is not known unless
        TriMem's is in the present one.
        """
        return self.mesh if self.path.parent == Path() else self.mesh.resolve()

    def leftOut(self) -> list[str]:
        """Return a comment on the keys that are not needed, and that on those that are unknown."""
        keys = [name for section, name, key in _EACH if key.ours is None and self._parser.has_option(section, name)]
        return [*([f"Without a counterpart, and not needed: {', '.join(keys)}."] if keys else []), *self.unknown()]

    def unknown(self) -> list[str]:
        """Return a comment on the keys that are unknown, if there are any."""
        keys = [(section, key) for section in self._parser.sections() for key in self._parser[section]]
        unknown = [_unknown(section, key) for section, key in keys if key not in _KEYS.get(section, ())]
        return [f"Unknown, and left out: {', '.join(unknown)}."] if unknown else []


def _unknown(section: str, key: str) -> str:
    """Return a key that TriMem does not know, and the one that it resembles."""
    meant = difflib.get_close_matches(f"[{section}] {key}", [f"[{other}] {name}" for other, name, _ in _EACH], n=1)
    return f"[{section}] {key}" + (f" (did you mean {meant[0]}?)" if meant else "")


def _areSame(text: str, value: str) -> bool:
    """Return whether a text and a value of a message are the same text, or the same number as far as this shows it."""
    try:
        return math.isclose(float(text), float(value), rel_tol=1e-4)
    except ValueError:
        return text == value.strip("'")


def converted(source: Source) -> tuple[dict[str, Any], list[str]]:
    """Return our configuration as a nested dict, and comments on it."""
    mesh = Mesh.read(source.mesh)
    try:
        mesh.check()
    except ValueError as error:
        raise ValueError(f"{source.mesh}: {error}") from None
    unit = source.number("HMC", "initial_temperature")

    def energy(key: str) -> float:
        return source.number("ENERGY", key) / unit

    moduli = {
        "bending_modulus": energy("kappa_b"),
        "area_modulus": energy("kappa_a"),
        "volume_modulus": energy("kappa_v"),
        "area_difference_modulus": energy("kappa_c"),
    }
    targets = _targets(source, mesh, moduli)
    data: dict[str, Any] = {
        "mesh": {"file": str(source.meshForAnyFolder())},
        "membrane": {**moduli, **targets(source.number("ENERGY", "continuation_lambda"))},
        "tether": {"modulus": energy("kappa_t"), **_bonds(source, float(mesh.edgeLengths.mean()))},
        "sampling": _sampling(source, unit),
        "output": _output(source),
    }
    onset, exponent, level = (source.number("SURFACEREPULSION", key) for key in ("lc1", "r", "exclusion_level"))
    modulus = energy("kappa_r")
    if onset > 0 and modulus > 0:
        data["repulsion"] = {"modulus": modulus, "onset": onset, "exponent": exponent, "exclusion_level": level}
    data["stages"], comments = _stages(source, targets)
    return data, [*comments, *source.leftOut()]


def _bonds(source: Source, length: float) -> dict[str, Any]:
    """Return the bounds and the exponent of our section [tether], of a mesh with a mean edge length."""
    if source.text("BONDS", "bond_type") != "Edge":
        raise ValueError(
            f"{source.path}: [BONDS] bond_type is Area; it must be Edge, since only tethers of edges have a counterpart"
        )
    lower, upper = source.number("BONDS", "lc1", 0.75 * length), source.number("BONDS", "lc0", 1.25 * length)
    if lower >= upper:
        raise ValueError(f"{source.path}: [BONDS] lc1 is {lower:g} and lc0 {upper:g}; lc1 must be less")
    return {"min_length": lower, "max_length": upper, "exponent": source.number("BONDS", "r")}


def _targets(source: Source, mesh: Mesh, moduli: Mapping[str, float]) -> Targets:
    """Return what gives our targets at a lambda, of each surface by itself, without those of terms that are off."""
    surfaces = mesh.components()
    own = {
        "area": ("area_fraction", [surface.area for surface in surfaces]),
        "volume": ("volume_fraction", [surface.volume for surface in surfaces]),
        "area_difference": (
            "curvature_fraction",
            [2 * float(surface.vertexMeanCurvatures.sum()) for surface in surfaces],
        ),
    }
    fractions = {name: source.number("ENERGY", key) for name, (key, _) in own.items()}

    def at(progress: float) -> dict[str, Any]:
        values = {
            f"target_{name}": [(1 - progress * (1 - fractions[name])) * value for value in each]
            for name, (_, each) in own.items()
            if moduli[f"{name}_modulus"]
        }
        return {name: each[0] if len(each) == 1 else each for name, each in values.items()}

    return at


def _sampling(source: Source, unit: float) -> dict[str, Any]:
    """Return our section [sampling]."""
    fraction = source.number("HMC", "flip_ratio")
    mass = source.number("HMC", "momentum_variance")
    # A step is as long against the motion of a vertex when step^2 energy/(mass length^2) is the same number.
    step = source.number("HMC", "step_size") * math.sqrt(unit / thermalEnergy(TEMPERATURE))
    return {
        "temperature": TEMPERATURE,
        "step_size": step,
        "steps_per_trajectory": source.number("HMC", "traj_steps"),
        "mass": mass,
        "flip_fraction": 0.0 if source.text("HMC", "flip_type") == "none" else fraction,
        "multilevel_weight": 0.0,  # TriMem has plain trajectories
    }


def _output(source: Source) -> dict[str, Any]:
    """Return our section [output]."""
    output = {"prefix": source.text("GENERAL", "output_prefix", source.stem)}
    if Path(output["prefix"] + ".ply").resolve() == source.mesh.resolve():  # which the final mesh would replace
        output["mesh_format"] = "vtu"
    for key, value in (
        ("trajectory_interval", source.number("HMC", "thin")),
        ("observables_interval", source.number("GENERAL", "info")),
        ("checkpoint_interval", source.number("GENERAL", "checkpoint_every")),
    ):
        if value > 0:
            output[key] = value
    return output


def _stages(source: Source, targets: Targets) -> tuple[list[dict[str, Any]], list[str]]:
    """Return our stages, whose steps add up to TriMem's, and comments on them."""
    if source.minimizes:
        iterations, isTethered = source.number("MINIMIZATION", "maxiter"), source.number("ENERGY", "kappa_t") > 0
        return [
            {"kind": "minimize", "fluid": False, "max_iterations": iterations, "within_bounds": isTethered},
        ], []
    steps, rate = source.number("HMC", "num_steps"), source.number("HMC", "cooling_factor")
    first = source.number("HMC", "start_cooling") - source.stepsDone
    cold = max(math.exp(min(0.0, rate * min(first, 0))), MINIMAL_TEMPERATURE)  # by the steps before
    first, stages, comments = max(first, 0), [], []
    moving = _continuation(source, steps, targets)
    if moving is not None:
        stages.append(moving)
        comments.append(f"lambda moves in {moving['windows']} windows instead of at every step.")
        made = moving["steps"] * (moving["windows"] + 1)
        steps, first = steps - made, first - made
        if first < 0 and rate > 0:
            comments.append("Cooling begins after the continuation, and not during it.")
    if steps > 0:
        cools = rate > 0 and max(first, 0) < steps
        cooling = {
            "kind": "anneal",
            "steps": steps,
            "start_temperature": cold * TEMPERATURE,
            "end_temperature": MINIMAL_TEMPERATURE * TEMPERATURE,
            "rate": rate,
            "cooling_start": max(first, 0),
        }
        stages.append(cooling if cools else {"kind": "sample", "steps": steps})
    return stages, comments


def _continuation(source: Source, steps: int, targets: Targets) -> dict[str, Any] | None:
    """Return the stage in which lambda moves, of no more than a number of steps; None if it stays, or has a single
    step, before which it does not move.
    """
    delta, progress = source.number("ENERGY", "continuation_delta"), source.number("ENERGY", "continuation_lambda")
    if delta == 0 or progress >= 1 or steps == 1:
        return None
    moving = math.ceil(min((1 - progress) / delta, steps))
    start, end = targets(progress), targets(min(1.0, progress + moving * delta))
    goals = {name: end[name] for name in start if end[name] != start[name]}
    # A window more has its steps, too: that at lambda = 0.
    each = math.ceil(moving / (LARGEST_WINDOWS + 1))
    windows = max(1, moving // each - 1)
    return {"kind": "continue", "windows": windows, "equilibration": 0, "steps": each, **goals} if goals else None
