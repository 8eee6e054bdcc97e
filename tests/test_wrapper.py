"""What the Python classes add to those of C++: units, arrays, ownership, errors."""

import gc
import threading

import numpy as np
import openmm as mm
import pytest
from openmm import unit

import openmmhelfrich as mh
from membranes import TERMS

kJ = unit.kilojoule_per_mole
nm = unit.nanometer

OCTAHEDRON = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
CORNERS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float)


def octahedronForce():
    force = mh.HelfrichForce()
    force.setTriangles(OCTAHEDRON)
    force.setBendingModulus(10)
    return force


def contextOf(force, integrator=None):
    system = mm.System()
    for _ in CORNERS:
        system.addParticle(1)
    system.addForce(force)
    context = mm.Context(system, integrator or mm.VerletIntegrator(0.001), mm.Platform.getPlatform("Reference"))
    context.setPositions(CORNERS)
    return context


SCALARS = [
    ("BendingModulus", kJ),
    ("AreaModulus", kJ),
    ("TargetArea", nm**2),
    ("VolumeModulus", kJ),
    ("TargetVolume", nm**3),
    ("AreaDifferenceModulus", kJ),
    ("TargetAreaDifference", nm**2),
    ("LeafletSeparation", nm),
    ("TetherLengthScale", nm),
    ("RepulsionLengthScale", nm),
    ("Tension", kJ / nm**2),
    ("Pressure", kJ / nm**3),
    ("SpontaneousCurvature", 1 / nm),
    ("GaussianModulus", kJ),
]


@pytest.mark.parametrize("name, units", SCALARS)
def test_scalar_parameters_carry_units(name, units):
    force = mh.HelfrichForce()
    set_, get = getattr(force, "set" + name), getattr(force, "get" + name)
    set_(2.5)
    assert get() == 2.5 * units
    set_(0.5 * units)
    assert get() == 0.5 * units


def test_quantities_in_other_units_are_converted():
    force = mh.HelfrichForce()
    force.setBendingModulus(1 * unit.kilocalorie_per_mole)
    force.setTargetVolume(1000 * unit.angstrom**3)
    force.setTether(1 * unit.kilocalorie_per_mole, 5 * unit.angstrom, 1 * nm, 3)
    force.setTetherLengthScale(7 * unit.angstrom)
    assert force.getBendingModulus().value_in_unit(kJ) == pytest.approx(4.184)
    assert force.getTargetVolume().value_in_unit(nm**3) == pytest.approx(1)
    assert force.getTether()[0].value_in_unit(kJ) == pytest.approx(4.184)
    assert force.getTether()[1].value_in_unit(nm) == pytest.approx(0.5)
    assert force.getTetherLengthScale().value_in_unit(nm) == pytest.approx(0.7)
    flips = mh.EdgeFlipIntegrator(300 * unit.kelvin, 0.2)
    assert flips.getTemperature() == 300 * unit.kelvin
    integrator = mh.HybridMonteCarloIntegrator(300 * unit.kelvin, 2 * unit.femtoseconds)
    assert integrator.getStepSize().value_in_unit(unit.picosecond) == pytest.approx(0.002)


def test_pair_parameters():
    force = mh.HelfrichForce()
    force.setTether(1, 0.5, 1.5, 3)
    assert force.getTether() == [1 * kJ, 0.5 * nm, 1.5 * nm, 3]
    force.setRepulsion(2, 0.4, 4)
    assert force.getRepulsion() == [2 * kJ, 0.4 * nm, 4, 1]
    force.setRepulsion(modulus=2, onset=0.4, exponent=4, exclusionLevel=2)
    assert force.getRepulsion()[3] == 2


def test_triangles_one_by_one():
    force = mh.HelfrichForce()
    assert force.addTriangle(np.int64(0), np.int32(1), 2) == 0
    assert force.addTriangle(3, 2, 1) == 1
    assert force.getTriangleParameters(1) == [3, 2, 1]
    force.setTriangleParameters(1, 1, 3, 2)
    assert force.getTriangles().tolist() == [[0, 1, 2], [1, 3, 2]]
    for index in (-1, 2):
        with pytest.raises(mm.OpenMMException):
            force.getTriangleParameters(index)
    with pytest.raises(TypeError):
        force.addTriangle(0.5, 1, 2)


