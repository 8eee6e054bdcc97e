"""Settings that contradict each other, or do nothing, are errors that name what is wrong."""

import numpy as np
import openmm as mm
import pytest
from openmm import unit

import openmmhelfrich as mh

nm, kJ, K, ps = unit.nanometer, unit.kilojoule_per_mole, unit.kelvin, unit.picosecond
# A setter, its arguments, the one that is wrong and what it must be, for every one with a dimension.
FORCE_SETTERS = [
    ("setBendingModulus", [kJ]),
    ("setAreaModulus", [kJ]),
    ("setVolumeModulus", [kJ]),
    ("setAreaDifferenceModulus", [kJ]),
    ("setTargetArea", [nm**2]),
    ("setTargetVolume", [nm**3]),
    ("setTargetAreaDifference", [nm**2]),
    ("setLeafletSeparation", [nm]),
    ("setTether", [kJ, nm, nm, 2]),
    ("setTetherLengthScale", [nm]),
    ("setRepulsion", [kJ, nm, 2]),
    ("setRepulsionLengthScale", [nm]),
    ("setTension", [kJ / nm**2]),
    ("setPressure", [kJ / nm**3]),
]
INTEGRATORS = [
    (mh.EdgeFlipIntegrator, [K, 1.0], []),
    (mh.HamiltonianTrajectoryIntegrator, [K, ps, 3], ["setTemperature", "setStepSize"]),
    (mh.CustomTrajectoryIntegrator, [K, ps, 3], ["setTemperature", "setStepSize"]),
    (mh.ShearWaveIntegrator, [K, nm, nm**-1, nm**-1], ["setTemperature", "setAmplitude"]),
    (mh.HybridMonteCarloIntegrator, [K, ps, 3, 0.1, 0.5], ["setTemperature", "setStepSize"]),
]


def checkArguments(call, wanted):
    """Assert that a call takes numbers and Quantities, and says what is wrong with anything else."""
    arguments = [(1.5 + i) * item if unit.is_unit(item) else item for i, item in enumerate(wanted)]
    call(*arguments)
    call(*(argument._value if unit.is_quantity(argument) else argument for argument in arguments))
    for i, item in enumerate(wanted):
        if isinstance(item, int):
            continue
        wrong = arguments.copy()
        wrong[i] = 20 * unit.kilogram
        message = "must be a number" + (", or a Quantity of an? " if unit.is_unit(item) else " without a unit")
        with pytest.raises(ValueError, match=f"is 20 kg; it {message}"):
            call(*wrong)
        wrong[i] = "20"
        with pytest.raises(TypeError, match=f"is '20'; it {message}"):
            call(*wrong)


@pytest.mark.parametrize("name, wanted", FORCE_SETTERS)
def testUnitsOfForce(name, wanted):
    """Every setter of a HelfrichForce checks the dimension of every argument."""
    force = mh.HelfrichForce()
    checkArguments(getattr(force, name), wanted)
    with pytest.raises((ValueError, TypeError), match=rf"HelfrichForce\.{name}: \w+ is "):
        getattr(force, name)(*[unit.kilogram * 1.0] * len(wanted))


def testEverySetterIsTested():
    """The list of setters with a dimension is complete."""
    others = {"Triangle", "FixedEdge", "ForceGroup", "Name", "set_"}
    setters = {name for name in dir(mh.HelfrichForce) if name.startswith("set")}
    assert {name for name in setters if not any(word in name for word in others)} == dict(FORCE_SETTERS).keys()


@pytest.mark.parametrize("cls, wanted, setters", INTEGRATORS)
def testUnitsOfIntegrators(cls, wanted, setters):
    """Every integrator checks the dimension of every argument, and so do its setters."""
    checkArguments(cls, wanted)
    arguments = [1.5 * item if unit.is_unit(item) else item for item in wanted]
    integrator = cls(*arguments)
    for setter, item in zip(setters, wanted):
        checkArguments(getattr(integrator, setter), [item])


def testQuantitiesAreConverted():
    """Quantities of the right dimension may be in any unit, and numbers of any type."""
    force = mh.HelfrichForce()
    force.setBendingModulus(2 * unit.kilocalorie_per_mole)
    assert force.getBendingModulus() == 8.368 * kJ
    for number in (3, np.float32(3), np.int64(3), np.array(3.0)):
        force.setTargetArea(number)
        assert force.getTargetArea() == 3 * nm**2
    force.setTether(1, 5 * unit.angstrom, np.float64(2), np.int32(2))
    assert force.getTether() == [1 * kJ, 0.5 * nm, 2 * nm, 2]


