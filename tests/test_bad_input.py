"""What the C++ classes refuse: each error names the item and what is allowed, and leaves everything as it was."""

import math

import numpy as np
import openmm as mm
import pytest
from openmm import unit

import openmmhelfrich as mh
from membranes import PLATFORMS, TERMS, createBlob, createContext, createForce, energyOf, termsOf

NAN, INF = math.nan, math.inf


def replaced(values, i, value):
    """Return a list with another value in one place."""
    return [*values[:i], value, *values[i + 1 :]]


def octahedron():
    vertices = np.concatenate((np.eye(3), -np.eye(3)))
    return mh.Mesh(vertices, [(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)])


SETTERS = [
    *[
        (f"set{name}Modulus", (value,), [f"set{name}Modulus: the modulus is", str(value), "finite and not negative"])
        for name in ("Bending", "Area", "Volume", "AreaDifference")
        for value in (-1, NAN, INF)
    ],
    *[
        (f"setTarget{name}", (value,), [f"setTarget{name}: the {item} is", "finite and not negative"])
        for name, item in (("Area", "area"), ("Volume", "volume"))
        for value in (-1, NAN, INF)
    ],
    *[
        ("setTargetAreaDifference", (value,), ["setTargetAreaDifference: the area difference is", "finite"])
        for value in (NAN, INF, -INF)
    ],
    *[
        ("setLeafletSeparation", (value,), ["setLeafletSeparation: the separation is", "finite and positive"])
        for value in (0, -1, NAN, INF)
    ],
    ("setTether", (-1, 1, 2, 2), ["setTether: the modulus is -1", "not negative"]),
    ("setTether", (NAN, 1, 2, 2), ["setTether: the modulus is nan", "finite"]),
    ("setTether", (1, -1, 2, 2), ["setTether: the minimum length is -1", "not negative"]),
    ("setTether", (1, NAN, 2, 2), ["setTether: the minimum length is nan", "finite"]),
    ("setTether", (1, 1, NAN, 2), ["setTether: the maximum length is nan", "finite"]),
    ("setTether", (1, 1, INF, 2), ["setTether: the maximum length is inf", "finite"]),
    ("setTether", (1, 2, 2, 2), ["setTether: the minimum length 2 must be less than the maximum length 2"]),
    ("setTether", (1, 3, 2, 2), ["setTether: the minimum length 3 must be less than the maximum length 2"]),
    *[("setTether", (1, 1, 2, value), [f"setTether: the exponent is {value}", "from 1 to 100"]) for value in (0, 101)],
    *[
        (name, (value,), [f"{name}: the length is", str(value), "finite and positive"])
        for name in ("setTetherLengthScale", "setRepulsionLengthScale")
        for value in (0, -1, NAN, INF)
    ],
    *[
        (f"set{name.capitalize()}", (value,), [f"set{name.capitalize()}: the {name} is", str(value), "finite"])
        for name in ("tension", "pressure")
        for value in (NAN, INF, -INF)
    ],
    ("setRepulsion", (-1, 1, 2, 1), ["setRepulsion: the modulus is -1", "not negative"]),
    ("setRepulsion", (NAN, 1, 2, 1), ["setRepulsion: the modulus is nan", "finite"]),
    ("setRepulsion", (1, 0, 2, 1), ["setRepulsion: the onset is 0", "positive"]),
    ("setRepulsion", (1, -1, 2, 1), ["setRepulsion: the onset is -1", "not negative"]),
    ("setRepulsion", (1, INF, 2, 1), ["setRepulsion: the onset is inf", "finite"]),
    *[
        ("setRepulsion", (1, 1, value, 1), [f"setRepulsion: the exponent is {value}", "from 1 to 100"])
        for value in (0, 101)
    ],
    ("setRepulsion", (1, 1, 2, 3), ["setRepulsion: the exclusion level is 3", "0, 1 or 2"]),
    ("setRepulsion", (1, 1, 2, -1), ["setRepulsion: the exclusion level is -1", "0, 1 or 2"]),
]


