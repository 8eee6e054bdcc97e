"""Units: those that a configuration takes against OpenMM's own, of which they know nothing."""

import numpy as np
import openmm.unit as u
import pytest

from openmmhelfrich import units
from openmmhelfrich.units import Scales, plainNumber, thermalEnergy

PER_MOLECULE = u.AVOGADRO_CONSTANT_NA  # energies of a single membrane
ENERGIES = {
    "kJ/mol": u.kilojoule_per_mole,
    "kcal/mol": u.kilocalorie_per_mole,
    "J/mol": u.joule / u.mole,
    "J": u.joule * PER_MOLECULE,
    "fJ": u.femtojoule * PER_MOLECULE,
    "aJ": u.attojoule * PER_MOLECULE,
    "zJ": 1e-21 * u.joule * PER_MOLECULE,
    "pN nm": u.piconewton * u.nanometer * PER_MOLECULE,
    "eV": 1.602176634e-19 * u.joule * PER_MOLECULE,
    "erg": u.erg * PER_MOLECULE,
}
LENGTHS = {
    "pm": u.picometer,
    "A": u.angstrom,
    "Å": u.angstrom,
    "nm": u.nanometer,
    "um": u.micrometer,
    "µm": u.micrometer,
    "μm": u.micrometer,
    "mm": u.millimeter,
    "m": u.meter,
}
TIMES = {"fs": u.femtosecond, "ps": u.picosecond, "ns": u.nanosecond, "us": u.microsecond}
MASSES = {"Da": u.dalton, "u": u.dalton, "kDa": 1000 * u.dalton}


def test_no_unit_is_forgotten():
    tables = (units._ENERGIES, ENERGIES), (units._LENGTHS, LENGTHS), (units._TIMES, TIMES), (units._MASSES, MASSES)
    for own, openmms in tables:
        assert set(own) == set(openmms)


@pytest.mark.parametrize(
    "kind, names, standard",
    [
        ("energy", ENERGIES, u.kilojoule_per_mole),
        ("length", LENGTHS, u.nanometer),
        ("area", {f"{name}^2": unit**2 for name, unit in LENGTHS.items()}, u.nanometer**2),
        ("volume", {f"{name}^3": unit**3 for name, unit in LENGTHS.items()}, u.nanometer**3),
        ("volume", {"fL": u.femtoliter, "aL": u.attoliter}, u.nanometer**3),
        ("time", TIMES, u.picosecond),
        ("mass", MASSES, u.dalton),
        ("temperature", {"K": u.kelvin}, u.kelvin),
    ],
)
def test_units_are_openmms(kind, names, standard):
    for name, unit in names.items():
        assert plainNumber(f"2 {name}", kind, Scales(1.0)) == pytest.approx((2 * unit).value_in_unit(standard), 1e-9)


def test_thermal_energy_is_openmms_to_the_last_bit():
    for temperature in [300, 1.5, *np.random.default_rng(1).uniform(0.001, 2000, 2000).tolist()]:
        expected = (u.MOLAR_GAS_CONSTANT_R * temperature * u.kelvin).value_in_unit(u.kilojoule_per_mole)
        assert thermalEnergy(temperature) == thermalEnergy(temperature * u.kelvin) == expected


@pytest.mark.parametrize("temperature", [0, -1.0, np.inf, np.nan, 0 * u.kelvin])
def test_temperatures_are_positive(temperature):
    with pytest.raises(ValueError, match="it must be positive"):
        thermalEnergy(temperature)