@pytest.mark.parametrize(
    "convert",
    [
        lambda t: t,
        lambda t: tuple(map(tuple, t)),
        lambda t: list(np.array(t)),
        *[
            lambda t, d=d: np.array(t, dtype=d)
            for d in ("int8", "uint8", "int16", "int32", "uint32", "int64", "uint64", ">i4", ">i8")
        ],
        lambda t: np.asfortranarray(t),
        lambda t: np.repeat(np.array(t, dtype=np.int32), 2, axis=0)[::2],
        lambda t: np.array(t)[:, ::-1][:, ::-1],
    ],
)
def test_triangles_from_any_integers(convert):
    force = mh.HelfrichForce()
    force.setTriangles(convert(OCTAHEDRON))
    triangles = force.getTriangles()
    assert triangles.dtype == np.int32 and triangles.shape == (8, 3)
    assert triangles.tolist() == OCTAHEDRON
    triangles[:] = 0
    assert force.getTriangles().tolist() == OCTAHEDRON


def test_no_triangles():
    force = octahedronForce()
    for empty in ([], np.empty((0, 3), dtype=int), np.empty((0, 3))):
        force.setTriangles(OCTAHEDRON)
        force.setTriangles(empty)
        assert force.getNumTriangles() == 0
        assert force.getTriangles().shape == (0, 3)


@pytest.mark.parametrize(
    "triangles, problem",
    [
        ([[0, 1], [2, 3]], r"shape \(2, 2\)"),
        ([0, 1, 2], r"shape \(3,\)"),
        (np.zeros((2, 3, 1), dtype=int), r"shape \(2, 3, 1\)"),
        (np.int32(4), r"shape \(\)"),
        (None, r"shape \(\)"),
        ([[0, 1, 2], [3, 4]], "ragged"),
        ([[0.0, 1.0, 2.0]], "float64"),
        (np.array([[0, 1, 2]], dtype=np.float32), "float32"),
        ([[0, 1, 2.5]], "float64"),
        ([[True, False, True]], "bool"),
        ([["a", "b", "c"]], "<U1"),
        ([[0, 1, 2], [3, 2**31, 4]], r"2147483648 \(triangle 1\)"),
        ([[0, 1, -(2**31) - 1]], "-2147483649"),
        (np.array([[0, 1, 2**64 - 1]], dtype=np.uint64), "18446744073709551615"),
        ([[0, 1, 2**70]], "object"),
    ],
)
def test_bad_triangles_are_named(triangles, problem):
    force = octahedronForce()
    with pytest.raises(ValueError, match="setTriangles: triangles must be an array of integers.*" + problem):
        force.setTriangles(triangles)
    assert force.getTriangles().tolist() == OCTAHEDRON


def test_live_triangles():
    force = octahedronForce()
    context = contextOf(force)
    live = force.getTrianglesInContext(context)
    assert live.dtype == np.int32
    assert live.tolist() == OCTAHEDRON
    shifted = np.roll(live, 1, axis=0)
    force.setTrianglesInContext(context, shifted)
    assert force.getTrianglesInContext(context).tolist() == shifted.tolist()
    assert force.getTriangles().tolist() == OCTAHEDRON
    with pytest.raises(ValueError, match="setTrianglesInContext"):
        force.setTrianglesInContext(context, shifted.astype(float))


def test_energy_terms():
    force = octahedronForce()
    force.setAreaModulus(3)
    force.setTargetArea(6)
    force.setTether(1, 1.42, 2, 2)
    context = contextOf(force)
    terms = force.getEnergyTermsInContext(context)
    assert list(terms) == [*TERMS, "gaussian", "line", "pair"]
    total = sum(energy.value_in_unit(kJ) for energy in terms.values())
    assert total == pytest.approx(context.getState(energy=True).getPotentialEnergy().value_in_unit(kJ), rel=1e-12)
    assert terms["area"].value_in_unit(kJ) == pytest.approx(3 * (4 * np.sqrt(3) / 6 - 1) ** 2)
    assert terms["volume"] == 0 * kJ


