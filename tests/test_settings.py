"""Settings that contradict each other, or do nothing, are errors that name what is wrong."""

import re
import subprocess
import sys

import numpy as np
import openmm as mm
import pytest
from openmm import app, unit

import openmmhelfrich as mh
from openmmhelfrich.runs.config import readConfig
from openmmhelfrich.runs.grids import readGrid
from openmmhelfrich.runs.stages import checkStages

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
    ("setSpontaneousCurvature", [nm**-1]),
    ("setGaussianModulus", [kJ]),
]
INTEGRATORS = [
    (mh.EdgeFlipIntegrator, [K, 1.0], []),
    (mh.HamiltonianTrajectoryIntegrator, [K, ps, 3], ["setTemperature", "setStepSize"]),
    (mh.CustomTrajectoryIntegrator, [K, ps, 3], ["setTemperature", "setStepSize"]),
    (mh.ShearWaveIntegrator, [K, nm, nm**-1, nm**-1], ["setTemperature", "setAmplitude"]),
    (mh.SpeciesExchangeIntegrator, [K, 1.0], ["setTemperature", "setFraction"]),
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
    others = {"Triangle", "FixedEdge", "ForceGroup", "Name", "set_", "Species", "Periodic"}
    ofPairs = {"setLineTension", "setPairEnergy"}  # test_species.py has them
    setters = {name for name in dir(mh.HelfrichForce) if name.startswith("set")}
    found = {name for name in setters if not any(word in name for word in others)} - ofPairs
    assert found == dict(FORCE_SETTERS).keys()


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


def testWords():
    """What is to be a string is named."""
    mixture, trajectories, exchanges = (
        mh.HybridMonteCarloIntegrator(300, 0.01),
        mh.HamiltonianTrajectoryIntegrator(300, 0.01, 5),
        mh.SpeciesExchangeIntegrator(300, 0.1),
    )
    for setter, name in (
        (mixture.setSplitting, "HamiltonianTrajectoryIntegrator.setSplitting: splitting"),
        (trajectories.setForcePrecision, "HamiltonianTrajectoryIntegrator.setForcePrecision: precision"),
        (exchanges.setProposal, "SpeciesExchangeIntegrator.setProposal: proposal"),
    ):
        for wrong in (None, 3, 1.0 * unit.nanometer, b"leapfrog"):
            with pytest.raises(TypeError, match=rf"^{re.escape(f'{name} is {wrong!r}')}; it must be a string$"):
                setter(wrong)


def testKeywordsOfTheMixture():
    """A wrong keyword, or a missing one, is named without words that users do not know."""
    with pytest.raises(TypeError, match=r"there is no argument 'flip_fraction'; did you mean 'flipFraction'?"):
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
        for beside in ([], [createForce(mesh)]):
            for integrator in (mh.HybridMonteCarloIntegrator(300, 0.001, 10), mh.EdgeFlipIntegrator(300, 0.1)):
                system = createSystem(mesh, *(force.__copy__() for force in (*beside, hidden)))
                with pytest.raises(mm.OpenMMException, match=message):
                    createContext(system, integrator, mesh)


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
    integrator = mh.HybridMonteCarloIntegrator(300, 0.001, 10, flipProbability=0)
    context = createContext(createSystem(mesh, createVariable(mesh)), integrator, mesh)
    integrator.step(2)
    integrator.setFlipProbability(1)
    with pytest.raises(mm.OpenMMException, match="is inside another Force"):
        integrator.step(1)


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
    with pytest.raises(mm.OpenMMException, match=r"periodic box is 1.5 nm along x, and the vertices span 2 nm"):
        energy(1.5, True)
    # A sphere around the box's boundary, as periodic boundary conditions would have it.
    wrapped = np.where(mesh.vertices[:, :1] < 0, mesh.vertices + np.array([3, 0, 0]), mesh.vertices)
    for isPeriodic in (False, True):
        with pytest.raises(mm.OpenMMException, match=r"does not use periodic boundary conditions.*no edge longer"):
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


def runConfig(tmp_path, **sections):
    """Run a configuration with a small sphere and return the Summary."""
    sections = {"mesh": {"icosphere": 2}, **sections}
    sections["sampling"] = {"steps": 4, "steps_per_trajectory": 5, "seed": 1, **sections.get("sampling", {})}
    sections["output"] = {"prefix": str(tmp_path / "run"), "mesh_trajectory": False, **sections.get("output", {})}
    if "stages" in sections:
        del sections["sampling"]["steps"]
    return mh.run(sections)


IDLE_TARGETS = [
    ({"target_area": 10.0, "area_modulus": 0}, "[membrane] target_area is 10.0, and has no effect, since area_modulus"),
    ({"target_volume": 3.5, "volume_modulus": 0}, "[membrane] target_volume is 3.5, and has no effect, since volume_m"),
    ({"reduced_volume": 0.9, "volume_modulus": 0}, "[membrane] reduced_volume is 0.9, and has no effect, since volum"),
    ({"target_area_difference": 30.0}, "[membrane] target_area_difference is 30.0, and has no effect, since area_dif"),
]


@pytest.mark.parametrize("membrane, message", IDLE_TARGETS)
def testTargetsWithoutModulus(tmp_path, membrane, message):
    """A target whose modulus is 0 is an error before anything is written, in a run and in a grid."""
    with pytest.raises(ValueError, match=message.replace("[", r"\[")):
        runConfig(tmp_path, membrane=membrane)
    assert not list(tmp_path.iterdir())
    with pytest.raises(ValueError, match=message.replace("[", r"\[")):
        mh.Scene.of({"membrane": membrane}, mh.Mesh.icosphere(1))
    lines = [f"{key} = {value}" for key, value in membrane.items()]
    grid = tmp_path / "grid.toml"
    grid.write_text("\n".join(["[base.mesh]", "icosphere = 2", "[base.membrane]", *lines]))
    with pytest.raises(ValueError, match=message.replace("[", r"\[")):
        mh.sweep(grid)


@pytest.mark.parametrize(
    "section, idle, switch",
    [
        ("repulsion", {"onset": 0.2}, {"modulus": 0}),
        ("repulsion", {"exponent": 3}, {"modulus": 10}),
        ("sampling", {"shear_wave_cutoff": 2.0}, {"shear_wave_probability": 0.1}),
        ("sampling", {"burn_in": 2}, {"step_size": "auto"}),
        ("sampling", {"burn_in": 2}, {"shear_wave_probability": 0.1}),
        ("sampling", {"target_acceptance": 0.9}, {"step_size": "auto"}),
    ],
)
def testKeysThatHaveNoEffect(tmp_path, section, idle, switch):
    """What describes something that is off is an error, unless its switch is given, even if that is 0."""
    (key,) = idle
    for read in (runConfig, lambda _, **sections: mh.Scene.of(sections, mh.Mesh.icosphere(1))):
        with pytest.raises(ValueError, match=rf"\[{section}\] {key} is .*, and has no effect, since"):
            read(tmp_path, **{section: idle})
    assert not list(tmp_path.iterdir())
    mh.Scene.of({section: idle | switch}, mh.Mesh.icosphere(1))


def testAnAcceptanceToAimAtHasAnEffect():
    """On stages whose step size follows it; the default does no harm, as resolved configurations have it."""
    annealing = {"kind": "anneal", "steps": 2, "end_temperature": 200}
    automatic = {"kind": "sample", "steps": 2, "step_size": "auto"}
    for sampling, stages in (
        ({"target_acceptance": 0.9}, [annealing]),
        ({"target_acceptance": 0.9}, [automatic]),
        ({"target_acceptance": 0.75, "step_size": 1e-4}, []),
    ):
        mh.Scene.of({"sampling": sampling, "stages": stages}, mh.Mesh.icosphere(1))


def testAScriptIsToldOfFarTargets(recwarn):
    """A Scene by itself does not lead there, and says so where it was to be led."""
    for membrane, approach, isFar in (
        ({"reduced_volume": 0.7}, "auto", True),
        ({"reduced_volume": 0.7}, "none", False),
        ({"reduced_volume": 0.93}, "auto", False),
        ({}, "auto", False),
    ):
        mh.Scene.of({"membrane": membrane, "sampling": {"approach": approach}}, mh.Mesh.icosphere(1))
        said = [str(recwarn.pop(UserWarning).message)] if len(recwarn) else []
        assert len(said) == isFar and all("lead it there by continueTo()" in text for text in said)


def testTargetsThatHaveAnEffect(tmp_path):
    """The target of an area without modulus may set that of the volume, and resolved configurations run again."""
    runConfig(tmp_path, membrane={"target_area": 13.0, "area_modulus": 0, "reduced_volume": 0.9})
    summary = runConfig(tmp_path, membrane={"area_modulus": 0}, output={"overwrite": True})
    config = readConfig(tmp_path / "run.resolved.toml")
    assert config.membrane.area_modulus == 0 and config.membrane.target_area is not None
    config.output.prefix = str(tmp_path / "again")
    assert np.array_equal(mh.run(config).table["energy"], summary.table["energy"])


@pytest.mark.parametrize(
    "stage, idle", [({"target_area": 12.0}, "area"), ({"target_area": 12.0, "target_volume": 3.5}, "area")]
)
def testTargetsOfStagesWithoutModulus(tmp_path, stage, idle):
    """Each target of a stage must have a modulus."""
    with pytest.raises(ValueError, match=rf"stage 1 \(sample\): it has a target for the {idle}, whose modulus is 0"):
        runConfig(
            tmp_path,
            membrane={"area_modulus": 0},
            sampling={"approach": "none"},
            stages=[{"kind": "sample", "steps": 4, **stage}],
        )


@pytest.mark.parametrize("key, value", [("target_area", 1257.0), ("target_area", 1.2e7), ("target_volume", 4200.0)])
def testTargetsOfAnotherScale(tmp_path, key, value):
    """Targets in another unit of length than the mesh's are told, in [membrane] and in stages."""
    message = "is .*; it must be within a factor of .* of the mesh, .*: one of them may be in another unit of length"
    with pytest.raises(ValueError, match=rf"\[membrane\] {key} {message}"):
        runConfig(tmp_path, membrane={key: value})
    with pytest.raises(ValueError, match=rf"stage 1 \(sample\): the target \w+ {message}"):
        runConfig(tmp_path, stages=[{"kind": "sample", "steps": 4, key: value}])


# A sphere of the radius 1 has 25.13; the icosphere's area is a little smaller.
@pytest.mark.parametrize("target", [1e9, -1e9, 25.13e6, 25.13e-6, 1e-12])
@pytest.mark.parametrize("approach", ["none", "auto"])
def testAreaDifferencesOfAnotherScale(target, approach):
    """They are refused wherever they are given, with the way to let an area difference go."""
    mesh, sampling = mh.Mesh.icosphere(2), {"seed": 1, "approach": approach}
    held, stage = {"area_difference_modulus": 100.0}, {"kind": "sample", "steps": 1}
    words = rf"is {re.escape(f'{target:g}')}; its size must be from 0\.000249\d* to 249\d.*area_difference_modulus of 0"
    given = {"target_area_difference": target}

    def refuses(where, membrane, stage):
        with pytest.raises(ValueError, match=f"{re.escape(where)}.* {words}"):
            checkStages(mh.Scene.of({"membrane": membrane, "sampling": sampling, "stages": [stage]}, mesh))

    refuses("[membrane] target_area_difference", held | given, stage)
    refuses("stage 1 (sample): the target area difference", held, stage | given)
    refuses("stage 1 (sample): ", given, stage | held)
    refuses("stage 1 (continue): the target area difference", held, {"kind": "continue", "steps": 1} | given)
    scene = mh.Scene.of({"membrane": held, "sampling": sampling}, mesh)
    force = scene.createForce()
    simulation = scene.createSimulation(force)
    with pytest.raises(ValueError, match=f"^continueTo: the target areaDifference {words}"):
        mh.continueTo(simulation, force, {"areaDifference": target}, windows=1)


def testReducedVolumesOfAnotherScale():
    """Messages about the volume that a reduced one gives say where it is from."""
    mesh, small = mh.Mesh.icosphere(1), {"reduced_volume": 0.001}
    for where, config in (
        ("[membrane] the", {"membrane": small}),
        ("stage 1 (sample): the", {"stages": [{"kind": "sample", "steps": 1} | small]}),
    ):
        with pytest.raises(ValueError, match=re.escape(f"{where} target volume that reduced_volume gives is 0.0")):
            checkStages(mh.Scene.of({**config, "sampling": {"seed": 1}}, mesh))


@pytest.mark.parametrize("target", [-400.0, -0.1, 0.01, 30.0, 2000.0])
def testAreaDifferencesOfTheMesh(target):
    """Stomatocytes have small ones and negative ones, chains of buds and tubes large ones, of any separation."""
    for scale, separation in ((1.0, 1.0), (500.0, 0.002)):
        held = {"area_difference_modulus": 100.0, "leaflet_separation": separation}
        given = {"target_area_difference": target * scale * separation}
        stage, sampling = {"kind": "sample", "steps": 1}, {"seed": 1, "approach": "none"}
        for membrane, last in ((held | given, stage), (held, stage | given)):
            config = {"membrane": membrane, "sampling": sampling, "stages": [last]}
            checkStages(mh.Scene.of(config, mh.Mesh.icosphere(2, scale)))


def testChangedIntervals(tmp_path):
    """An interval that is changed is said, and a default is changed without a word."""
    stages = [{"kind": "continue", "windows": 1, "steps": 2, "equilibration": 1, "target_volume": 4.0}]
    notes = runConfig(tmp_path, stages=stages, output={"observables_interval": 500}).notes
    assert any(
        note.startswith("[output] observables_interval is 2, and not 500, so that each window") for note in notes
    )
    notes = runConfig(tmp_path, output={"overwrite": True, "trajectory_interval": 1000}).notes
    assert "[output] trajectory_interval is 4, and not 1000, so that the run has a frame" in notes
    assert not any("_interval is" in note for note in runConfig(tmp_path, output={"overwrite": True}).notes)


def testWholeNumbersAndNamesOfPlatforms(tmp_path):
    """Whole numbers may be written as 1e3, and platforms in any letters."""
    file = tmp_path / "run.toml"
    file.write_text(
        '[mesh]\nicosphere = 2.0\n[sampling]\nsteps = 1e3\nseed = 7e0\n[platform]\nname = "cpu"\nthreads = 1.0\n'
        "[output]\ntrajectory_interval = 2e2\n"
    )
    config = readConfig(file)
    assert (config.sampling.steps, config.sampling.seed, config.mesh.icosphere) == (1000, 7, 2)
    assert (config.platform.name, config.platform.threads, config.output.trajectory_interval) == ("CPU", 1, 200)
    assert isinstance(config.sampling.steps, int)
    file.write_text("[mesh]\nicosphere = 2\n[sampling]\nsteps = 1.5e0\n")
    with pytest.raises(ValueError, match=r"\[sampling\] steps is 1.5; it must be a whole number"):
        readConfig(file)
    for name in ("reference", "REFERENCE"):
        assert runConfig(tmp_path, platform={"name": name}, output={"overwrite": True}).steps == 4
    with pytest.raises(ValueError, match="name is 'gpu'; it must be one of Reference, CPU"):
        runConfig(tmp_path, platform={"name": "gpu"}, output={"overwrite": True})


GRID = """
[base.mesh]
icosphere = 2
[base.membrane]
target_volume = 3.9
[base.sampling]
steps = 4
mass = 3.0
[variants.file]
mesh.file = "mesh.ply"
[variants.reduced]
membrane.reduced_volume = 0.9
sampling.mass = "unset"
[variants.same]
"""


def testVariantsTakeKeysAway(tmp_path):
    """A variant's key takes the place of the one that excludes it, and "unset" takes a key away."""
    mh.Mesh.icosphere(1, 1.0).write(tmp_path / "mesh.ply")
    grid = tmp_path / "grid.toml"
    grid.write_text(GRID)
    file, reduced, same = (point.config for point in readGrid(grid))
    assert file.mesh.icosphere is None and file.mesh.file.endswith("mesh.ply")
    assert (reduced.membrane.target_volume, reduced.membrane.reduced_volume) == (None, 0.9)
    assert (same.membrane.target_volume, same.mesh.icosphere) == (3.9, 2)
    assert (reduced.sampling.mass, same.sampling.mass) == (1, 3)
    grid.write_text(GRID + "mesh = {file = 'mesh.ply', icosphere = 1}\n")
    with pytest.raises(ValueError, match=r"\[mesh\] file and icosphere are both given; give one of them"):
        readGrid(grid)
    grid.write_text("[base]\nmesh.icosphere = 2\n[grid]\nmesh.file = ['mesh.ply']\n")
    assert [point.config.mesh.icosphere for point in readGrid(grid)] == [None]


def testSweepWithoutGuard(tmp_path):
    """A script may begin a sweep without asking whether it is the main program."""
    pytest.importorskip("distributed")
    (tmp_path / "grid.toml").write_text(
        "[base]\nmesh.icosphere = 1\nsampling.steps = 2\n[grid]\nsampling.mass = [1, 2]"
    )
    script = tmp_path / "script.py"
    script.write_text("import openmmhelfrich as mh\nprint(mh.sweep('grid.toml', workers=1).count('done'))\n")
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert (done.stdout, done.stderr, done.returncode) == ("2\n", "", 0)


def testContinuationOfReducedVolumes():
    """A reduced volume is that of the area where this has no modulus, and an error where the volume has none."""
    mesh = mh.Mesh.icosphere(2, 1.0)

    def continued(volumeModulus, **targets):
        force = createForce(mesh)
        force.setVolumeModulus(volumeModulus)
        force.setTargetVolume(mesh.volume)
        integrator = mh.HybridMonteCarloIntegrator(300, 0.0005, 5)
        integrator.setRandomNumberSeed(1)
        system = createSystem(mesh, force)
        simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatform("Reference"))
        simulation.context.setPositions(mesh.vertices)
        mh.continueTo(simulation, force, targets, windows=2, equilibration=0, steps=1)
        return simulation.context.getParameter(force.getTargetVolumeParameter())

    assert continued(1e5, reducedVolume=0.9) == pytest.approx(0.9 * mesh.area**1.5 / (6 * np.pi**0.5))
    with pytest.raises(ValueError, match="target reducedVolume, and it has no effect, since the modulus of the volume"):
        continued(0, reducedVolume=0.9)
    with pytest.raises(ValueError, match="target area, and it has no effect, since the modulus of the area is 0"):
        continued(1e5, area=12)


