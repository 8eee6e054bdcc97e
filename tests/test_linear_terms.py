"""Tension and pressure: energies, Contexts, moves and runs.  That forces are derivatives, that platforms agree, and
that flips are right is tested where that is tested for every term.
"""

import numpy as np
import openmm as mm
import pytest
from openmm import app, unit

import openmmhelfrich as mh
from membranes import (
    PLATFORMS,
    TERMS,
    createBlob,
    createContext,
    createForce,
    energyOf,
    forcesOf,
    kelvin,
    positionsOf,
    termsOf,
)
from openmmhelfrich.runs.config import parseConfig
from openmmhelfrich.runs.grids import readGrid
from openmmhelfrich.runs.scene import Scene
from openmmhelfrich.runs.studies import resume, run
from openmmhelfrich.runs.sweeps import observe

# The term, its setter, its unit in kJ/mol and nm, and what the energy is linear in, with its sign.
TERM = (
    "term, unitOf, sign",
    [
        ("tension", unit.kilojoule_per_mole / unit.nanometer**2, 1),
        ("pressure", unit.kilojoule_per_mole / unit.nanometer**3, -1),
    ],
)


def parameterOf(force, term):
    return getattr(force, f"get{term.capitalize()}Parameter")()


def setModulus(force, term, value):
    getattr(force, f"set{term.capitalize()}")(value)


def totalOf(force, context, term):
    """Return what the energy is linear in: the area or the volume, in powers of nm."""
    total = getattr(force.getGeometryInContext(context), {"tension": "area", "pressure": "volume"}[term])
    return total.value_in_unit(total.unit)


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize(*TERM)
def test_energy_is_linear(platform, term, unitOf, sign):
    mesh = createBlob(2)
    force = createForce(mesh, ["bending"])
    context = createContext(mesh, force, platform)
    total, bending, parameter = totalOf(force, context, term), energyOf(context), parameterOf(force, term)
    assert parameter == "HelfrichForce" + term.capitalize()
    for value in (0, 1, -3.5, 1e6, -1e-9, 0):
        context.setParameter(parameter, value)
        terms = termsOf(force, context)
        assert terms == {name: energy if name in ("bending", term) else 0 for name, energy in terms.items()}
        assert terms["bending"] == bending and energyOf(context) == pytest.approx(sum(terms.values()), rel=1e-15)
        assert terms[term] == pytest.approx(sign * value * total, rel=1e-13)


@pytest.mark.parametrize(*TERM)
def test_default_of_the_parameter(term, unitOf, sign):
    """It is the Force's when a Context is created, and what the Context has does not follow the Force."""
    mesh = createBlob(1)
    force = createForce(mesh, ["bending"])
    setModulus(force, term, 2 * unitOf)
    assert getattr(force, f"get{term.capitalize()}")() == 2 * unitOf
    context = createContext(mesh, force)
    parameter = parameterOf(force, term)
    assert context.getParameter(parameter) == 2
    setModulus(force, term, 5)
    force.updateParametersInContext(context)
    assert context.getParameter(parameter) == 2
    assert termsOf(force, context)[term] == pytest.approx(sign * 2 * totalOf(force, context, term), rel=1e-13)


def drive(force, mesh, platform, precision, parameters=None):
    """Make trajectories with substeps, flips and shear waves, and return the positions, triangles and energy at their
    end.
    """
    integrator = mh.HybridMonteCarloIntegrator(kelvin(20), 1e-4, 10, 0.3, 0.4)
    integrator.setSplitting("bcss2")
    integrator.setTetherSubsteps(2)
    integrator.setForcePrecision(precision)
    integrator.addShearWaves(mh.ShearWaveIntegrator(kelvin(20), 0.02, 1, 3, 3), 0.2)
    integrator.setRandomNumberSeed(3)
    context = createContext(mesh, force, platform, integrator)
    for name, value in (parameters or {}).items():
        context.setParameter(name, value)
    integrator.step(40)
    assert integrator.getAcceptanceRate() > 0.3 and integrator.getFlipAcceptanceRate() > 0.1
    return positionsOf(context), force.getTrianglesInContext(context), energyOf(context)


