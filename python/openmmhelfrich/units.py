"""Units: kT, Quantities as numbers, and what a configuration may say instead of plain numbers, as in "80 kJ/mol", "0.5
um" or "37 C"; and whole numbers.

Nothing here imports OpenMM, unless it is given one of its Quantities: a configuration can be read without.
"""

import math
import numbers
import re
import sys
from dataclasses import dataclass
from typing import Any

from .messages import quoted, shortened

GAS_CONSTANT = 8.31446261815324  # J/mol/K
AVOGADRO_CONSTANT = 6.02214076e23  # 1/mol

# What 1 is of each unit, in OpenMM's.  Energies of a single membrane in joule are per membrane, not per mole.
_JOULE = AVOGADRO_CONSTANT / 1000
_THERMAL_ENERGY = ("kT", "kBT", "k_BT")
_ENERGIES = {
    "kJ_mol": 1.0,
    "kcal_mol": 4.184,
    "J_mol": 1e-3,
    "J": _JOULE,
    "fJ": 1e-15 * _JOULE,
    "aJ": 1e-18 * _JOULE,
    "zJ": 1e-21 * _JOULE,
    "eV": 1.602176634e-19 * _JOULE,
    "erg": 1e-7 * _JOULE,
}
_LENGTHS = {
    "pm": 1e-3,
    "A": 0.1,
    "Å": 0.1,
    "angstrom": 0.1,
    "nm": 1.0,
    "um": 1e3,
    "µm": 1e3,
    "μm": 1e3,
    "mm": 1e6,
    "cm": 1e7,
    "m": 1e9,
}
_VOLUMES = {"fL": 1e9, "aL": 1e6}
_FORCES = {
    "N": 1e-9 * _JOULE,
    "mN": 1e-12 * _JOULE,
    "uN": 1e-15 * _JOULE,
    "dyn": 1e-14 * _JOULE,
    "nN": 1e-18 * _JOULE,
    "pN": 1e-21 * _JOULE,
}
_PRESSURES = {
    "Pa": 1e-27 * _JOULE,
    "kPa": 1e-24 * _JOULE,
    "MPa": 1e-21 * _JOULE,
    "bar": 1e-22 * _JOULE,
    "atm": 101325e-27 * _JOULE,
}
# Of each factor of a unit, its size and its powers of energy and length.
_FACTORS = {"1": (1.0, 0, 0)} | {
    name: (size, energy, length)
    for sizes, energy, length in (
        (_ENERGIES, 1, 0),
        (_LENGTHS, 0, 1),
        (_VOLUMES, 0, 3),
        (_FORCES, 1, -1),
        (_PRESSURES, 1, -3),
    )
    for name, size in sizes.items()
}
# A factor of a unit as it is written: what it follows, its name and its power.
_FACTOR = r"\s*([/*]?)\s*([^\W\d]+|1)(?:\^?([-+]?\d))?\s*"
_SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
# The powers of energy and length in what these make up.
_DIMENSIONS = {
    "energy": (1, 0),
    "length": (0, 1),
    "energy per length": (1, -1),
    "area": (0, 2),
    "volume": (0, 3),
    "curvature": (0, -1),
    "energy per area": (1, -2),
    "energy per volume": (1, -3),
}
# Units that are no products of energy and length.
_OTHERS = {
    "time": {"fs": 1e-3, "ps": 1.0, "ns": 1e3, "us": 1e6},
    "mass": {"Da": 1.0, "u": 1.0, "kDa": 1e3},
    "temperature": {"K": 1.0},
}
_EXAMPLES = {
    "energy": "'80 kJ/mol', '20 kT' or '1e-19 J'",
    "length": "'100 nm' or '0.5 um'",
    "energy per length": "'0.1 kT/nm' or '0.2 pN'",
    "area": "'12 um^2'",
    "volume": "'90 um^3' or '90 fL'",
    "curvature": "'0.02 1/nm' or '20 um^-1'",
    "energy per area": "'0.1 mN/m', '2 kT/nm^2' or '5 kJ/mol/nm^2'",
    "energy per volume": "'10 Pa', '2 kT/um^3' or '5 kJ/mol/nm^3'",
    "time": "'1 fs'",
    "mass": "'100 Da'",
    "temperature": "'310 K' or '37 C'",
}