def assertSays(error, words):
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize(
    "setter, arguments, words", SETTERS, ids=[f"{setter}{arguments}" for setter, arguments, _ in SETTERS]
)
def test_parameters(setter, arguments, words):
    force = createForce(createBlob(1))
    before = mm.XmlSerializer.serialize(force)
    with pytest.raises(mm.OpenMMException) as error:
        getattr(force, setter)(*arguments)
    assertSays(error, words)
    assert mm.XmlSerializer.serialize(force) == before


@pytest.mark.parametrize("arguments", [("a", 1, 2, 2), (1, None, 2, 2), (1, 1, 2, 2.5), (1, 1, 2)])
def test_arguments_of_the_wrong_type(arguments):
    with pytest.raises((TypeError, ValueError, mm.OpenMMException)):
        mh.HelfrichForce().setTether(*arguments)


def edited(**triangles):
    """Return a way to replace triangles of a mesh: t3=(0, 1, 2), or None to leave one out."""

    def edit(old):
        new = {f"t{i}": triangle for i, triangle in enumerate(old.tolist())} | triangles
        return [triangle for triangle in new.values() if triangle is not None]

    return edit


TRIANGLES = [
    ("none", lambda old: [], ["no triangles", "addTriangle"]),
    ("out of range", edited(t3=(4, 0, 6)), ["triangle 3 (4, 0, 6)", "index 6", "0 to 5"]),
    ("negative", edited(t3=(4, 0, -1)), ["triangle 3", "index -1", "0 to 5"]),
    ("degenerate", edited(t2=(3, 4, 4)), ["triangle 2 (3, 4, 4)", "repeats a particle", "three different"]),
    ("repeated", edited(more=(3, 1, 5)), ["triangle 8 repeats triangle 5", "once"]),
    ("three at an edge", edited(more=(1, 0, 4)), ["edge 0-", "3 triangles", "exactly two"]),
    ("orientation", edited(t6=(3, 4, 5)), ["the same way", " 6", "counter-clockwise seen from outside"]),
    ("open", edited(t7=None), ["edge", "only", "must be closed"]),
    (
        "two fans",
        lambda old: [(0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0), (3, 4, 5)],
        ["edge", "only", "must be closed"],
    ),
]


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("name, edit, words", TRIANGLES, ids=[name for name, _, _ in TRIANGLES])
def test_triangles(platform, name, edit, words):
    """At the construction of a Context, and where the triangles of one are replaced."""
    mesh = octahedron()
    force = createForce(mesh, ["bending"])
    context = createContext(mesh, force, platform)
    energy, live = energyOf(context), force.getTrianglesInContext(context)
    with pytest.raises(mm.OpenMMException) as error:
        force.setTrianglesInContext(context, edit(mesh.triangles))
    assertSays(error, words)
    assert energyOf(context) == energy
    assert np.array_equal(force.getTrianglesInContext(context), live)
    force = createForce(mesh, ["bending"])
    force.setTriangles(edit(mesh.triangles))
    with pytest.raises(mm.OpenMMException) as error:
        createContext(mesh, force, platform)
    assertSays(error, ["HelfrichForce", *words])


def test_surfaces_that_touch_at_a_vertex():
    force = mh.HelfrichForce()
    force.setTriangles([(0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0), (4, 5, 6), (4, 3, 5), (5, 3, 6), (6, 3, 4)])
    system = mm.System()
    for _ in range(7):
        system.addParticle(1)
    system.addForce(force)
    with pytest.raises(mm.OpenMMException, match=r"particle 3.*more than one fan"):
        mm.Context(system, mm.VerletIntegrator(0.001), mm.Platform.getPlatform("Reference"))


