"""Settings: what of a scene can be traded, and the values to try.

A setting is a dict of configuration keys, like "sampling.flip_fraction", and their values; what it does not name is as
the scene has it.
"""

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias, get_args

from ..runs.config import Config, asDict, parseConfig, sections, valueOf
from ..runs.sections import MODULI

COARSER = "mesh.icosphere"
TETHER_LENGTHS = ("tether.length_scale", "tether.min_length", "tether.max_length")

# Of moves that help each other no single one may pay: more flips let the shape relax that kept momenta carry away.
TOGETHER = {
    "sampling.flip_fraction": 1.0,
    "sampling.trajectory_jitter": 0.3,
    "sampling.momentum_refreshment": 0.5,
    "sampling.target_acceptance": 0.9,
}


Setting: TypeAlias = Mapping[str, Any]


@dataclass(frozen=True)
class Axis:
    """Something that can be traded.

    Attributes
    ----------
    name : str
        what it is called
    choices : list of dict
        settings of its keys to try
    isOffered : bool
        whether a choice may be recommended; otherwise it is measured to compare with
    """

    name: str
    choices: list
    isOffered: bool = True

    @property
    def isExact(self) -> bool:
        """Whether all choices sample the same distribution."""
        return all(map(isExact, self.choices))


def axes(config: Config, scene: Config, edge: float) -> list[Axis]:
    """Return every Axis of a scene, in the order in which a search goes through them: what others depend on comes
    first.

    Parameters
    ----------
    config : Config
        the scene as it was written
    scene : Config
        the same with every default filled in
    edge : float
        the mean length of its edges
    """
    return [
        axis
        for axis in (
            Axis("tether", _tethers(scene, edge)),
            Axis("moves together", [TOGETHER]),
            Axis("flip fraction", _each("sampling.flip_fraction", [0.03, 0.1, 0.3, 1.0])),
            Axis("shear waves", _each("sampling.shear_wave_probability", [0.0, 0.1, 0.3])),
            Axis("coarser meshes", _each("sampling.multilevel_weight", [0.0, 1.0, 2.0])),
            Axis("length", _each("sampling.steps_per_trajectory", [10, 30, 100, 300, 1000])),
            Axis("jitter", _each("sampling.trajectory_jitter", [0.0, 0.5])),
            # Rejections turn kept momenta back, so that they want to be rare.
            Axis(
                "momenta",
                [
                    {"sampling.momentum_refreshment": part, "sampling.target_acceptance": aim}
                    for part, aim in ((1.0, 0.75), (0.5, 0.9), (0.3, 0.9))
                ],
            ),
            Axis("flip probability", _each("sampling.flip_probability", [0.2, 0.5, 0.8])),
            Axis("acceptance", _each("sampling.target_acceptance", [0.6, 0.75, 0.9])),
            Axis("integrator", _literals("sampling.integrator")),
            Axis("tether substeps", _each("sampling.tether_substeps", [1, 2, 4])),
            Axis("precision", _literals("platform.precision")),
            Axis("constraints", _softer(scene)),
            Axis("resolution", _coarser(config)),
            Axis("terms", _without(scene), isOffered=False),
        )
        if axis.choices
    ]


def apply(config: Config, setting: Setting, asWritten: bool = False) -> Config:
    """Return a Config changed by a setting, or raise a ValueError if this has a value that is not allowed.

    Parameters
    ----------
    config : Config
        what to change
    setting : dict
        the values to change
    asWritten : bool
        leave all else to the defaults that its file left it to, and not to what the Config has
    """
    data = asDict(config, onlyGiven=asWritten)
    for name, value in setting.items():
        section, key = name.split(".")
        data.setdefault(section, {})[key] = value
    return parseConfig(data, "setting")


def changes(scene: Config, setting: Setting, choice: Setting) -> bool:
    """Return whether a choice is anything new beside a setting."""
    return any(
        setting.get(name, valueOf(scene, name) if name != COARSER else None) != value for name, value in choice.items()
    )


def tetherOf(scene: Config) -> dict[str, Any]:
    """Return the tether of a scene with every default filled in, as a setting."""
    return {name: valueOf(scene, name) for name in ("tether.modulus", *TETHER_LENGTHS)}


def forEdges(setting: Setting, ratio: float) -> dict[str, Any]:
    """Return a setting for a mesh whose edges are longer by a ratio: with a tether that is the same if lengths are
    measured by edges.
    """
    return {name: value * ratio if name in TETHER_LENGTHS else value for name, value in setting.items()}


def isExact(setting: Setting) -> bool:
    """Return whether a setting samples the scene's own distribution, so that averages differ by statistical errors
    alone.
    """
    return all(name.split(".")[0] in ("sampling", "platform") for name in setting)


