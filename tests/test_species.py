"""Species, spontaneous curvature, Gaussian modulus, line tension and pair energies, as a script uses them."""

import copy

import numpy as np
import openmm as mm
import pytest
from openmm import app, unit

import openmmhelfrich as mh
from membranes import PLATFORMS, createBlob, createContext, createForce, energyOf, forcesOf, positionsOf, termsOf

kJ, nm = unit.kilojoule_per_mole, unit.nanometer


def addSpecies(force, mesh):
    """Give a force three species in patches, with everything that acts between them."""
    force.addSpecies(20, 1.0, -15)
    force.addSpecies(8, -0.5, 6)
    force.addSpecies(30, 0)
    force.setLineTension(0, 1, 12)
    force.setLineTension(1, 2, 7)
    force.setPairEnergy(0, 1, 4)
    force.setPairEnergy(2, 2, -2)
    force.setVertexSpecies(np.digitize(mesh.vertices[:, 0] + 0.3 * mesh.vertices[:, 1], [0, 0.6]))
    force.setSpontaneousCurvature(0.2)
    return force


def createSpecies(mesh, terms=("area", "volume", "areaDifference", "tether", "repulsion", "tension", "pressure")):
    return addSpecies(createForce(mesh, terms), mesh)


def test_units_and_defaults():
    force = mh.HelfrichForce()
    assert force.getSpontaneousCurvature() == 0 / nm and force.getGaussianModulus() == 0 * kJ
    assert force.getNumSpecies() == 0 and force.getVertexSpecies().shape == (0,)
    force.setSpontaneousCurvature(2e7 / unit.meter)
    assert force.getSpontaneousCurvature() == 0.02 / nm
    force.setGaussianModulus(-10 * kJ)
    assert force.getGaussianModulus() == -10 * kJ
    assert force.getSpontaneousCurvatureParameter() == "HelfrichForceSpontaneousCurvature"
    assert force.addSpecies(20 * kJ, 0.1 / unit.angstrom, -5 * kJ) == 0
    assert force.addSpecies(bendingModulus=10, spontaneousCurvature=0) == 1
    assert force.getSpeciesParameters(0) == [20 * kJ, 1 / nm, -5 * kJ]
    assert force.getSpeciesParameters(1) == [10 * kJ, 0 / nm, 0 * kJ]
    force.setSpeciesParameters(1, 25, 0.5, 3)
    assert force.getSpeciesParameters(1) == [25 * kJ, 0.5 / nm, 3 * kJ] and force.getBendingModulus() == 25 * kJ
    assert force.getLineTension(0, 1) == 0 * kJ / nm and force.getPairEnergy(0, 0) == 0 * kJ
    force.setLineTension(0, 1, 4 * kJ / nm)
    force.setPairEnergy(1, 1, -3 * kJ)
    assert force.getLineTension(1, 0) == 4 * kJ / nm and force.getPairEnergy(1, 1) == -3 * kJ
    force.setVertexSpecies([1, 0, np.int64(1)])
    assert force.getVertexSpecies().tolist() == [1, 0, 1]
    assert "2 species" in repr(force)
    assert all(force.hasTerm(term) for term in ("bending", "gaussian", "line", "pair"))


def test_xml_keeps_everything():
    mesh = createBlob(1)
    for force in (createSpecies(mesh), createForce(mesh)):
        force.setName("outer")
        xml = mm.XmlSerializer.serialize(force)
        assert mm.XmlSerializer.serialize(mm.XmlSerializer.deserialize(xml)) == xml
        assert ('version="6"' in xml) == (force.getNumSpecies() > 0)
        again = copy.deepcopy(force)
        assert np.array_equal(again.getVertexSpecies(), force.getVertexSpecies())
        assert again.getNumSpecies() == force.getNumSpecies()
    force.setSpontaneousCurvature(0.3)
    assert 'version="6"' in mm.XmlSerializer.serialize(force)