def test_terms_that_are_on():
    force = octahedronForce()
    names = mh.HelfrichForce.getTermNames()
    assert [name for name in names if force.hasTerm(name)] == ["bending"]
    force.setBendingModulus(0)
    force.setRepulsion(1, 0.5, 2)
    assert [name for name in names if force.hasTerm(name)] == ["repulsion"]
    with pytest.raises(mm.OpenMMException, match="hasTerm: there is no term 'Bending'; there are bending, area, "):
        force.hasTerm("Bending")


def test_geometry():
    force = octahedronForce()
    geometry = force.getGeometryInContext(contextOf(force))
    assert geometry.area.value_in_unit(nm**2) == pytest.approx(4 * np.sqrt(3))
    assert geometry.volume.value_in_unit(nm**3) == pytest.approx(4 / 3)
    curvature = 12 * np.sqrt(2) * np.arccos(1 / 3) / 2
    assert geometry.integratedMeanCurvature.value_in_unit(nm) == pytest.approx(curvature)
    assert geometry.areaDifference.value_in_unit(nm**2) == pytest.approx(2 * curvature)
    assert geometry.vertexAreas.value_in_unit(nm**2) == pytest.approx(np.full(6, 4 * np.sqrt(3) / 6))
    assert geometry.vertexMeanCurvatures.value_in_unit(nm) == pytest.approx(np.full(6, curvature / 6))
    with pytest.raises(AttributeError):
        geometry.area = 0 * nm**2
    assert "area 6.9282 nm^2" in repr(geometry)


def test_target_parameters_are_in_the_context():
    force = octahedronForce()
    force.setName("cell")
    force.setVolumeModulus(1)
    force.setTargetVolume(4 / 3)
    context = contextOf(force)
    assert force.getTargetVolumeParameter() == "cellTargetVolume"
    assert context.getParameter("cellTargetVolume") == 4 / 3
    context.setParameter("cellTargetVolume", 2)
    assert force.getEnergyTermsInContext(context)["volume"].value_in_unit(kJ) == pytest.approx(1 / 9)


def test_cast_borrows_from_its_owner():
    system = mm.System()
    system.addForce(octahedronForce())
    base = system.getForce(0)
    assert mh.HelfrichForce.isinstance(base)
    force = mh.HelfrichForce.cast(base)
    assert type(force) is mh.HelfrichForce and not force.thisown
    force.setBendingModulus(7)
    del force, base
    gc.collect()
    assert mh.HelfrichForce.cast(system.getForce(0)).getBendingModulus() == 7 * kJ
    assert mh.HelfrichForce.cast(system.getForces()[0]).getNumTriangles() == 8


def test_cast_takes_over_ownership():
    for original in (
        octahedronForce(),
        mh.EdgeFlipIntegrator(300, 0.1),
        mh.HamiltonianTrajectoryIntegrator(300, 0.1),
        mh.CustomTrajectoryIntegrator(300, 0.1),
        mh.HybridMonteCarloIntegrator(300, 0.1),
    ):
        base = mm.XmlSerializer.clone(original)
        result = type(original).cast(base)
        assert result.thisown and not base.thisown
        del base
        gc.collect()
        assert mm.XmlSerializer.serialize(result) == mm.XmlSerializer.serialize(original)


def test_cast_rejects_other_classes():
    force = octahedronForce()
    assert mh.HelfrichForce.cast(force) is force
    other = mm.HarmonicBondForce()
    for notMembrane in (other, None, "force", mm.VerletIntegrator(1)):
        assert not mh.HelfrichForce.isinstance(notMembrane)
    with pytest.raises(TypeError, match=r"HelfrichForce.cast: the object, a HarmonicBondForce, is not a HelfrichForce"):
        mh.HelfrichForce.cast(other)
    assert other.thisown
    with pytest.raises(TypeError, match="EdgeFlipIntegrator"):
        mh.EdgeFlipIntegrator.cast(mh.HybridMonteCarloIntegrator(300, 0.1))
    with pytest.raises(TypeError):
        mh.HelfrichForce.cast(mm.VerletIntegrator(1))