def test_triangles_of_other_particles():
    mesh = octahedron()
    force = createForce(mesh, ["bending"])
    system = mesh.createSystem()
    system.addParticle(1)
    system.addForce(force)
    context = mm.Context(system, mm.VerletIntegrator(0.001), mm.Platform.getPlatform("Reference"))
    with pytest.raises(mm.OpenMMException, match="the same 6 particles"):
        force.setTrianglesInContext(context, mesh.triangles + 1)


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("term", ["area", "volume", "areaDifference"])
def test_targets(platform, term):
    mesh = createBlob(1)
    setter = "setTarget" + term[0].upper() + term[1:]
    force = createForce(mesh, [term])
    getattr(force, setter)(0)
    with pytest.raises(mm.OpenMMException) as error:
        createContext(mesh, force, platform)
    assertSays(error, [f"the {term} term is on", setter[3:] + " is 0", setter, "parameter of the Context"])
    force = createForce(mesh, [term])
    context = createContext(mesh, force, platform)
    energy, parameter = energyOf(context), force.getName() + setter[3:]
    good = context.getParameter(parameter)
    signed = term == "areaDifference"
    allowed = "a finite value other than zero" if signed else "a positive, finite value"
    for bad in (0, NAN, INF, *([] if signed else [-good])):
        context.setParameter(parameter, bad)
        with pytest.raises(mm.OpenMMException) as error:
            energyOf(context)
        assertSays(error, [f"the {term} term is on", allowed])
        context.setParameter(parameter, good)
        assert energyOf(context) == energy


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("term", ["tension", "pressure"])
def test_moduli_in_contexts(platform, term):
    mesh = createBlob(1)
    force = createForce(mesh, ["bending"])
    flips = mh.EdgeFlipIntegrator(300, 0.1)
    context = createContext(mesh, force, platform, flips)
    energy, parameter = energyOf(context), force.getName() + term.capitalize()
    for bad in (NAN, INF, -INF):
        context.setParameter(parameter, bad)
        for compute in (energyOf, lambda context: flips.step(1)):
            with pytest.raises(mm.OpenMMException) as error:
                compute(context)
            assertSays(error, [f"{parameter} is {bad}; set it to a finite value with set{term.capitalize()}()"])
        context.setParameter(parameter, 0)
        assert energyOf(context) == energy


@pytest.mark.parametrize("platform", PLATFORMS)
def test_inside_out(platform):
    mesh = createBlob(1)
    mesh.triangles = mesh.triangles[:, ::-1].copy()
    force = createForce(mesh, ["bending"])
    energyOf(createContext(mesh, force, platform))
    force = createForce(mesh, ["bending"])
    force.setVolumeModulus(1)
    force.setTargetVolume(1)
    context = createContext(mesh, force, platform)
    with pytest.raises(mm.OpenMMException, match=r"inside out.*counter-clockwise seen from outside"):
        energyOf(context)


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_flat_but_for_rounding(platform, size):
    """A surface of next to no volume for its area is flat at any size; a thin one is not."""
    sphere = mh.Mesh.icosphere(2)
    for thickness, isFlat in ((0.0, True), (1e-16, True), (1e-12, False), (1e-6, False)):
        mesh = mh.Mesh(size * sphere.vertices * [1, 1, thickness], sphere.triangles)
        force = mh.HelfrichForce()
        force.setTriangles(mesh.triangles)
        force.setPressure(1 / size**3)
        context = createContext(mesh, force, platform)
        if isFlat:
            with pytest.raises(mm.OpenMMException, match="inside out or flat"):
                energyOf(context)
        else:
            assert energyOf(context) < 0


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("terms", [[term] for term in TERMS] + [TERMS], ids=[*TERMS, "all"])
@pytest.mark.parametrize("bad", [NAN, INF, -INF, 1e200])
def test_positions(platform, terms, bad):
    """A coordinate that is no number or too large is an error; correct ones afterwards give what they gave before."""
    mesh = createBlob(1)
    context = createContext(mesh, createForce(mesh, terms), platform)
    energy = energyOf(context)
    x = mesh.vertices.copy()
    x[9, 2] = bad
    context.setPositions(x)
    if bad == 1e200 and platform == "Reference" and terms in (["bending"], ["repulsion"], ["tension"], ["pressure"]):
        # Their energies are numbers, and the squares on the way to them too, in extended precision.
        try:
            assert math.isfinite(energyOf(context))
        except mm.OpenMMException as error:
            assert "the energy is not finite" in str(error)
    else:
        with pytest.raises(
            mm.OpenMMException, match="particle 9|coordinate is NaN" if bad != 1e200 else "the energy is not finite"
        ):
            energyOf(context)
    context.setPositions(mesh.vertices)
    assert energyOf(context) == energy