def test_a_species_for_each_of_many_vertices():
    """Moduli that change one by one, in the force, a Context and XML: what took the square of their number would take
    minutes here.
    """
    mesh = mh.Mesh.icosphere(6, 100)
    numSpecies = len(mesh.vertices)
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    for i in range(numSpecies):
        force.addSpecies(20 - i / numSpecies, 0, -15 + i / numSpecies)
    force.setVertexSpecies(np.arange(numSpecies)[::-1])
    context = createContext(mesh, force, "CPU")
    for moduli in ((10, 0.01, -5), (5, 0.01, -6)):
        for i in range(numSpecies):
            force.setSpeciesParameters(i, *moduli)
        assert force.getBendingModulus() == moduli[0] * kJ and force.getGaussianModulus() == moduli[2] * kJ
        force.updateParametersInContext(context)
    plain = mh.HelfrichForce()
    plain.setTriangles(mesh.triangles)
    plain.setBendingModulus(5)
    plain.setSpontaneousCurvature(0.01)
    plain.setGaussianModulus(-6)
    assert energyOf(context) == pytest.approx(energyOf(createContext(mesh, plain, "CPU")), rel=1e-12)
    again = copy.deepcopy(force)
    assert again.getNumSpecies() == numSpecies
    assert again.getSpeciesParameters(numSpecies - 1) == force.getSpeciesParameters(numSpecies - 1)


@pytest.mark.parametrize("subdivisions", [2, 4])
def test_platforms_agree(subdivisions):
    mesh = createBlob(subdivisions)
    contexts = [createContext(mesh, createSpecies(mesh), platform) for platform in PLATFORMS]
    energies, forces = zip(*((energyOf(context), forcesOf(context)) for context in contexts))
    assert energies[1] == pytest.approx(energies[0], rel=1e-10)
    assert np.linalg.norm(forces[1] - forces[0]) < 1e-10 * np.linalg.norm(forces[0])


def test_flips_decide_alike_on_both_platforms():
    mesh = createBlob(3)
    ends = []
    for platform in PLATFORMS:
        flips = mh.EdgeFlipIntegrator(30000, 0.5)
        flips.setRandomNumberSeed(4)
        force = createSpecies(mesh)
        context = createContext(mesh, force, platform, flips)
        flips.step(3)
        ends.append(force.getTrianglesInContext(context))
        assert flips.getNumAccepted() > 100
    assert np.array_equal(*ends)


def createRun(precision="double", threads="1"):
    mesh = createBlob(3)
    integrator = mh.HybridMonteCarloIntegrator(30000, 0.00001, 10, 0.2, 0.5)
    integrator.setRandomNumberSeed(3)
    integrator.setForcePrecision(precision)
    system = mesh.createSystem()
    force = createSpecies(mesh)
    system.addForce(force)
    platform = mm.Platform.getPlatform("CPU")
    simulation = app.Simulation(mesh.topology(), system, integrator, platform, {"Threads": threads})
    simulation.context.setPositions(mesh.vertices)
    return simulation, force


@pytest.mark.parametrize("precision", ["double", "mixed"])
@pytest.mark.parametrize("kind", ["Checkpoint", "State"])
def test_continued_runs_are_the_same_to_the_last_bit(kind, precision, tmp_path):
    simulation, force = createRun(precision)
    species = force.getVertexSpecies()[::-1]
    force.setVertexSpeciesInContext(simulation.context, species)
    simulation.step(12)
    getattr(simulation, "save" + kind)(str(tmp_path / "saved"))
    simulation.step(12)
    again, forceAgain = createRun(precision, "2")
    getattr(again, "load" + kind)(str(tmp_path / "saved"))
    assert np.array_equal(forceAgain.getVertexSpeciesInContext(again.context), species)
    again.step(12)
    assert simulation.integrator.getNumAcceptedTrajectories() > 0
    assert np.array_equal(positionsOf(again.context), positionsOf(simulation.context))
    assert energyOf(again.context) == energyOf(simulation.context)
    assert np.array_equal(
        forceAgain.getTrianglesInContext(again.context), force.getTrianglesInContext(simulation.context)
    )
    again.context.reinitialize(preserveState=True)
    assert np.array_equal(forceAgain.getVertexSpeciesInContext(again.context), species)


def test_trajectories_are_the_same_beside_other_forces():
    # Alone the kernel makes the trajectory as a whole; another force makes it go step by step.
    mesh, ends = createBlob(3), []
    for others in ([], [mm.CustomExternalForce("0")]):
        integrator = mh.HamiltonianTrajectoryIntegrator(300, 0.00002, 20)
        integrator.setRandomNumberSeed(3)
        integrator.setTetherSubsteps(2)
        context = createContext(mesh, [createSpecies(mesh), *others], "CPU", integrator)
        integrator.step(3)
        ends.append(positionsOf(context))
        assert integrator.getNumAccepted() > 0
    assert np.array_equal(*ends)