@dataclass(frozen=True)
class Scales:
    """What the plain numbers of a configuration mean.

    Attributes
    ----------
    kT : float
        the unit of energy, in kJ/mol
    length : float or None
        the unit of length, in nm; None if its name says nothing about its size
    lengthName : str
        the name of the unit of length
    multiple : float
        how many of these units of length a plain 1 means
    """

    kT: float
    length: float | None = 1.0
    lengthName: str = "nm"
    multiple: float = 1.0


def isQuantity(value: Any) -> bool:
    """Return whether a value is one of OpenMM's Quantities."""
    return hasattr(value, "value_in_unit")


def valueIn(value: Any, wanted: Any, name: str = "a number") -> Any:
    """Return a Quantity, or a number that has this unit already, as a number.

    Raises a TypeError that names it if it is a Quantity of another dimension.
    """
    if not isQuantity(value):
        return value
    if not value.unit.is_compatible(wanted):
        raise TypeError(
            f"the unit of {name} is {value.unit.get_symbol()}; it must be of the dimension of {wanted.get_symbol()}"
        )
    return value.value_in_unit(wanted)


def realNumber(value: Any, name: str, wanted: Any = None) -> float:
    """Return a number, or a Quantity in a unit, as a float; raise a TypeError that names it if it is neither,
    and a ValueError if it is too large.
    """
    plain = value if wanted is None else valueIn(value, wanted, name)
    try:
        if not isinstance(plain, str | bytes | bool):
            return float(plain)
    except OverflowError:
        raise ValueError(f"{name} is {shortened(str(plain))}; numbers are at most {sys.float_info.max:g}") from None
    except (TypeError, ValueError):
        pass
    allowed = "a number" if wanted is None else "a number, or a Quantity"
    raise TypeError(f"{name} is {quoted(plain)}; it must be {allowed}")


def wholeNumber(value: Any, name: str, least: int, most: int | None = None) -> int:
    """Return a whole number as an int, also one of another type, as 3.0; raise a ValueError that names it if it is none
    or out of range.
    """
    size: Any = abs(value) if isinstance(value, numbers.Real) and not isinstance(value, bool) else math.inf
    if not size < math.inf or value != int(value) or value < least or (most is not None and value > most):
        given = quoted(value) if isinstance(value, str) else shortened(str(value))
        allowed = f", {least} or more" if most is None else f" from {least} to {most}"
        raise ValueError(f"{name} is {given}; it must be a whole number{allowed}")
    return int(value)


def thermalEnergy(temperature: Any) -> float:
    """Return kT, in kJ/mol, of a temperature in K; raise a ValueError if it is not positive."""
    if isQuantity(temperature):
        temperature = valueIn(temperature, _openmmUnit("temperature"), "the temperature")
    if not (math.isfinite(realNumber(temperature, "the temperature")) and temperature > 0):
        raise ValueError(f"the temperature is {temperature} K; it must be positive")
    return GAS_CONSTANT * temperature * 0.001


def lengthUnit(name: str) -> float | None:
    """Return the size of a unit of length in nm, or None if its name is not one of a length."""
    return _LENGTHS.get(name)


def multipleOfUnit(name: str) -> tuple[float, str]:
    """Return the factor and the name of a unit like "100 nm"; without a factor it is 1."""
    match = re.fullmatch(r"\s*(\d+\.?\d*(?:[eE][-+]?\d+)?)\s+(\S+)\s*", name)
    factor = float(match[1]) if match else 0.0
    return (factor, match[2]) if match and factor > 0 and math.isfinite(factor) else (1.0, name)


