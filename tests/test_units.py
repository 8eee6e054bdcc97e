"""Units: those that a configuration takes against OpenMM's own, of which they know nothing."""

import io

import numpy as np
import openmm.unit as u
import pytest

import openmmhelfrich as mh
from openmmhelfrich import units
from openmmhelfrich.units import Scales, plainNumber, thermalEnergy, wholeNumber

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
    "angstrom": u.angstrom,
    "nm": u.nanometer,
    "um": u.micrometer,
    "µm": u.micrometer,
    "μm": u.micrometer,
    "mm": u.millimeter,
    "cm": u.centimeter,
    "m": u.meter,
}
TIMES = {"fs": u.femtosecond, "ps": u.picosecond, "ns": u.nanosecond, "us": u.microsecond}
MASSES = {"Da": u.dalton, "u": u.dalton, "kDa": 1000 * u.dalton}
TENSIONS = {
    "N/m": u.newton / u.meter * PER_MOLECULE,
    "mN/m": u.millinewton / u.meter * PER_MOLECULE,
    "uN/m": u.micronewton / u.meter * PER_MOLECULE,
    "pN/nm": u.piconewton / u.nanometer * PER_MOLECULE,
}
FORCES = {
    "N": u.newton * PER_MOLECULE,
    "mN": u.millinewton * PER_MOLECULE,
    "uN": u.micronewton * PER_MOLECULE,
    "dyn": u.dyne * PER_MOLECULE,
    "nN": u.nanonewton * PER_MOLECULE,
    "pN": u.piconewton * PER_MOLECULE,
}
PRESSURES = {
    "Pa": u.pascal * PER_MOLECULE,
    "kPa": u.kilopascal * PER_MOLECULE,
    "MPa": u.megapascal * PER_MOLECULE,
    "bar": u.bar * PER_MOLECULE,
    "atm": u.atmosphere * PER_MOLECULE,
}


def test_no_unit_is_forgotten():
    energies = {name.replace("_", "/") for name in units._ENERGIES}
    assert energies == set(ENERGIES) - {"pN nm"}  # a product
    tables = (units._LENGTHS, LENGTHS), (units._FORCES, FORCES), (units._PRESSURES, PRESSURES)
    for own, openmms in (*tables, (units._OTHERS["time"], TIMES), (units._OTHERS["mass"], MASSES)):
        assert set(own) == set(openmms)


@pytest.mark.parametrize(
    "kind, names, standard",
    [
        ("energy", ENERGIES, u.kilojoule_per_mole),
        ("length", LENGTHS, u.nanometer),
        ("area", {f"{name}^2": unit**2 for name, unit in LENGTHS.items()}, u.nanometer**2),
        ("volume", {f"{name}^3": unit**3 for name, unit in LENGTHS.items()}, u.nanometer**3),
        ("volume", {"fL": u.femtoliter, "aL": u.attoliter}, u.nanometer**3),
        ("curvature", {f"1/{name}": 1 / unit for name, unit in LENGTHS.items()}, u.nanometer**-1),
        ("energy per length", FORCES, u.kilojoule_per_mole / u.nanometer),
        ("energy per area", TENSIONS, u.kilojoule_per_mole / u.nanometer**2),
        (
            "energy per area",
            {f"{a}/{b}^2": ENERGIES[a] / LENGTHS[b] ** 2 for a in ENERGIES for b in LENGTHS},
            u.kilojoule_per_mole / u.nanometer**2,
        ),
        ("energy per volume", PRESSURES, u.kilojoule_per_mole / u.nanometer**3),
        (
            "energy per volume",
            {f"{a}/{b}^3": ENERGIES[a] / LENGTHS[b] ** 3 for a in ENERGIES for b in LENGTHS},
            u.kilojoule_per_mole / u.nanometer**3,
        ),
        ("time", TIMES, u.picosecond),
        ("mass", MASSES, u.dalton),
        ("temperature", {"K": u.kelvin}, u.kelvin),
    ],
)
def test_units_are_openmms(kind, names, standard):
    for name, unit in names.items():
        assert plainNumber(f"2 {name}", kind, Scales(1.0)) == pytest.approx((2 * unit).value_in_unit(standard), 1e-9)