@pytest.mark.parametrize("platform", PLATFORMS)
def test_collapsed_positions(platform):
    """Energies where vertices or triangles collapse are finite or an error that says so, never a number that is not
    one.
    """
    mesh = createBlob(1)
    context = createContext(mesh, createForce(mesh), platform)
    energy = energyOf(context)
    point = mesh.vertices.copy()
    point[:] = point[0]
    a, b = mesh.edges[0]
    edge = mesh.vertices.copy()
    edge[a] = edge[b]
    for x in (point, edge):
        context.setPositions(x)
        with pytest.raises(mm.OpenMMException, match=r"not finite|inside out or flat"):
            energyOf(context)
    context.setPositions(mesh.vertices)
    assert energyOf(context) == energy


@pytest.mark.parametrize("platform", PLATFORMS)
def test_flat_triangles_have_a_finite_energy(platform):
    """A triangle without area has no normal; it must not spoil the rest."""
    mesh = createBlob(1)
    a, b, c = mesh.triangles[0]
    mesh.vertices[c] = (mesh.vertices[a] + mesh.vertices[b]) / 2
    force = createForce(mesh, ["bending", "area", "areaDifference", "tether"])
    context = createContext(mesh, force, platform)
    assert math.isfinite(energyOf(context))
    forces = context.getState(forces=True).getForces(asNumpy=True)._value
    assert np.all(np.isfinite(forces))


def test_no_positions():
    mesh = createBlob(1)
    system = mesh.createSystem()
    force = createForce(mesh)
    system.addForce(force)
    flips = mh.EdgeFlipIntegrator(300, 1)
    context = mm.Context(system, flips, mm.Platform.getPlatform("Reference"))
    for call in (
        lambda: energyOf(context),
        lambda: termsOf(force, context),
        lambda: force.getGeometryInContext(context),
    ):
        with pytest.raises(mm.OpenMMException, match="positions have not been set"):
            call()


def test_flips_without_positions_change_nothing():
    mesh = createBlob(1)
    system = mesh.createSystem()
    force = createForce(mesh)
    system.addForce(force)
    flips = mh.EdgeFlipIntegrator(300, 1)
    context = mm.Context(system, flips, mm.Platform.getPlatform("Reference"))
    with pytest.raises(mm.OpenMMException, match="positions have not been set"):
        flips.step(1)
    assert np.array_equal(force.getTrianglesInContext(context), mesh.triangles)


@pytest.mark.parametrize("platform", PLATFORMS)
def test_flips_at_positions_that_are_not_finite(platform):
    mesh = createBlob(1)
    force = createForce(mesh)
    flips = mh.EdgeFlipIntegrator(300, 1)
    context = createContext(mesh, force, platform, flips)
    x = mesh.vertices.copy()
    x[9, 2] = NAN
    context.setPositions(x)
    with pytest.raises(mm.OpenMMException, match=r"particle 9|coordinate is NaN"):
        flips.step(1)
    assert np.array_equal(force.getTrianglesInContext(context), mesh.triangles)