def testAdaptationWithoutTrajectories():
    """A step size that no acceptance tells is not adapted, whatever holds the integrator that has it."""
    mesh = mh.Mesh.icosphere(1, 1.0)
    compound = mm.CompoundIntegrator()
    compound.addIntegrator(mm.LangevinMiddleIntegrator(300, 1, 0.001))
    langevins = [mm.LangevinMiddleIntegrator(300, 1, 0.001) for _ in range(2)]
    for integrator in (langevins[0], compound, mh.HybridMonteCarloIntegrator(langevins[1])):
        system = createSystem(mesh, createForce(mesh))
        simulation = app.Simulation(mesh.topology(), system, integrator, mm.Platform.getPlatform("Reference"))
        with pytest.raises(ValueError, match=r"there is no step size to adapt: .*; one must be a CustomTrajectory"):
            mh.adaptStepSize(simulation, 10)


def testMissingTable(tmp_path):
    """A table that is gone is not called short."""
    runConfig(tmp_path)
    (tmp_path / "run.csv").unlink()
    with pytest.raises(ValueError, match=r"there is no file .*run\.csv; it had \d+ bytes at the last checkpoint"):
        mh.resume(tmp_path / "run", steps=2)


def testPipeThatEndsEarly(tmp_path):
    """What reads the first line only ends no command with a message."""
    mh.Mesh.icosphere(2, 1.0).write(tmp_path / "mesh.ply")
    command = [sys.executable, "-m", "openmmhelfrich.cli", "check", "mesh.ply"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait() == 0