@pytest.mark.parametrize(
    "kind, plain, ways",
    [
        ("curvature", "2 1/um", ["2 um^-1", "2 um⁻¹", "2 um-1", "2/um", "2 / um", "2 1 / um", "2 um**-1"]),
        ("area", "2 um^2", ["2 um²", "2 um2", "2 um**2", "2 um um", "2 um*um", "2 um^3/um"]),
        ("energy", "2 pN nm", ["2 pN*nm", "2 pN·nm", "2 nm pN", "2e-3 pN um", "2e-9 N/um nm^2"]),
        ("energy per area", "2 mN/m", ["2 mN m^-1", "2 mN m⁻¹", "2 dyn/cm", "2e-3 J/m^2", "2e-3 J m^-2", "2 pN/nm"]),
        ("energy per area", "2 kJ/mol/nm^2", ["2 kJ/(mol nm^2)", "2 kJ/(mol*nm²)", "2 kJ mol^-1 nm^-2"]),
        ("energy per volume", "2 Pa", ["2 N/m^2", "2 N m^-2", "2 J/m^3"]),
        ("volume", "2 um^3", ["2 fL", "2e-12 cm^3", "2 um um²"]),
    ],
)
def test_products_quotients_and_powers(kind, plain, ways):
    wanted = plainNumber(plain, kind, Scales(2.5, 1e3, "um"))
    for way in ways:
        assert plainNumber(way, kind, Scales(2.5, 1e3, "um")) == pytest.approx(wanted, rel=1e-12), way


def test_digits_before_a_quotient_are_of_the_number():
    assert plainNumber("51/nm", "curvature", Scales(1.0)) == 51


@pytest.mark.parametrize(
    "kind, unit",
    [
        ("energy", "kJ"),
        ("energy", "kT/mol"),
        ("curvature", "nm"),
        ("curvature", "nm^"),
        ("curvature", "nm^-"),
        ("curvature", "nm^-22"),
        ("curvature", "/"),
        ("area", "nmnm"),
        ("energy per area", "kJ/mol nm^2"),
        ("energy", 10 * "kilojoule" + "?"),  # of which each letter could be a unit
    ],
)
def test_what_is_no_unit_of_a_kind(kind, unit):
    with pytest.raises(ValueError, match=f"is not a unit of {kind}; write it like"):
        plainNumber(f"2 {unit}", kind, Scales(1.0))


def test_quotients_of_energy_and_length():
    """They are in kT and the mesh's unit of length, whichever these are."""
    scales = Scales(2.5, 1e3, "um")
    assert plainNumber("3 kT/um^2", "energy per area", scales) == pytest.approx(3, rel=1e-15)
    assert plainNumber("3 kBT/nm²", "energy per area", scales) == pytest.approx(3e6, rel=1e-15)
    assert plainNumber("10 kJ/mol/um^3", "energy per volume", scales) == pytest.approx(4, rel=1e-15)
    assert plainNumber("-1 Pa", "energy per volume", scales) == pytest.approx(-602.214076 / 2.5, rel=1e-15)
    quantity = 5 * u.kilojoule_per_mole / u.angstrom**2
    assert plainNumber(quantity, "energy per area", scales) == pytest.approx(2e8, rel=1e-15)
    for wrong in ("3 kT", "3 um^2", "3 kT/um^3", "3 kT/um", "3 /um^2"):
        with pytest.raises(ValueError, match=r"'0\.1 mN/m', '2 kT/nm\^2' or '5 kJ/mol/nm\^2'"):
            plainNumber(wrong, "energy per area", scales)
    with pytest.raises(ValueError, match="it must be an energy per area"):
        plainNumber(5 * u.kilojoule_per_mole, "energy per area", scales)
    with pytest.raises(ValueError, match="the mesh's length_unit, 'R0', is not a length"):
        plainNumber("3 mN/m", "energy per area", Scales(2.5, None, "R0"))