def test_a_force_that_is_in_no_context():
    mesh = createBlob(1)
    context = createContext(mesh, createForce(mesh))
    other = createForce(mesh)
    for call in (
        other.getTrianglesInContext,
        other.getEnergyTermsInContext,
        other.getGeometryInContext,
        other.updateParametersInContext,
        lambda context: other.setTrianglesInContext(context, mesh.triangles),
    ):
        with pytest.raises(mm.OpenMMException, match=r"not found|not in|Context"):
            call(context)


@pytest.mark.parametrize("index", [-1, 8, 10**6])
def test_triangle_index(index):
    force = createForce(octahedron(), ["bending"])
    for call in (lambda: force.getTriangleParameters(index), lambda: force.setTriangleParameters(index, 0, 1, 2)):
        with pytest.raises(mm.OpenMMException, match=f"no triangle {index}; there are 8"):
            call()


INTEGRATORS = [
    *[
        (lambda value=value: mh.EdgeFlipIntegrator(value, 0.1), ["EdgeFlipIntegrator", "temperature"])
        for value in (-1, NAN, INF)
    ],
    *[
        (lambda value=value: mh.EdgeFlipIntegrator(300, value), ["EdgeFlipIntegrator", "fraction"])
        for value in (-1, NAN, INF)
    ],
    *[(lambda value=value: mh.HybridMonteCarloIntegrator(value, 0.1), ["temperature"]) for value in (0, -1, NAN, INF)],
    *[(lambda value=value: mh.HybridMonteCarloIntegrator(300, value), ["step size"]) for value in (0, -1, NAN, INF)],
    *[
        (lambda value=value: mh.HybridMonteCarloIntegrator(300, 0.1, value), ["number of steps per trajectory"])
        for value in (0, -1)
    ],
    *[(lambda value=value: mh.HybridMonteCarloIntegrator(300, 0.1, 10, value), ["fraction"]) for value in (-1, NAN)],
    *[
        (
            lambda value=value: mh.HybridMonteCarloIntegrator(300, 0.1, 10, 0.1, value),
            ["flip probability", "between 0 and 1"],
        )
        for value in (-0.1, 1.1, NAN)
    ],
    (lambda: mh.HybridMonteCarloIntegrator(300, 0.1, engine="fast"), ["engine is 'fast'", "'native' or 'custom'"]),
    *[(lambda value=value: mh.HamiltonianTrajectoryIntegrator(value, 0.1, 10), ["temperature"]) for value in (0, NAN)],
    *[(lambda value=value: mh.HamiltonianTrajectoryIntegrator(300, value, 10), ["step size"]) for value in (0, NAN)],
    (lambda: mh.HamiltonianTrajectoryIntegrator(300, 0.1, 0), ["number of steps per trajectory"]),
    *[(lambda value=value: mh.CustomTrajectoryIntegrator(value, 0.1), ["temperature"]) for value in (0, NAN)],
    *[(lambda value=value: mh.CustomTrajectoryIntegrator(300, value), ["step size"]) for value in (0, NAN)],
    (lambda: mh.CustomTrajectoryIntegrator(300, 0.1, 0), ["number of steps per trajectory"]),
    *[
        (
            lambda value=value: mh.HybridMonteCarloIntegrator(300, 0.1).setTrajectoryJitter(value),
            ["jitter", "from 0 to less than 1"],
        )
        for value in (-0.1, 1, NAN)
    ],
    *[
        (
            lambda value=value: mh.HybridMonteCarloIntegrator(300, 0.1).setMomentumRefreshment(value),
            ["refreshment of momenta", "from more than 0 to 1"],
        )
        for value in (0, 1.1, NAN)
    ],
    (lambda: mh.HybridMonteCarloIntegrator(300, 0.1).setTetherSubsteps(0), ["number of substeps"]),
    (
        lambda: mh.HybridMonteCarloIntegrator(300, 0.1).setSplitting("verlet"),
        ["splitting is 'verlet'", "'leapfrog', 'bcss2' or 'bcss3'"],
    ),
    (
        lambda: mh.HybridMonteCarloIntegrator(300, 0.1, engine="custom").setSplitting("bcss2"),
        ["must be a HamiltonianTrajectoryIntegrator"],
    ),
    (
        lambda: mh.HybridMonteCarloIntegrator(300, 0.1, engine="custom").setMomentumRefreshment(0.1),
        ["must be a HamiltonianTrajectoryIntegrator"],
    ),
    (
        lambda: mh.HybridMonteCarloIntegrator(300, 0.1, engine="custom").setTrajectoryJitter(0.1),
        ["must be a HamiltonianTrajectoryIntegrator"],
    ),
    *[
        (
            lambda i=i, value=value: mh.ShearWaveIntegrator(*replaced([300, 0.1, 1, 2, 10], i, value)),
            [words],
        )
        for i, words in enumerate(
            ("temperature", "amplitude in nm", "least wave number", "greatest wave number", "number of moves per step")
        )
        for value in ((0, NAN) if i < 4 else (0,))
    ],
    (lambda: mh.ShearWaveIntegrator(300, 0.1, 3, 2), ["least wave number is 3 and the greatest 2 1/nm"]),
    *[
        (
            lambda value=value: mh.HybridMonteCarloIntegrator(300, 0.1).addShearWaves(
                mh.ShearWaveIntegrator(300, 0.1, 1, 2), value
            ),
            ["probability of shear waves"],
        )
        for value in (-0.1, 1.1, NAN)
    ],
]