def keyOf(setting: Setting) -> str:
    """Return a string that is the same for equal settings."""
    return json.dumps(setting, sort_keys=True)


def describe(setting: Setting) -> str:
    """Return a setting in a few words."""
    return (
        ", ".join(
            f"{_title(name)} {value:.4g}" if isinstance(value, float) else f"{_title(name)} {value}"
            for name, value in setting.items()
        )
        or "as it stands"
    )


def moduliRatios(scene: Config, setting: Setting) -> dict[str, float]:
    """Return, for each term whose modulus a setting changes, the ratio of the scene's to its own, which reweighting
    needs; empty if that cannot correct the setting.
    """
    own = {term: setting[name] for term, name in MODULI.items() if name in setting}
    if (
        0 in own.values()
        or COARSER in setting
        or any(setting.get(name, value) != value for name, value in tetherOf(scene).items() if name in TETHER_LENGTHS)
    ):
        return {}
    ratios = {term: valueOf(scene, MODULI[term]) / value for term, value in own.items()}
    return {term: ratio for term, ratio in ratios.items() if ratio != 1}


def _title(name: str) -> str:
    section, key = name.split(".")
    return (f"{section} {key}" if section in ("mesh", "tether", "repulsion") else key).replace("_", " ")


def tetherPath(scene: Config, edge: float, stages: int = 6) -> list[dict[str, Any]]:
    """Return settings that lead from a tether with the scene's bounds with which edges flip easily to the scene's own:
    an abruptly stiffer one would set free what bends the membrane out of shape.

    The easy one costs 20 kT for an edge of 1.45 mean lengths: a softer one lets needle-shaped triangles in.
    """
    own, r = tetherOf(scene), scene.tether.exponent
    modulus, excess = (
        own["tether.modulus"] * (edge / own["tether.length_scale"]) ** r,
        1.45 - own["tether.max_length"] / edge,
    )
    easy = 20 / (r ** (r + 1) * excess**r) if excess > 0 else math.inf
    if modulus <= easy:
        return [own]
    loose = {**own, "tether.length_scale": edge, "tether.modulus": easy}
    return [
        {name: loose[name] * (own[name] / loose[name]) ** (stage / stages) for name in own}
        for stage in range(stages + 1)
    ]


def _naturalTether(edge: float, modulus: float, least: float, greatest: float) -> dict[str, Any]:
    return {
        "tether.length_scale": edge,
        "tether.modulus": modulus,
        "tether.min_length": least * edge,
        "tether.max_length": greatest * edge,
    }


def _tethers(scene: Config, edge: float) -> list[dict[str, Any]]:
    """Return a tether softer than the scene's, and some for which edges have the length 1, with the scene's bounds and
    with others.

    There, the wall against short edges, which goes as l^-r, is softer against the spring that holds long ones, which
    goes as l^r.
    """
    modulus, least, greatest = (valueOf(scene, f"tether.{key}") for key in ("modulus", "min_length", "max_length"))
    if modulus == 0:
        return []
    least, greatest = float(least / edge), float(greatest / edge)
    natural = [
        _naturalTether(edge, *tether)
        for tether in ((100.0, least, greatest), (25.0, least, greatest), (100.0, 0.85, 1.35), (50.0, 0.9, 1.4))
    ]
    return [{"tether.length_scale": scene.tether.length_scale, "tether.modulus": 0.1 * modulus}, *natural]


def _softer(scene: Config) -> list[dict[str, Any]]:
    """Return settings with weaker constraints of area and volume."""
    moduli = {MODULI[term]: valueOf(scene, MODULI[term]) for term in ("area", "volume")}
    return [
        {name: modulus * factor for name, modulus in moduli.items() if modulus > 0}
        for factor in (0.1, 0.01)
        if any(moduli.values())
    ]


def _coarser(config: Config) -> list[dict[str, Any]]:
    """Return a quarter of the vertices, for a mesh that can be made anew."""
    return _each(COARSER, [config.mesh.icosphere - 1]) if config.mesh.icosphere else []


def _without(scene: Config) -> list[dict[str, Any]]:
    """Return settings that leave out a term each.  Bending stays: without it there is no membrane."""
    return [{name: 0.0} for term, name in MODULI.items() if term != "bending" and valueOf(scene, name) != 0]


def _literals(name: str) -> list[dict[str, Any]]:
    """Return the values of a key that takes one of a few, if this version has it."""
    section, key = name.split(".")
    field = sections()[section].model_fields.get(key)
    return _each(name, get_args(field.annotation)) if field else []


def _each(name: str, values: Iterable[Any]) -> list[dict[str, Any]]:
    return [{name: value} for value in values]