def plainNumber(value: Any, kind: str, scales: Scales) -> Any:
    """Return a value as a plain number, in the named unit of length where it has one.

    Parameters
    ----------
    value : str, Quantity or anything else
        what to convert; a number is one of the scales' multiples, and anything else is returned as it is
    kind : str
        "energy" (plain numbers are kT), "length", "area", "volume", "curvature" (powers of the mesh's unit of length),
        "energy per length", "energy per area", "energy per volume" (of kT and the unit of length), "time" (ps), "mass"
        (Da) or "temperature" (K)
    scales : Scales
        the units of plain numbers

    Raises
    ------
    ValueError
        if it has no unit of this kind
    """
    if isQuantity(value):
        if not value.unit.is_compatible(_openmmUnit(kind)):
            raise ValueError(f"it must be {_article(kind)}")
        return _inPlainUnits(value.value_in_unit(_openmmUnit(kind)), kind, scales)
    if not isinstance(value, str):
        _, length = _DIMENSIONS.get(kind, (0, 0))
        isScaled = length and scales.multiple != 1 and isinstance(value, (int, float)) and not isinstance(value, bool)
        return value * scales.multiple**length if isScaled else value
    match = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\W\d].*?|°C|1?\s*/.*?)\s*", value)
    if match is None:
        raise ValueError(f"it must be a number, or a number with a unit in quotes, like {_EXAMPLES[kind]}")
    number, name = float(match[1]), match[2]
    if kind == "energy" and name in _THERMAL_ENERGY:
        return number
    if kind == "temperature" and name in ("C", "°C"):
        return number + 273.15
    factor = _sizeOf(name, kind, scales)
    if factor is None:
        raise ValueError(
            f"{quoted(name)} is not a unit of {kind}; write it like {_EXAMPLES[kind]}, or as a plain number"
        )
    return _inPlainUnits(number * factor, kind, scales)


def _openmmUnit(kind: str) -> Any:
    """Return OpenMM's own unit of a kind."""
    from openmm import unit  # for Quantities only, whose module is loaded already

    return {
        "energy": unit.kilojoules_per_mole,
        "length": unit.nanometer,
        "energy per length": unit.kilojoules_per_mole / unit.nanometer,
        "area": unit.nanometer**2,
        "volume": unit.nanometer**3,
        "curvature": unit.nanometer**-1,
        "energy per area": unit.kilojoules_per_mole / unit.nanometer**2,
        "energy per volume": unit.kilojoules_per_mole / unit.nanometer**3,
        "time": unit.picosecond,
        "mass": unit.dalton,
        "temperature": unit.kelvin,
    }[kind]


def _sizeOf(name: str, kind: str, scales: Scales) -> float | None:
    """Return what 1 is of a unit of a kind, in OpenMM's units, or None if it is none."""
    if kind in _OTHERS:
        return _OTHERS[kind].get(name)
    factors = _FACTORS | dict.fromkeys(_THERMAL_ENERGY, (scales.kT, 1, 0))
    written, size, powers = _inOneWay(name), 1.0, (0, 0)
    if re.sub(_FACTOR, "", written):  # a pattern of many factors would try all ways to part a long word
        return None
    for sign, word, exponent in re.findall(_FACTOR, written):
        if word not in factors:
            return None
        own, energy, length = factors[word]
        power = int(exponent or 1) * (-1 if sign == "/" else 1)
        size = size * own**power if power > 0 else size / own**-power
        powers = (powers[0] + power * energy, powers[1] + power * length)
    return size if powers == _DIMENSIONS[kind] else None


def _inOneWay(unit: str) -> str:
    """Return a unit with its powers, its products, and what a mole is of, written in one way."""
    unit = re.sub("[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda power: "^" + power[0].translate(_SUPERSCRIPTS), unit)
    unit = unit.replace("**", "^").replace("·", "*")
    unit = re.sub(r"/\s*\(([^()/]*)\)", lambda below: "/" + "/".join(re.split(r"[\s*]+", below[1].strip())), unit)
    return re.sub(r"\b(kJ|kcal|J)(?:\s*/\s*mol\b|[\s*]+mol\s*\^?-1)", r"\1_mol", unit)


def _inPlainUnits(value: float, kind: str, scales: Scales) -> float:
    energy, length = _DIMENSIONS.get(kind, (0, 0))
    if length == 0:
        return value / scales.kT**energy
    if scales.length is None:
        raise ValueError(
            f"it has a unit, but the mesh's length_unit, {quoted(scales.lengthName)}, is not a length: give a plain "
            "number, or a length_unit like 'nm' or 'um'"
        )
    return value / (scales.kT**energy * scales.length**length)


def _article(kind: str) -> str:
    return f"{'an' if kind[0] in 'ae' else 'a'} {kind}"