def test_thermal_energy_is_openmms_to_the_last_bit():
    for temperature in [300, 1.5, *np.random.default_rng(1).uniform(0.001, 2000, 2000).tolist()]:
        expected = (u.MOLAR_GAS_CONSTANT_R * temperature * u.kelvin).value_in_unit(u.kilojoule_per_mole)
        assert thermalEnergy(temperature) == thermalEnergy(temperature * u.kelvin) == expected


def test_a_quantity_of_another_dimension_is_named():
    """Functions and methods say which argument it is, and which dimension it must have."""
    mesh = mh.Mesh.icosphere(1)
    scene = mh.Scene.of({"sampling": {"seed": 1}}, mesh)
    force = scene.createForce()
    simulation = scene.createSimulation(force)
    to = {"windows": 1, "equilibration": 0, "steps": 1}
    for call, message in (
        (lambda: mh.Mesh(mesh.vertices * u.kelvin, mesh.triangles), "the unit of vertices is K; .* dimension of nm$"),
        (lambda: mh.Mesh.icosphere(1, 2 * u.picosecond), "the unit of radius is ps; .* dimension of nm$"),
        (lambda: mesh.remeshed(edgeLength=1 * u.kelvin), "the unit of edgeLength is K; .* dimension of nm$"),
        (lambda: mesh.createSystem(1 * u.nanometer), "the unit of mass is nm; .* dimension of Da$"),
        (lambda: mesh.createSystem("1"), "mass is '1'; it must be a number, or a Quantity$"),
        (lambda: mh.minimize(simulation, force, 1 * u.kelvin), r"the unit of tolerance is K; .* of kJ/\(nm mol\)$"),
        (lambda: mh.StepSizeAdapter(1 * u.kelvin), "the unit of the step size is K; .* dimension of ps$"),
        (lambda: thermalEnergy(1 * u.nanometer), "the unit of the temperature is nm; .* dimension of K$"),
        (
            lambda: mh.continueTo(simulation, force, {"area": 12 * u.nanometer}, **to),
            r"the unit of the target area is nm; .* dimension of nm\*\*2$",
        ),
        (lambda: mh.minimize(simulation, force, "1"), "^tolerance is '1'; it must be a number, or a Quantity$"),
        (
            lambda: mh.minimize(simulation, force, [1, 2]),
            r"^tolerance is \[1, 2\]; it must be a number, or a Quantity$",
        ),
        (
            lambda: mh.minimize(simulation, force, multilevelWeight="2"),
            "^multilevelWeight is '2'; it must be a number$",
        ),
        (
            lambda: mh.minimizeFluid(simulation, force, multilevelWeight=None),
            "^multilevelWeight is None; it must be a n",
        ),
        (lambda: mh.minimize(simulation, force, True), "^tolerance is True; it must be a number, or a Quantity$"),
        (lambda: mh.adaptStepSize(simulation, 10, "x"), "the acceptance is 'x'; it must be a number$"),
        (lambda: mh.StepSizeTracker(1, 0.7, "x"), "the gain is 'x'; it must be a number$"),
        (lambda: mh.StepSizeAdapter("1"), "the step size is '1'; it must be a number, or a Quantity$"),
        (
            lambda: mh.continueTo(simulation, force, {"volume": "4"}, **to),
            "the target volume is '4'; it must be a number",
        ),
        (
            lambda: mh.continueTo(simulation, force, {"reducedVolume": None}, **to),
            "the target reducedVolume is None; it",
        ),
        (lambda: mh.tradeoff.tradeoff({}, error="x"), "^tradeoff: the error is 'x'; it must be a number$"),
        (lambda: mh.tradeoff.tradeoff({}, effort=None), "^tradeoff: the effort is None; it must be a number$"),
        (lambda: mh.tradeoff.tradeoff({}, minutes="x"), "^tradeoff: minutes is 'x'; it must be a number$"),
        (lambda: thermalEnergy("300"), "^the temperature is '300'; it must be a number$"),
    ):
        with pytest.raises(TypeError, match=message):
            call()
    for huge in (10**400, 10 * -(10**400)):
        with pytest.raises(ValueError, match=r"^the target area is -?100+.*; numbers are at most 1\.79769e\+308$"):
            mh.continueTo(simulation, force, {"area": huge}, **to)
        with pytest.raises(ValueError, match=r"target_area_difference.*it must be a finite number"):
            mh.Scene.of({"membrane": {"target_area_difference": huge}}, mesh)
    with pytest.raises(ValueError, match=r"mass is -1\.0 Da; it must be finite, and not negative"):
        mesh.createSystem(-1)
    with pytest.raises(
        ValueError, match=r"continueTo: the target area is 1.2e\+07; it must be within a factor of 25 of"
    ):
        mh.continueTo(simulation, force, {"area": 12e6}, **to)