@pytest.mark.parametrize("platform, precision", [("Reference", "double"), ("CPU", "double"), ("CPU", "mixed")])
@pytest.mark.parametrize(*TERM)
def test_a_modulus_in_a_context_is_that_of_a_force(platform, precision, term, unitOf, sign):
    """Trajectories, flips and waves are the same to the last bit whether the Force or the Context turns the term on,
    and others without it.
    """
    mesh = createBlob(2)
    others = [name for name in TERMS if name != term]
    with_, without = createForce(mesh, TERMS), createForce(mesh, others)
    value = getattr(with_, f"get{term.capitalize()}")().value_in_unit(unitOf)
    parameter = parameterOf(with_, term)
    expected = drive(with_, mesh, platform, precision)
    found = drive(without, mesh, platform, precision, {parameter: value})
    for a, b in zip(found, expected):
        assert np.array_equal(a, b)
    off = drive(createForce(mesh, TERMS), mesh, platform, precision, {parameter: 0})
    never = drive(createForce(mesh, others), mesh, platform, precision)
    for a, b in zip(off, never):
        assert np.array_equal(a, b)
    assert not np.array_equal(never[0], expected[0])


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize(*TERM)
def test_restarts_keep_the_parameter(platform, term, unitOf, sign):
    mesh = createBlob(1)
    force = createForce(mesh, ["bending"])
    context, parameter = createContext(mesh, force, platform), parameterOf(force, term)
    context.setParameter(parameter, -1.25)
    energy, checkpoint = energyOf(context), context.createCheckpoint()
    state = mm.XmlSerializer.serialize(context.getState(positions=True, parameters=True))
    context.reinitialize(preserveState=True)
    assert context.getParameter(parameter) == -1.25 and energyOf(context) == energy
    for restore in (context.loadCheckpoint, lambda _: context.setState(mm.XmlSerializer.deserialize(state))):
        context.setParameter(parameter, 7)
        restore(checkpoint)
        assert context.getParameter(parameter) == -1.25 and energyOf(context) == energy


def test_minimization_shrinks_the_surface():
    """Where the volume is kept, a tension makes a sphere of an ellipsoid, with the pressure of Laplace's law in it."""
    mesh, tension, modulus = mh.Mesh.icosphere(2), 50, 1e4
    mesh.vertices *= [1, 1, 1.3]
    force = createForce(mesh, ["bending", "volume"])
    force.setVolumeModulus(modulus)
    force.setTargetVolume(mesh.volume)
    force.setTension(tension)
    system = mesh.createSystem()
    system.addForce(force)
    simulation = app.Simulation(
        mesh.topology(), system, mh.EdgeFlipIntegrator(300, 1), mm.Platform.getPlatform("Reference")
    )
    simulation.context.setPositions(mesh.vertices)
    assert mh.minimizeFluid(simulation, force, tolerance=0.01).converged
    area, volume = (totalOf(force, simulation.context, term) for term in ("tension", "pressure"))
    assert mh.Mesh(positionsOf(simulation.context), mesh.triangles).reducedVolume > 0.993 > 0.98 > mesh.reducedVolume
    assert termsOf(force, simulation.context)["tension"] == pytest.approx(tension * area, rel=1e-13)
    pressure = -2 * modulus * (volume / mesh.volume - 1) / mesh.volume
    assert pressure == pytest.approx(2 / 3 * tension * area / volume, rel=1e-3)  # 2 tension/R


@pytest.mark.parametrize("radius, tension", [(1.0, 7.0), (20.0, -0.3)])
def test_laplace(radius, tension):
    """A sphere is balanced at p = 2 sigma/R, whatever its bending modulus, but for an error that falls as 1/N."""
    errors = []
    for subdivisions in (2, 3, 4):
        mesh = mh.Mesh.icosphere(subdivisions, radius)
        force = createForce(mesh, ["bending"])
        force.setTension(tension)
        force.setPressure(2 * tension / radius)
        forces = forcesOf(createContext(mesh, force, "CPU"))
        slope = -np.sum(forces * mesh.vertices) / radius  # dE/dR
        errors.append(slope / (8 * np.pi * radius * tension))
    assert abs(errors[0]) < 0.03 and abs(errors[0]) > abs(errors[1]) > abs(errors[2])
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05) and errors[1] / errors[2] == pytest.approx(4, rel=0.05)


@pytest.mark.parametrize("platform", PLATFORMS)
def test_a_pressure_needs_an_inside(platform):
    mesh = createBlob(1)
    mesh.triangles = mesh.triangles[:, ::-1].copy()
    force = createForce(mesh, ["bending"])
    context = createContext(mesh, force, platform)
    energyOf(context)
    context.setParameter(force.getPressureParameter(), 1)
    with pytest.raises(mm.OpenMMException, match=r"inside out.*counter-clockwise seen from outside"):
        energyOf(context)


# --- runs


def configure(prefix, steps=100, **membrane):
    """Return a Config of a short run of a vesicle without other terms of area and volume, unless asked for."""
    return parseConfig(
        {
            "mesh": {"icosphere": 2},
            "membrane": {"bending_modulus": 10.0, "area_modulus": 0.0, "volume_modulus": 0.0, **membrane},
            "sampling": {"steps": steps, "seed": 5, "steps_per_trajectory": 20},
            "platform": {"threads": 1},
            "output": {"prefix": str(prefix), "observables_interval": 5, "mesh_trajectory": False},
        }
    )


@pytest.mark.parametrize(
    "key, value, expected",
    [
        ("tension", 0.25, 0.25),
        ("tension", "-3 kT/nm^2", -3),
        ("tension", "0.1 mN/m", 0.0241434),
        ("tension", "5 kJ/mol/nm^2", 2.00454),
        ("tension", 5 * unit.kilojoule_per_mole / unit.angstrom**2, 200.454),
        ("pressure", 0.25, 0.25),
        ("pressure", "-3 kT/nm^3", -3),
        ("pressure", "1 kPa", 2.41434e-4),
        ("pressure", "2 atm", 0.0489265),
        ("pressure", -5 * unit.kilojoule_per_mole / unit.angstrom**3, -2004.54),
    ],
)
def test_keys(key, value, expected):
    """Numbers are in kT and the length unit; the scene's force has them in OpenMM's units."""
    config = configure("a", **{key: value})
    assert getattr(config.membrane, key) == pytest.approx(expected, rel=1e-5)
    scene = Scene.of(config)
    found = getattr(scene.createForce(), f"get{key.capitalize()}")()
    assert found.value_in_unit(found.unit) == pytest.approx(expected * scene.kT, rel=1e-5)
    assert getattr(scene.config.membrane, key) == getattr(config.membrane, key)