@pytest.mark.parametrize("create, words", INTEGRATORS, ids=range(len(INTEGRATORS)))
def test_integrators(create, words):
    with pytest.raises(mm.OpenMMException) as error:
        create()
    assertSays(error, words)


def test_integrator_setters():
    integrator = mh.HybridMonteCarloIntegrator(300, 0.1, 10, 0.2, 0.5)
    for call in (
        lambda: integrator.setTemperature(-1),
        lambda: integrator.setStepSize(NAN),
        lambda: integrator.setStepsPerTrajectory(0),
        lambda: integrator.setFlipFraction(-1),
        lambda: integrator.setFlipProbability(2),
    ):
        with pytest.raises(mm.OpenMMException):
            call()
    assert integrator.getTemperature() == 300 * unit.kelvin
    assert integrator.getStepSize() == 0.1 * unit.picosecond
    assert (integrator.getStepsPerTrajectory(), integrator.getFlipFraction(), integrator.getFlipProbability()) == (
        10,
        0.2,
        0.5,
    )


def test_an_integrator_without_a_context():
    for integrator in (
        mh.EdgeFlipIntegrator(300, 0.1),
        mh.HybridMonteCarloIntegrator(300, 0.1),
        mh.HamiltonianTrajectoryIntegrator(300, 0.1, 10),
        mh.CustomTrajectoryIntegrator(300, 0.1, 10),
        mh.ShearWaveIntegrator(300, 0.01, 1, 2),
    ):
        with pytest.raises(mm.OpenMMException, match="not bound to a context"):
            integrator.step(1)


def test_an_integrator_of_two_contexts():
    mesh = createBlob(1)
    for integrator in (
        mh.EdgeFlipIntegrator(300, 0.1),
        mh.HybridMonteCarloIntegrator(300, 0.1),
        mh.HamiltonianTrajectoryIntegrator(300, 0.1, 10),
        mh.CustomTrajectoryIntegrator(300, 0.1, 10),
        mh.ShearWaveIntegrator(300, 0.01, 1, 2),
    ):
        context = createContext(mesh, createForce(mesh), integrator=integrator)
        with pytest.raises(mm.OpenMMException, match="already bound to a context"):
            createContext(mesh, createForce(mesh), integrator=integrator)
        integrator.step(1)
        assert context.getStepCount() == 1
