"""Forces in mixed precision: trajectories stay exact, and continue exactly."""

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
from openmmhelfrich.runs.scene import Scene

KT = 2.5


def createVesicle():
    mesh = mh.Mesh.icosphere(1)
    edge = mesh.edgeLengths.mean()
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(20 * KT)
    force.setAreaModulus(300)
    force.setTargetArea(mesh.area)
    force.setVolumeModulus(300)
    force.setTargetVolume(mesh.volume)
    # No triangle can become a needle: two shortest edges are longer than a longest.
    force.setTether(100 * KT, 0.8 * edge, 1.25 * edge, 2)
    return mesh, force


def meanOf(samples):
    """Return the mean of correlated samples and its standard error, by batches."""
    batches = np.reshape(samples, (25, -1)).mean(axis=1)
    return batches.mean(), batches.std(ddof=1) / 5


def forceErrors(mesh, terms):
    """Return the relative root mean square errors of the forces on the CPU platform in double and in mixed precision,
    against the Reference platform's.

    These are rounded once, from extended precision.  What mixed precision adds shows in where a single step of a
    trajectory leads: that goes by h^2/2m times the forces.
    """
    exact, double = (
        forcesOf(createContext(mesh, createForce(mesh, terms), platform)) for platform in ("Reference", "CPU")
    )
    step, ends = 1e-5, []
    for precision in ("double", "mixed"):
        integrator = mh.HamiltonianTrajectoryIntegrator(300, step, 1)
        integrator.setRandomNumberSeed(1)
        integrator.setForcePrecision(precision)
        context = createContext(mesh, createForce(mesh, terms), "CPU", integrator)
        integrator.step(1)
        assert integrator.getNumAccepted() == 1
        ends.append(positionsOf(context))
    mixed = double + 2 / step**2 * (ends[1] - ends[0])
    return [np.linalg.norm(forces - exact) / np.linalg.norm(exact) for forces in (double, mixed)]


@pytest.mark.parametrize("terms", [[term] for term in TERMS] + [TERMS], ids="+".join)
def test_rounding_errors_of_forces(terms):
    """They are those of some ten operations in the precision of each, and energies are as exact; repulsion is in double
    precision throughout.
    """
    mesh = createBlob(3)
    double, mixed = forceErrors(mesh, terms)
    assert 1e-17 < double < 1e-14
    assert mixed < 2e-6 and (mixed > 1e-9 or terms == ["repulsion"])
    exact, found = (energyOf(createContext(mesh, createForce(mesh, terms), platform)) for platform in PLATFORMS)
    assert found == pytest.approx(exact, rel=1e-14)


def test_mixed_precision_samples_the_same_distribution():
    """<exp(-dH/kT)> = 1, and <E_B> is that of double precision, with flips and long steps."""
    means = {}
    for seed, precision in enumerate(("double", "mixed"), 1):
        mesh, force = createVesicle()
        integrator = mh.HybridMonteCarloIntegrator(kelvin(KT), 0.004, 20, 0.2, 0.2)
        integrator.setRandomNumberSeed(seed)
        integrator.setForcePrecision(precision)
        context = createContext(mesh, force, "CPU", integrator)
        integrator.step(500)
        trajectory, factors, bending = integrator.getMove(0), [], []
        for _ in range(6000):
            integrator.step(1)
            factors.append(np.exp(-trajectory.getLastEnergyChange() / unit.kilojoule_per_mole / KT))
            bending.append(termsOf(force, context)["bending"])
        assert 0.6 < integrator.getAcceptanceRate() < 0.99
        mean, error = meanOf(factors)
        assert error < 0.03 and abs(mean - 1) < 3 * error
        means[precision] = meanOf(bending)
    (exact, exactError), (mixed, mixedError) = means["double"], means["mixed"]
    assert max(exactError, mixedError) < 0.01 * exact
    assert abs(mixed - exact) < 3 * np.hypot(exactError, mixedError)