@pytest.mark.parametrize(
    "values, message",
    [
        (
            {"tension": "3 kT"},
            "[membrane] tension is '3 kT'; 'kT' is not a unit of energy per area; write it like '0.1",
        ),
        ({"tension": np.inf}, "[membrane] tension is inf; it must be a finite number"),
        ({"tensoin": 3.0}, "[membrane] has no key 'tensoin'; did you mean 'tension'?"),
        (
            {"pressure": "3 mN/m"},
            "[membrane] pressure is '3 mN/m'; 'mN/m' is not a unit of energy per volume; write it",
        ),
        ({"pressure": np.nan}, "[membrane] pressure is nan; it must be a finite number"),
        ({"presure": 3.0}, "[membrane] has no key 'presure'; did you mean 'pressure'?"),
    ],
)
def test_wrong_keys(values, message):
    with pytest.raises(ValueError) as error:
        configure("a", **values)
    assert message in str(error.value)


@pytest.mark.parametrize("key, title, strength", [("tension", "area", 10.0), ("pressure", "volume", 40.0)])
def test_runs(key, title, strength, inFolder):
    """The term does what its sign says, and has a column if it is on; a run goes on with the same column."""
    tables = {}
    for prefix, value in (("plus", strength), ("minus", -strength), ("off", 0.0)):
        tables[prefix] = run(configure(prefix, **{key: value})).table
    assert list(tables["plus"]) == list(tables["minus"])
    names = list(tables["off"])
    assert [name for name in tables["plus"] if name not in names] == [f"E_{key}"]
    assert list(tables["plus"]).index(f"E_{key}") == names.index("E_repulsion") + 1
    sign = {"tension": 1, "pressure": -1}[key]
    for prefix, value in (("plus", strength), ("minus", -strength)):
        table = tables[prefix]
        assert table[f"E_{key}"] == pytest.approx(sign * value * table[title], rel=1e-13)
        terms = [table[name] for name in table if name.startswith("E_")]
        assert table["energy"] == pytest.approx(sum(terms), rel=1e-13)
        change = table[title][-10:].mean() - tables["off"][title][-10:].mean()
        assert -np.sign(sign * value) * change > 0.03 * table[title][0]
    result = observe(configure("plus", **{key: strength}))
    assert result[f"E_{key} (kT)"] == pytest.approx(
        sign * strength * result[f"{title} (nm^{2 if title == 'area' else 3})"]
    )
    resume("plus", steps=10)
    longer = mh.readObservables("plus.csv")
    assert list(longer) == list(tables["plus"]) and longer["step"][-1] == 110
    assert longer[f"E_{key}"] == pytest.approx(sign * strength * longer[title], rel=1e-13)
    assert f"{key} = {strength}" in (inFolder / "plus.resolved.toml").read_text()


def test_a_table_has_a_column_where_the_force_has_the_term(inFolder):
    """Not where a Context alone turns it on, or off: the columns of a table do not change on the way."""
    mesh = mh.Mesh.icosphere(1)
    for name, inForce, inContext in (("on", 2.0, 0.0), ("off", 0.0, 2.0)):
        force = createForce(mesh, ["bending"])
        force.setTension(inForce)
        system = mesh.createSystem()
        system.addForce(force)
        simulation = app.Simulation(
            mesh.topology(), system, mh.EdgeFlipIntegrator(300, 1), mm.Platform.getPlatform("CPU")
        )
        simulation.context.setPositions(mesh.vertices)
        simulation.reporters.append(mh.ObservablesReporter(f"{name}.csv", 1, force))
        simulation.step(1)
        simulation.context.setParameter(force.getTensionParameter(), inContext)
        simulation.step(1)
        table = mh.readObservables(f"{name}.csv")
        assert ("E_tension" in table) == (name == "on")
        difference = table["energy"] - table["E_bending"]
        assert difference == pytest.approx(np.array([inForce, inContext]) * table["area"], rel=1e-12)
        if name == "on":
            assert table["E_tension"] == pytest.approx(difference, rel=1e-12)


@pytest.mark.parametrize("key, values", [("tension", [0.0, "0.1 mN/m"]), ("pressure", [0.0, "100 kPa"])])
def test_grids(key, values, inFolder):
    (inFolder / "grid.toml").write_text(
        f"[base.mesh]\nicosphere = 1\n[grid.membrane]\n{key} = {values}\n".replace("'", '"')
    )
    points = readGrid("grid.toml")
    assert [getattr(point.config.membrane, key) for point in points] == pytest.approx([0, 0.0241434], rel=1e-5)