@pytest.mark.parametrize("temperature", [0, -1.0, np.inf, np.nan, 0 * u.kelvin])
def test_temperatures_are_positive(temperature):
    with pytest.raises(ValueError, match="it must be positive"):
        thermalEnergy(temperature)


@pytest.mark.parametrize("value", [3, 3.0, np.int32(3), np.float64(3)])
def test_whole_numbers_of_any_type(value):
    result = wholeNumber(value, "n", 3, 3)
    assert result == 3 and type(result) is int


@pytest.mark.parametrize("value", [2.5, 0, 6, True, None, "3", float("nan"), float("inf"), [3], 10**400])
def test_what_is_no_whole_number_in_range(value):
    with pytest.raises(ValueError, match=r"n is .*; it must be a whole number from 1 to 5$"):
        wholeNumber(value, "n", 1, 5)


@pytest.mark.parametrize("value", [2.5, "3", -1, np.nan])
def test_functions_that_take_whole_numbers(value):
    """They say so at once, whatever is given."""
    mesh = mh.Mesh.icosphere(2)
    mesh.species = (mesh.vertices[:, 2] > 0).astype(int)
    frames = np.stack([mesh.vertices * (1 + n / 10) for n in range(8)])
    spectrum = mh.fluctuationSpectrum(frames, 4)
    reweighting = mh.reweight([np.linspace(100, 110, 20), np.linspace(101, 111, 20)], [300, 310])
    outline = [[0, -1], [1, 0], [0, 1]]
    calls = {
        "compositionProfile: bins": lambda: mh.compositionProfile(mesh, bins=value),
        "compositionSpectrum: maxDegree": lambda: mh.compositionSpectrum(mesh, maxDegree=value),
        "fluctuationSpectrum: maxDegree": lambda: mh.fluctuationSpectrum(frames, value),
        "fit: minDegree": lambda: spectrum.fit(value),
        "fit: maxDegree": lambda: spectrum.fit(2, value),
        "vertexDiffusion: of 8 frames maxLag": lambda: mh.vertexDiffusion(frames, mesh.triangles, value),
        "densityOfStates: bins": lambda: reweighting.densityOfStates(value),
        "icosphere: subdivisions": lambda: mh.Mesh.icosphere(value),
        "remesh: the number of vertices": lambda: mesh.remeshed(value),
        "surfaceOfRevolution: numVertices": lambda: mh.surfaceOfRevolution(outline, value),
        "surfaceOfRevolution: rounds": lambda: mh.surfaceOfRevolution(outline, 92, value),
        "adaptStepSize: steps": lambda: mh.adaptStepSize(simulation, value),
        "anneal: steps": lambda: mh.anneal(simulation, 300, value),
        "minimizeFluid: maxIterations": lambda: mh.minimizeFluid(simulation, force, maxIterations=value),
        "minimizeFluid: iterationsPerRound": lambda: mh.minimizeFluid(simulation, force, iterationsPerRound=value),
        "reportInterval": lambda: mh.ObservablesReporter(io.StringIO(), value, force),
        "ReplicaExchange: seed": lambda: mh.ReplicaExchange([], [], seed=value),
        "ReplicaExchange: workers": lambda: mh.ReplicaExchange([], [], workers=value),
    }
    scene = mh.Scene.of({}, mesh)
    force = scene.createForce()
    simulation = scene.createSimulation(force)
    for name, call in calls.items():
        with pytest.raises(ValueError, match=rf"^{name} is .*; it must be a whole number"):
            call()