def test_hybrid_integrator_is_a_compound_integrator():
    integrator = mh.HybridMonteCarloIntegrator(300, 0.01, stepsPerTrajectory=20, flipProbability=0.25)
    assert isinstance(integrator, mm.CompoundIntegrator)
    assert integrator.getNumIntegrators() == 2
    assert isinstance(integrator.getIntegrator(0), mh.HamiltonianTrajectoryIntegrator)
    assert isinstance(integrator.getIntegrator(1), mh.EdgeFlipIntegrator)
    assert isinstance(mh.HybridMonteCarloIntegrator(300, 0.01, engine="custom").getIntegrator(0), mm.CustomIntegrator)
    assert integrator.getFlipIntegrator().getFraction() == 0.3
    assert integrator.getStepsPerTrajectory() == 20
    assert integrator.getFlipProbability() == 0.25
    with pytest.raises(mm.OpenMMException):
        integrator.getIntegrator(2)


def test_hybrid_integrator_owns_its_integrators():
    dynamics, flips = mm.LangevinMiddleIntegrator(300, 1, 0.001), mh.EdgeFlipIntegrator(310, 0.2)
    integrator = mh.HybridMonteCarloIntegrator(dynamics, flips, flipProbability=1)
    assert not dynamics.thisown and not flips.thisown
    with pytest.raises(ValueError, match="belongs to another"):
        mh.HybridMonteCarloIntegrator(mm.VerletIntegrator(1), flips)
    del dynamics, flips
    gc.collect()
    assert isinstance(integrator.getIntegrator(0), mm.LangevinMiddleIntegrator)
    assert integrator.getTemperature() == 310 * unit.kelvin


def test_hybrid_integrator_that_cannot_be_made_owns_nothing():
    dynamics, flips = mm.VerletIntegrator(0.001), mh.EdgeFlipIntegrator(310, 0.2)
    with pytest.raises(mm.OpenMMException, match="probability"):
        mh.HybridMonteCarloIntegrator(dynamics, flips, 2)
    with pytest.raises(TypeError):
        mh.HybridMonteCarloIntegrator(flips, dynamics)
    with pytest.raises(TypeError):
        mh.HybridMonteCarloIntegrator(dynamics, 0.5)
    with pytest.raises(ValueError, match="belongs to another"):
        mh.HybridMonteCarloIntegrator(flips, flips)
    assert dynamics.thisown and flips.thisown
    mh.HybridMonteCarloIntegrator(trajectory=dynamics, flips=flips)
    with pytest.raises(TypeError):
        mh.HybridMonteCarloIntegrator(300, 0.1, steps=3)


def test_errors_are_openmm_exceptions():
    with pytest.raises(mm.OpenMMException):
        mh.EdgeFlipIntegrator(-1, 0.1)
    with pytest.raises(mm.OpenMMException):
        mh.EdgeFlipIntegrator(300, 0.1).step(1)
    with pytest.raises(mm.OpenMMException):
        mh.HelfrichForce().setBendingModulus(float("nan"))


def test_other_threads_run_during_a_step():
    context = contextOf(octahedronForce(), mh.HybridMonteCarloIntegrator(300, 0.001))
    worker = threading.Thread(target=context.getIntegrator().step, args=(2000,))
    worker.start()
    ticks = 0
    while worker.is_alive():
        ticks += 1
    worker.join()
    assert ticks > 10


@pytest.mark.parametrize(
    "class_",
    [
        mh.HelfrichForce,
        mh.CustomTrajectoryIntegrator,
        mh.EdgeFlipIntegrator,
        mh.HamiltonianTrajectoryIntegrator,
        mh.HybridMonteCarloIntegrator,
        mh.ShearWaveIntegrator,
    ],
)
def test_everything_public_is_documented(class_):
    assert class_.__doc__
    public = [name for name in vars(class_) if not name.startswith("_") and name != "thisown"]
    undocumented = [name for name in public if not getattr(class_, name).__doc__]
    assert len(public) > 8 and undocumented == []
    garbled = [
        name
        for name in public
        if any(word in getattr(class_, name).__doc__ for word in ("\\f$", ":math:", "std::", "@param"))
    ]
    assert garbled == []