def test_mixed_precision_hardly_changes_the_energy_of_a_trajectory():
    """From the same start with the same momenta, the errors of the forces change dH by far less than kT, and yet by
    something.
    """
    changes = {}
    for precision in ("double", "mixed"):
        mesh, force = createVesicle()
        integrator = mh.HamiltonianTrajectoryIntegrator(kelvin(KT), 0.001, 50)
        integrator.setRandomNumberSeed(3)
        integrator.setForcePrecision(precision)
        context = createContext(mesh, force, "CPU", integrator)
        integrator.step(1)
        changes[precision] = integrator.getLastEnergyChange() / unit.kilojoule_per_mole / KT
        del context
    assert 1e-12 < abs(changes["double"] - changes["mixed"]) < 1e-3


def createRun():
    mesh = createBlob(3)
    integrator = mh.HybridMonteCarloIntegrator(30000, 0.00001, 10, 0.2, 0.5)
    integrator.setRandomNumberSeed(3)
    integrator.setForcePrecision("mixed")
    system = mesh.createSystem()
    force = createForce(mesh)
    system.addForce(force)
    simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatform("CPU"))
    simulation.context.setPositions(mesh.vertices)
    return simulation, force


@pytest.mark.parametrize("kind", ["Checkpoint", "State"])
def test_continued_runs_are_the_same_to_the_last_bit(kind, tmp_path):
    simulation, force = createRun()
    simulation.step(12)
    getattr(simulation, "save" + kind)(str(tmp_path / "saved"))
    simulation.step(12)
    again, forceAgain = createRun()
    getattr(again, "load" + kind)(str(tmp_path / "saved"))
    again.step(12)
    assert simulation.integrator.getNumAcceptedTrajectories() > 0
    assert np.array_equal(positionsOf(again.context), positionsOf(simulation.context))
    assert np.array_equal(
        forceAgain.getTrianglesInContext(again.context), force.getTrianglesInContext(simulation.context)
    )


def test_beside_other_forces_it_is_double_precision():
    ends = []
    for precision in ("double", "mixed"):
        mesh, force = createVesicle()
        integrator = mh.HamiltonianTrajectoryIntegrator(kelvin(KT), 0.002, 20)
        integrator.setRandomNumberSeed(3)
        integrator.setForcePrecision(precision)
        context = createContext(mesh, [force, mm.CustomExternalForce("0")], "CPU", integrator)
        integrator.step(3)
        ends.append(positionsOf(context))
    assert np.array_equal(*ends)


def test_integrators_refuse_other_precisions():
    with pytest.raises(mm.OpenMMException, match="'single'; it must be 'double' or 'mixed'"):
        mh.HamiltonianTrajectoryIntegrator(300, 0.1).setForcePrecision("single")
    custom = mh.HybridMonteCarloIntegrator(300, 0.1, engine="custom")
    custom.setForcePrecision("double")
    with pytest.raises(mm.OpenMMException, match=r"'mixed'.*other than 'double'"):
        custom.setForcePrecision("mixed")
    assert custom.getForcePrecision() == "double"


def test_configuration():
    def simulationOf(**platform):
        config = parseConfig({"mesh": {"icosphere": 1}, "platform": platform})
        scene = Scene.of(config)
        return scene.createSimulation(scene.createForce())

    assert simulationOf().integrator.getForcePrecision() == "double"
    assert simulationOf(precision="mixed").integrator.getForcePrecision() == "mixed"
    with pytest.raises(ValueError, match=r"\[platform\] precision is 'mixed'; only the CPU platform.*not Reference"):
        simulationOf(name="Reference", precision="mixed")
    with pytest.raises(ValueError, match=r"\[platform\] precision is 'single'; it must be 'double' or 'mixed'"):
        parseConfig({"mesh": {"icosphere": 1}, "platform": {"precision": "single"}})