@pytest.mark.parametrize("platform", PLATFORMS)
def test_a_sphere_of_two_halves(platform):
    # The equator is 2 pi long, has no geodesic curvature, and halves the Gaussian curvature; the halves bend apart.
    mesh = mh.Mesh.icosphere(4)
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    north = mesh.vertices @ [0.31, 0.17, 0.93] > 0
    force.addSpecies(20, 1.0, -7)
    force.addSpecies(10, 3.0, 5)
    force.setVertexSpecies(north.astype(int))
    force.setLineTension(0, 1, 6)
    context = createContext(mesh, force, platform)
    terms = termsOf(force, context)
    assert terms["bending"] == pytest.approx(4 * np.pi * (20 * 0.5**2 + 10 * 0.5**2), rel=0.02)
    assert terms["gaussian"] == pytest.approx(2 * np.pi * (5 - 7), abs=0.5)
    assert 0.99 < terms["line"] / (6 * 2 * np.pi) < 1.2
    context.setParameter(force.getSpontaneousCurvatureParameter(), -1)
    assert termsOf(force, context)["bending"] == pytest.approx(4 * np.pi * 20, rel=0.02)


@pytest.mark.parametrize("reduced", [-1.0, 0.7, 3.0])
def test_spheres_converge(reduced):
    # The energy is 8 pi kappa (1-C_0 R/2)^2, to the order of the edges' squared length.
    errors = []
    for subdivisions in (3, 4, 5, 6):
        mesh = mh.Mesh.icosphere(subdivisions, radius=30)
        force = mh.HelfrichForce()
        force.setTriangles(mesh.triangles)
        force.setBendingModulus(20)
        force.setSpontaneousCurvature(reduced / 30)
        energy = energyOf(createContext(mesh, force, "CPU"))
        errors.append(energy / (8 * np.pi * 20) - (1 - reduced / 2) ** 2)
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert abs(errors[0]) < 0.02 and np.all(orders > 1.8)


def test_a_state_without_species_is_refused():
    mesh = createBlob(1)
    states = []
    for create in (createForce, createSpecies):
        integrator = mh.EdgeFlipIntegrator(300, 0.1)
        context = createContext(mesh, create(mesh), "Reference", integrator)
        states.append((context, context.getState(positions=True, integratorParameters=True), integrator))
    with pytest.raises(mm.OpenMMException, match="a membrane without species, and HelfrichForce has 3"):
        states[1][0].setState(states[0][1])
    with pytest.raises(mm.OpenMMException, match="a membrane with species, and HelfrichForce has 0"):
        states[0][0].setState(states[1][1])


def test_bad_input():
    mesh = createBlob(1)
    force = createSpecies(mesh)
    context = createContext(mesh, force)
    cases = [
        (lambda: force.setVertexSpecies([0.5]), ValueError, "species must be an array of integers"),
        (lambda: force.setVertexSpecies([[0]]), ValueError, "species must be an array of integers of shape"),
        (lambda: force.setVertexSpecies([2**40]), ValueError, "1099511627776"),
        (lambda: force.setVertexSpecies([-1]), mm.OpenMMException, "vertex 0 is -1"),
        (lambda: force.addSpecies(1 * nm, 0), ValueError, "bendingModulus is 1 nm"),
        (lambda: force.addSpecies(1, 2 * nm), ValueError, "spontaneousCurvature is 2 nm; .* inverse length"),
        (lambda: force.setLineTension(0, 1, 1 * kJ), ValueError, "lineTension is 1 kJ/mol; .* energy per length"),
        (lambda: force.setPairEnergy(0, 9, 1), mm.OpenMMException, "no species 9; there are 3"),
        (lambda: force.setSpeciesParameters(3, 1, 0), mm.OpenMMException, "no species 3"),
        (lambda: force.setBendingModulus(3), mm.OpenMMException, "3 species"),
        (lambda: force.setVertexSpeciesInContext(context, [0, 1]), mm.OpenMMException, "2 species of vertices for 42"),
        (lambda: force.setVertexSpeciesInContext(context, [3] * 42), mm.OpenMMException, "vertex 0 is of species 3"),
    ]
    for call, error, words in cases:
        with pytest.raises(error, match=words):
            call()
    assert np.array_equal(force.getVertexSpeciesInContext(context), force.getVertexSpecies())
    uniform = createForce(mesh)
    other = createContext(mesh, uniform)
    uniform.addSpecies(1, 0)
    with pytest.raises(mm.OpenMMException, match="none when the Context was created"):
        uniform.updateParametersInContext(other)