def testWholeNumbers():
    """What is to be a whole number is named."""
    force = mh.HelfrichForce()
    with pytest.raises(TypeError, match=r"HelfrichForce\.setTether: exponent is 2\.5; it must be a whole number"):
        force.setTether(1, 1, 2, 2.5)
    with pytest.raises(TypeError, match=r"HelfrichForce\.addTriangle: particle3 is '2'; it must be a whole number"):
        force.addTriangle(0, 1, "2")
    with pytest.raises(ValueError, match=r"HelfrichForce\.setTether: exponent is 1099511627776; it must be a whole"):
        force.setTether(1, 1, 2, 2**40)
    with pytest.raises(TypeError, match=r"HybridMonteCarloIntegrator: stepsPerTrajectory is '9'; it must be a whole"):
        mh.HybridMonteCarloIntegrator(300, 1, "9")


def testKeywordsOfTheMixture():
    """A wrong keyword, or a missing one, is named without words that users do not know."""
    with pytest.raises(TypeError, match="there is no argument 'flip_fraction'; did you mean 'flipFraction'?"):
        mh.HybridMonteCarloIntegrator(300, 0.01, flip_fraction=0.1)
    with pytest.raises(TypeError, match="there is no argument 'x'; it has temperature, stepSize"):
        mh.HybridMonteCarloIntegrator(300, 0.01, x=0.1)
    with pytest.raises(TypeError, match=r"^HybridMonteCarloIntegrator\(\) missing .* 'stepSize'"):
        mh.HybridMonteCarloIntegrator(300)


def createSystem(mesh, *forces):
    system = mesh.createSystem()
    for force in forces:
        system.addForce(force)
    return system


def createForce(mesh):
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(50)
    return force


def createContext(system, integrator, mesh, platform="Reference"):
    context = mm.Context(system, integrator, mm.Platform.getPlatform(platform))
    context.setPositions(mesh.vertices)
    return context


def createPeriodicForce():
    force = mm.CustomBondForce("0*r")
    force.setUsesPeriodicBoundaryConditions(True)
    return force


BAROSTATS = {
    "MonteCarloBarostat": (1, 300),
    "MonteCarloAnisotropicBarostat": ((1, 1, 1), 300),
    "MonteCarloFlexibleBarostat": (1, 300),
    "MonteCarloMembraneBarostat": (
        1,
        0,
        300,
        mm.MonteCarloMembraneBarostat.XYIsotropic,
        mm.MonteCarloMembraneBarostat.ZFree,
    ),
    "AndersenThermostat": (300, 1),
}


@pytest.mark.parametrize("name", BAROSTATS)
def testForcesThatNeverAct(name):
    """Forces that no move asks to change the state are refused, and act where one does."""
    mesh = mh.Mesh.icosphere(2, 1.0)

    def createSystemWithOther():
        system = createSystem(mesh, createForce(mesh), getattr(mm, name)(*BAROSTATS[name]), createPeriodicForce())
        system.setDefaultPeriodicBoxVectors((9, 0, 0), (0, 9, 0), (0, 0, 9))
        return system

    for integrator in (
        mh.HybridMonteCarloIntegrator(300, 0.001, 10),
        mh.HybridMonteCarloIntegrator(300, 0.001, 10, engine="custom"),
        mh.HamiltonianTrajectoryIntegrator(300, 0.001, 10),
        mh.EdgeFlipIntegrator(300, 0.1),
    ):
        with pytest.raises(mm.OpenMMException, match=f"force 1 of the System, '{name}', would never act: .*; take it"):
            createContext(createSystemWithOther(), integrator, mesh)
    langevin = mm.LangevinMiddleIntegrator(300, 1, 0.001)
    mixture = mh.HybridMonteCarloIntegrator(langevin, mh.EdgeFlipIntegrator(300, 0.1), 0.5)
    context = createContext(createSystemWithOther(), mixture, mesh)
    mixture.step(4)
    assert context.getStepCount() == 4


def createVariable(mesh):
    variable = mm.CustomCVForce("0.1*energy")
    variable.addCollectiveVariable("energy", createForce(mesh))
    return variable


