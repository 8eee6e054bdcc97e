"""Configurations of TriMem (https://github.com/bio-phys/trimem) converted to ours.

TriMem's energies are multiples of a unit in which its initial temperature is a number, 1 as a rule; ours are multiples
of kT at that temperature, which is called 300 K here.  Its targets are fractions of the mesh's own area, volume and
mean curvature; ours are areas and volumes.  Terms and their exponents are the same.
"""

import configparser
import io
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..files import PathLike
from ..geometry.mesh import Mesh
from ..messages import quoted, shortened
from ..units import thermalEnergy
from .config import parseConfig
from .configfile import configText

TEMPERATURE = 300.0
MINIMAL_TEMPERATURE = 1e-6  # in TriMem's unit
LARGEST_WINDOWS = 20

# What concerns the way in which TriMem computes or prints, and has no counterpart.
_WITHOUT_COUNTERPART = {
    "general": {"output_format", "restart_prefix"},
    "surfacerepulsion": {"n_search", "rlist", "refresh"},
    "bonds": {"a0"},
    "minimization": {"out_every"},
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
    data, comments = converted(Source(path))
    parseConfig(data, str(path))
    return configText(
        data, [f"Converted from TriMem's {path.name}.  300 K stands for its initial temperature.", *comments]
    )


class Source:
    """TriMem's configuration, which notes the keys that were asked for."""

    def __init__(self, path: Path) -> None:
        if not path.exists():
            raise FileNotFoundError(f"there is no configuration file {path}")
        self.stem = str(path.with_suffix(""))
        self._parser, self.path = configparser.ConfigParser(inline_comment_prefixes=("#", ";")), path
        self.stepsDone = 0  # before this run
        self._asked: set[tuple[str, str]] = set()
        try:
            self._parser.read_string(path.read_text(encoding="utf-8"))
        except (configparser.Error, UnicodeDecodeError) as error:
            raise ValueError(
                f"{path} is not a configuration of TriMem: {shortened(' '.join(str(error).split()))}"
            ) from None
        if not self._parser.has_section("ENERGY"):
            raise ValueError(f"{path} is not a configuration of TriMem: it has no section [ENERGY]")
        self.mesh = Path(self.text("GENERAL", "input", str(path.with_suffix(".stl"))))
        if not self.mesh.exists():
            raise FileNotFoundError(
                f"there is no mesh file {self.mesh}, which {path} names; its area and edge lengths are needed"
            )
        self.stepsDone = self._counted(self.text("HMC", "init_step", "{}"))

    def goOnFrom(self, checkpoint: Mapping[str, str]) -> None:
        """Take from a checkpoint what TriMem takes: continuation_lambda, continuation_delta, and init_step unless the
        configuration has it.
        """
        for key in ("continuation_lambda", "continuation_delta"):
            if key in checkpoint:
                self._parser["ENERGY"][key] = checkpoint[key]
        if not self._parser.has_option("HMC", "init_step"):
            self.stepsDone = self._counted(checkpoint.get("init_step", "{}"))

    def textAfter(self, progress: float, steps: int) -> str:
        """Return the text of the configuration that goes on from here, as checkpoints have it, from the lambda that was
        reached and the number of steps made.
        """
        parser = configparser.ConfigParser(interpolation=None)
        for section in self._parser.sections():
            parser[section] = {key: self._parser.get(section, key, raw=True) for key in self._parser[section]}
        for section in ("ENERGY", "HMC"):
            if not parser.has_section(section):
                parser.add_section(section)
        parser["ENERGY"]["continuation_lambda"] = repr(progress)
        parser["ENERGY"]["continuation_delta"] = repr(self.number("ENERGY", "continuation_delta", 0.0))
        parser["HMC"]["init_step"] = json.dumps({"move": self.stepsDone + steps, "flip": 0}) if steps else "{}"
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

    def text(self, section: str, key: str, default: str | None) -> Any:
        """Return a value as a string."""
        self._asked.add((section.lower(), key))
        try:
            return self._parser.get(section, key, fallback=default)
        except configparser.Error as error:
            raise ValueError(f"{self.path}: {shortened(' '.join(str(error).split()))}") from None

    def number(self, section: str, key: str, default: float) -> Any:
        """Return a value as a number of the type of the default."""
        text = self.text(section, key, None)
        try:
            value = default if text is None else type(default)(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise ValueError(
                f"{self.path}: [{section}] {key} is {quoted(text)}; it must be "
                f"{'a whole number' if isinstance(default, int) else 'a number'}"
            )
        return value

    def meshForAnyFolder(self) -> Path:
        """Return the mesh file as our configuration names it, relative to its own folder: that is not known unless
        TriMem's is in the present one.
        """
        return self.mesh if self.path.parent == Path() else self.mesh.resolve()

    def leftOut(self) -> list[str]:
        """Return a comment on the keys that had no counterpart, and one on those that are unknown."""
        keys = [
            (section, key)
            for section in self._parser.sections()
            for key in self._parser[section]
            if (section.lower(), key) not in self._asked
        ]
        known = [key for section, key in keys if key in _WITHOUT_COUNTERPART.get(section.lower(), ())]
        unknown = [
            f"[{section}] {key}" for section, key in keys if key not in _WITHOUT_COUNTERPART.get(section.lower(), ())
        ]
        lines = [f"Without a counterpart, and not needed: {', '.join(known)}."] if known else []
        return [*lines, f"Unknown, and left out: {', '.join(unknown)}."] if unknown else lines


def converted(source: Source) -> tuple[dict[str, Any], list[str]]:
    """Return our configuration as a nested dict, and comments on it."""
    mesh = Mesh.read(source.mesh)
    try:
        mesh.check()
    except ValueError as error:
        raise ValueError(f"{source.mesh}: {error}") from None
    if source.text("BONDS", "bond_type", "Edge") != "Edge":
        raise ValueError(f"{source.path}: [BONDS] bond_type is not Edge; only tethers of edges have a counterpart")
    unit = source.number("HMC", "initial_temperature", 1.0)
    if unit <= 0:
        raise ValueError(f"{source.path}: [HMC] initial_temperature is {unit:g}; it must be positive")

    def energy(key: str) -> float:
        return source.number("ENERGY", key, 1.0) / unit

    length = float(mesh.edgeLengths.mean())
    moduli = {
        "bending_modulus": energy("kappa_b"),
        "area_modulus": energy("kappa_a"),
        "volume_modulus": energy("kappa_v"),
        "area_difference_modulus": energy("kappa_c"),
    }
    start, end = _targets(source, mesh)
    for name in [name for name in start if not moduli[name.removeprefix("target_") + "_modulus"]]:
        del start[name], end[name]  # of a term that is off
    data: dict[str, Any] = {
        "mesh": {"file": str(source.meshForAnyFolder())},
        "membrane": {**moduli, **start},
        "tether": {
            "modulus": energy("kappa_t"),
            "min_length": source.number("BONDS", "lc1", 0.75 * length),
            "max_length": source.number("BONDS", "lc0", 1.25 * length),
            "exponent": source.number("BONDS", "r", 2),
        },
        "sampling": _sampling(source, unit),
        "output": _output(source),
    }
    onset, modulus = source.number("SURFACEREPULSION", "lc1", 0.0), energy("kappa_r")
    exponent, level = source.number("SURFACEREPULSION", "r", 2), source.number("SURFACEREPULSION", "exclusion_level", 2)
    if onset > 0 and modulus > 0:
        data["repulsion"] = {"modulus": modulus, "onset": onset, "exponent": exponent, "exclusion_level": level}
    data["stages"], comments = _stages(source, start, end)
    return data, [*comments, *source.leftOut()]


def _targets(source: Source, mesh: Mesh) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return our targets, of each surface by itself, at TriMem's continuation_lambda, and at its lambda of 1."""
    surfaces = mesh.components()
    own = {
        "target_area": ("area_fraction", [surface.area for surface in surfaces]),
        "target_volume": ("volume_fraction", [surface.volume for surface in surfaces]),
        "target_area_difference": (
            "curvature_fraction",
            [2 * float(surface.vertexMeanCurvatures.sum()) for surface in surfaces],
        ),
    }
    fractions = {name: source.number("ENERGY", key, 1.0) for name, (key, _) in own.items()}

    def at(progress: float) -> dict[str, Any]:
        values = {
            name: [(1 - progress * (1 - fractions[name])) * value for value in each] for name, (_, each) in own.items()
        }
        return {name: each[0] if len(each) == 1 else each for name, each in values.items()}

    return at(source.number("ENERGY", "continuation_lambda", 1.0)), at(1.0)


def _sampling(source: Source, unit: float) -> dict[str, Any]:
    """Return our section [sampling]."""
    fraction = source.number("HMC", "flip_ratio", 0.1)
    mass = source.number("HMC", "momentum_variance", 1.0)
    # A step is as long against the motion of a vertex when step^2 energy/(mass length^2) is the same number.
    step = source.number("HMC", "step_size", 1.0) * math.sqrt(unit / thermalEnergy(TEMPERATURE))
    return {
        "temperature": TEMPERATURE,
        "step_size": step,
        "steps_per_trajectory": source.number("HMC", "traj_steps", 10),
        "mass": mass,
        "flip_fraction": 0.0 if source.text("HMC", "flip_type", "serial") == "none" else fraction,
        "multilevel_weight": 0.0,  # TriMem has plain trajectories
    }


def _output(source: Source) -> dict[str, Any]:
    """Return our section [output]."""
    output = {"prefix": source.text("GENERAL", "output_prefix", source.stem)}
    if Path(output["prefix"] + ".ply").resolve() == source.mesh.resolve():  # which the final mesh would replace
        output["mesh_format"] = "vtu"
    for key, value in (
        ("trajectory_interval", source.number("HMC", "thin", 10)),
        ("observables_interval", source.number("GENERAL", "info", 1)),
        ("checkpoint_interval", source.number("GENERAL", "checkpoint_every", 0)),
    ):
        if value > 0:
            output[key] = value
    return output


def _stages(source: Source, start: dict[str, float], end: dict[str, float]) -> tuple[list[dict[str, Any]], list[str]]:
    """Return our stages, and comments on them."""
    iterations, steps = source.number("MINIMIZATION", "maxiter", 10), source.number("HMC", "num_steps", 10)
    rate, first = source.number("HMC", "cooling_factor", 1e-4), source.number("HMC", "start_cooling", 0)
    first -= source.stepsDone
    cold = max(math.exp(min(0.0, rate * min(first, 0))), MINIMAL_TEMPERATURE)  # by the steps before
    first = max(first, 0)
    delta, progress = (
        source.number("ENERGY", "continuation_delta", 0.0),
        source.number("ENERGY", "continuation_lambda", 1.0),
    )
    if source.text("GENERAL", "algorithm", "hmc") == "minimize":
        isTethered = source.number("ENERGY", "kappa_t", 1.0) > 0
        return [
            {"kind": "minimize", "fluid": False, "max_iterations": iterations, "within_bounds": isTethered},
        ], []
    stages, comments = [], []
    if delta > 0 and progress < 1 and start != end:
        moving = min(math.ceil((1 - progress) / delta), steps)
        reached = min(1.0, moving * delta / (1 - progress))
        windows = min(LARGEST_WINDOWS, moving)
        goals = {name: start[name] + reached * (end[name] - start[name]) for name in start if end[name] != start[name]}
        stages.append(
            {
                "kind": "continue",
                "windows": windows,
                "equilibration": 0,
                "steps": max(1, round(moving / (windows + 1))),
                **goals,
            }
        )
        comments.append(f"lambda moves in {windows} windows instead of at every step.")
        steps, first = steps - moving, first - moving
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