def testMembranesInsideOtherForces():
    """A HelfrichForce in a CustomCVForce would keep its triangles: where edges flip, it is refused."""
    mesh = mh.Mesh.icosphere(2, 1.0)
    message = "the HelfrichForce '.*' is inside another Force of the System, where it would keep the triangles"
    nested = mm.CustomCVForce("v")
    nested.addCollectiveVariable("v", createVariable(mesh))
    alchemical = mm.ATMForce(0, 0, 0, 0, 0, 0, 0, 0, 1)
    for _ in range(mesh.vertices.shape[0]):
        alchemical.addParticle()
    alchemical.addForce(createForce(mesh))
    for hidden in (createVariable(mesh), nested, alchemical):
        for integrator in (mh.HybridMonteCarloIntegrator(300, 0.001, 10), mh.EdgeFlipIntegrator(300, 0.1)):
            with pytest.raises(mm.OpenMMException, match=message):
                createContext(createSystem(mesh, createForce(mesh), hidden.__copy__()), integrator, mesh)


def testMembranesInsideOtherForcesWithoutFlips():
    """Where no edge flips, a HelfrichForce in a CustomCVForce is fine, until flips begin."""
    mesh = mh.Mesh.icosphere(2, 1.0)
    integrator = mh.HybridMonteCarloIntegrator(300, 0.001, 10, flipProbability=0)
    context = createContext(createSystem(mesh, createForce(mesh), createVariable(mesh)), integrator, mesh)
    integrator.step(2)
    energy = context.getState(energy=True).getPotentialEnergy()
    force = mh.HelfrichForce.cast(context.getSystem().getForce(0))
    alone = force.getEnergyTermsInContext(context)["bending"]
    assert energy / alone == pytest.approx(1.1)
    integrator.setFlipProbability(1)
    with pytest.raises(mm.OpenMMException, match="is inside another Force"):
        integrator.step(1)
    flips = mh.EdgeFlipIntegrator(300, 0)
    context = createContext(createSystem(mesh, createForce(mesh), createVariable(mesh)), flips, mesh)
    flips.step(2)


def testMeshesThatSpanThePeriodicBox():
    """A mesh that is as large as the System's periodic box, or that goes on beyond it, is an error."""
    mesh = mh.Mesh.icosphere(2, 1.0)

    def energy(box, isPeriodic, vertices=mesh.vertices):
        system = createSystem(mesh, createForce(mesh))
        if isPeriodic:
            system.addForce(createPeriodicForce())
        system.setDefaultPeriodicBoxVectors((box, 0, 0), (0, box, 0), (0, 0, box))
        context = mm.Context(system, mm.VerletIntegrator(0.001), mm.Platform.getPlatform("Reference"))
        context.setPositions(vertices)
        return context.getState(energy=True).getPotentialEnergy()

    assert energy(5, True) == energy(5, False) == energy(1.5, False) == energy(2, False)
    with pytest.raises(mm.OpenMMException, match="periodic box is 1.5 nm along x, and the vertices span 2 nm"):
        energy(1.5, True)
    # A sphere around the box's boundary, as periodic boundary conditions would have it.
    wrapped = np.where(mesh.vertices[:, :1] < 0, mesh.vertices + [3, 0, 0], mesh.vertices)
    for isPeriodic in (False, True):
        with pytest.raises(mm.OpenMMException, match="does not use periodic boundary conditions.*no edge longer"):
            energy(3, isPeriodic, wrapped)


@pytest.mark.parametrize("engine", ["native", "custom"])
def testTimeOfTrajectories(engine):
    """The time of a Context advances by the length of its trajectories."""
    mesh = mh.Mesh.icosphere(2, 1.0)
    integrator = mh.HybridMonteCarloIntegrator(300, 0.001, 25, engine=engine, flipProbability=0)
    context = createContext(createSystem(mesh, createForce(mesh)), integrator, mesh)
    integrator.step(4)
    assert context.getTime() / ps == pytest.approx(0.1)


@pytest.mark.parametrize("platform", ["Reference", "CPU"])
def testSmallFlipFractions(platform):
    """A sweep has an attempt at least, unless the fraction is 0."""
    mesh = mh.Mesh.icosphere(2, 1.0)
    for fraction, numAttempts in ((0, 0), (1e-9, 1), (1 / 481, 1), (1 / 480, 1), (2 / 480, 2)):
        integrator = mh.EdgeFlipIntegrator(300, fraction)
        context = createContext(createSystem(mesh, createForce(mesh)), integrator, mesh, platform)
        integrator.step(3)
        assert integrator.getNumAttempted() == 3 * numAttempts
        del context
