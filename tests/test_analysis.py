"""Analysis: known answers for shapes, spectra, correlated series and diffusion."""

import math

import mdtraj
import numpy as np
import pytest
from openmm import unit

import openmmhelfrich as mh
from membranes import createContext, energyOf, kelvin, positionsOf
from openmmhelfrich import analysis
from openmmhelfrich.analysis import fluctuations
from openmmhelfrich.geometry.shapes import invaginatedSphere

pytest.importorskip("emcee")


def cassini(b):
    """An oval of Cassini, with foci at +-1: a dumbbell with a neck of radius sqrt(b^2-1)."""
    z = math.sqrt(1 + b * b) * np.cos(np.linspace(0, np.pi, 5001))
    r = np.sqrt(np.maximum(np.sqrt(4 * z * z + b**4) - z * z - 1, 0))
    r[[0, -1]] = 0
    return np.column_stack((r, z))


SHAPES = {
    "sphere": lambda n: mh.spheroid(n, 1.0),
    "prolate": lambda n: mh.spheroid(n, 2.0),
    "oblate": lambda n: mh.spheroid(n, 0.4),
    "stomatocyte": lambda n: mh.surfaceOfRevolution(invaginatedSphere(inner=0.75, opening=0.5), n),
    "budded": lambda n: mh.surfaceOfRevolution(cassini(1.02), n),
}


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("noise", [0, 0.1])
def test_classes(name, noise):
    """Whatever the direction, place, size and noise."""
    mesh, random = SHAPES[name](642), np.random.default_rng(1)
    mesh.check()
    mesh.vertices += noise * mesh.edgeLengths.mean() * random.normal(size=mesh.vertices.shape)
    rotation, _ = np.linalg.qr(random.normal(size=(3, 3)))
    mesh.vertices = 30 * mesh.vertices @ (rotation * np.linalg.det(rotation)) + [100, -50, 7]
    assert analysis.classifyShape(mesh) == name


def test_a_peanut_is_not_budded():
    assert analysis.classifyShape(mh.surfaceOfRevolution(cassini(1.3), 642)) == "prolate"


def test_sphere():
    mesh = mh.Mesh.icosphere(4, radius=2)
    shape = analysis.describeShape(mesh)
    assert shape.reducedVolume == pytest.approx(1, abs=2e-3) and shape.reducedAreaDifference == pytest.approx(
        1, abs=2e-3
    )
    assert shape.radiusOfGyration == pytest.approx(2, rel=2e-3)
    assert np.allclose(shape.gyrationTensor, 4 / 3 * np.eye(3), atol=0.01)
    assert abs(shape.asphericity) < 1e-10 and abs(shape.relativeShapeAnisotropy) < 1e-10


@pytest.mark.parametrize("aspectRatio", [0.5, 3])
def test_gyration_tensor_of_a_spheroid(aspectRatio):
    u = np.linspace(0, np.pi, 20001)
    r, z = np.sin(u), aspectRatio * np.cos(u)
    area = np.hypot(np.cos(u), aspectRatio * np.sin(u)) * r
    axial, radial = (np.trapezoid(area * f, u) / np.trapezoid(area, u) for f in (z * z, r * r / 2))
    mesh = mh.spheroid(2562, aspectRatio)
    mesh.vertices *= aspectRatio / mesh.vertices[:, 2].max()
    tensor = analysis.gyrationTensor(mesh)
    assert np.allclose(tensor, np.diag([radial, radial, axial]), atol=0.01 * np.trace(tensor))
    shape = analysis.describeShape(mesh)
    if aspectRatio > 1:
        assert shape.asphericity == pytest.approx(axial - radial, rel=0.02)
    assert shape.relativeShapeAnisotropy == pytest.approx(((axial - radial) / (axial + 2 * radial)) ** 2, rel=0.05)


def test_area_difference_of_a_cylinder_with_caps():
    """M = 2 pi (2R) from the caps and pi L from the side."""
    s = np.linspace(0, np.pi / 2, 500)
    outline = np.concatenate(
        (
            np.column_stack((np.sin(s), 3 + np.cos(s))),
            np.column_stack((np.ones(1000), np.linspace(3, -3, 1002)[1:-1])),
            np.column_stack((np.cos(s), -3 - np.sin(s))),
        )
    )
    outline[-1, 0] = 0
    mesh = mh.surfaceOfRevolution(outline, 2562)
    assert analysis.reducedAreaDifference(mesh) == pytest.approx(
        (4 * np.pi + 6 * np.pi) / (4 * np.pi * math.sqrt((4 * np.pi + 12 * np.pi) / (4 * np.pi))), rel=5e-3
    )


@pytest.mark.parametrize("l, m", [(2, 0), (2, -2), (3, 1), (5, 4)])
def test_an_imposed_harmonic(l, m):
    mesh = mh.Mesh.icosphere(3)
    harmonics = fluctuations.realHarmonics(mesh.vertices, 6)
    assert np.allclose(harmonics.T @ harmonics * 4 * np.pi / len(harmonics), np.eye(49), atol=0.05)
    x = mesh.vertices * (1 + 0.02 * harmonics[:, [l * l + l + m]])
    u = analysis.sphericalHarmonicCoefficients(7 * x + [1, 2, 3], 6)
    expected = np.zeros(49)
    expected[l * l + l + m] = 0.02
    assert np.allclose(u[1:], expected[1:], atol=2e-4)


@pytest.mark.parametrize("seed", [3, 4])
def test_spectrum_of_known_fluctuations(seed):
    """Amplitudes drawn from theory, up to degrees that are not fitted, on vertices out of order: what comes out are the
    amplitudes that were drawn, and their modulus and tension.
    """
    random, mesh, kappa, sigma = np.random.default_rng(seed), mh.Mesh.icosphere(2), 20.0, 5.0
    l = np.array([l for l in range(10) for _ in range(2 * l + 1)])
    width = np.sqrt(1 / (kappa * np.maximum((l - 1) * (l + 2) * (l * (l + 1) + sigma), 1))) * (l >= 2)
    amplitudes = width * random.normal(size=(300, len(l)))
    frames = []
    for u in amplitudes:
        x = mesh.vertices + 0.15 * mesh.edgeLengths.mean() * random.normal(size=mesh.vertices.shape)
        x /= np.linalg.norm(x, axis=1)[:, np.newaxis]
        frames.append(7 * x * (1 + fluctuations.realHarmonics(x, 9) @ u)[:, np.newaxis])
    spectrum = analysis.fluctuationSpectrum(frames, 6)
    drawn = [np.mean(amplitudes[:, l == degree] ** 2) for degree in spectrum.degrees]
    assert spectrum.radius == pytest.approx(7, rel=2e-3) and spectrum.powers == pytest.approx(drawn, rel=0.03)
    theory = 1 / (
        kappa * (spectrum.degrees - 1) * (spectrum.degrees + 2) * (spectrum.degrees * (spectrum.degrees + 1) + sigma)
    )
    assert np.all(np.abs(spectrum.powers - theory) < 3 * spectrum.errors + 0.01 * theory) and np.all(
        spectrum.errors < 0.1 * theory
    )
    fit = spectrum.fit()
    assert abs(fit.bendingModulus - kappa) < 3 * fit.bendingModulusError and fit.bendingModulusError < 0.1 * kappa
    assert abs(fit.tension - sigma) < 3 * fit.tensionError and fit.tensionError < 3
    assert list(spectrum.toDataFrame()["degree"]) == [2, 3, 4, 5, 6]


@pytest.mark.parametrize("subdivisions, deviation", [(2, 0.03), (3, 0.008)])
def test_stiffness_of_a_mesh(subdivisions, deviation):
    """Undulations of an icosphere cost kappa/2 (l-1)(l+2)l(l+1) u^2 times meshStiffness()."""
    mesh = mh.Mesh.icosphere(subdivisions)
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(1)
    context = createContext(mesh, force, "CPU")
    harmonics = fluctuations.realHarmonics(mesh.vertices, 8)

    def energy(l, m, u):
        context.setPositions(mesh.vertices * (1 + u * harmonics[:, [l * l + l + m]]))
        return energyOf(context)

    degrees = np.arange(2, 9)
    stiffness = [
        np.mean([energy(l, m, 0.02 / l) + energy(l, m, -0.02 / l) - 2 * energy(l, m, 0) for m in range(-l, l + 1)])
        / ((0.02 / l) ** 2 * (l - 1) * (l + 2) * l * (l + 1))
        for l in degrees
    ]
    assert analysis.meshStiffness(degrees, mesh.edgeLengths.mean()) == pytest.approx(stiffness, rel=deviation)
    assert analysis.meshStiffness(degrees, 0) == pytest.approx(np.ones(7), abs=1e-6)


def test_modulus_of_a_simulated_membrane():
    """The bending modulus that a fluid membrane was given comes out of its fluctuations, within 10% and within the
    errors.
    """
    kT, kappa, mesh = 2.5, 50, mh.Mesh.icosphere(2)
    edge = mesh.edgeLengths.mean()
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(kappa * kT)
    force.setVolumeModulus(1e5 * kT)
    force.setTargetVolume(mesh.volume)
    force.setAreaModulus(3e4 * kT)
    force.setTargetArea(mesh.area)
    force.setTether(1000 * kT, 0.8 * edge, 1.35 * edge, 2)
    integrator = mh.HybridMonteCarloIntegrator(kelvin(kT), 6e-4, 300, 0.5, 0.3)
    integrator.setRandomNumberSeed(1)
    context = createContext(mesh, force, "CPU", integrator)
    integrator.step(200)
    frames = []
    for _ in range(1000):
        integrator.step(1)
        frames.append(positionsOf(context))
    edges = mh.Mesh(frames[-1], force.getTrianglesInContext(context)).edgeLengths
    fit = analysis.fluctuationSpectrum(frames, 5).fit(edgeLength=edges.mean())
    assert fit.bendingModulusError < 0.05 * kappa
    assert abs(fit.bendingModulus - kappa) < min(0.1 * kappa, 3 * fit.bendingModulusError)


@pytest.mark.parametrize("memory", [0, 0.5, 0.9])
def test_autocorrelation_time(memory):
    """x_n = a x_(n-1) + noise has the time (1+a)/(1-a)."""
    random, x = np.random.default_rng(4), np.zeros(100000)
    noise = random.normal(size=len(x))
    for n in range(1, len(x)):
        x[n] = memory * x[n - 1] + noise[n]
    expected = (1 + memory) / (1 - memory)
    assert analysis.autocorrelationTime(x) == pytest.approx(expected, rel=0.1)
    mean, error = analysis.meanAndError(x)
    assert abs(mean) < 3 * error and error == pytest.approx(x.std() * math.sqrt(expected / len(x)), rel=0.05)
    assert analysis.autocorrelationTime(np.ones(10)) == 1


def test_diffusion():
    """Steps along the surface, of mean square d, add up to n d, whatever the vesicle as a whole does."""
    random, mesh = np.random.default_rng(5), mh.Mesh.icosphere(3)
    x, frames = mesh.vertices.copy(), []
    for _ in range(40):
        frames.append(x @ np.linalg.qr(random.normal(size=(3, 3)))[0] + random.normal(size=3))
        if np.linalg.det(np.linalg.lstsq(x, frames[-1] - frames[-1].mean(axis=0), rcond=None)[0]) < 0:
            frames[-1] = -frames[-1]
        x = x + 1e-3 * random.normal(size=x.shape)
        x /= np.linalg.norm(x, axis=1)[:, np.newaxis]
    diffusion = analysis.vertexDiffusion(frames, mesh.triangles, 10)
    assert np.allclose(diffusion.meanSquaredDisplacements, 2e-6 * diffusion.lags, rtol=0.03)
    assert list(diffusion.toDataFrame()["lag"]) == list(range(1, 11))


def test_frames_of_a_dcd_file(tmp_path):
    mesh = mh.spheroid(162, 1.5)
    file = str(tmp_path / "frames.dcd")
    with mdtraj.formats.DCDTrajectoryFile(file, "w") as dcd:
        for scale in (1, 2, 3):
            dcd.write(10 * scale * mesh.vertices)
    topology = mdtraj.Topology.from_openmm(mesh.topology())
    frames = mdtraj.load_dcd(file, top=topology).xyz
    shapes = analysis.describeTrajectory(frames, mesh.triangles)
    assert [shape.area / mesh.area for shape in shapes] == pytest.approx([1, 4, 9], rel=1e-5)
    assert {shape.shapeClass for shape in shapes} == {"prolate"}
    assert list(analysis.toDataFrame(shapes)["shapeClass"]) == ["prolate"] * 3
    assert np.allclose(
        analysis.fluctuationSpectrum(frames, 3).series,
        analysis.fluctuationSpectrum(mesh.vertices[np.newaxis], 3).series,
        rtol=1e-4,
    )


def test_frames_may_have_units_each_by_itself():
    x = mh.Mesh.icosphere(2).vertices
    frames = [unit.Quantity(10 * scale * x, unit.angstrom) for scale in (1, 2)]
    assert analysis.fluctuationSpectrum(frames, 3).radius == pytest.approx(1.5, rel=1e-3)


@pytest.mark.parametrize(
    "call, problem",
    [
        (lambda: analysis.fluctuationSpectrum(np.zeros((3, 3))), r"shape \(3, 3\); it must be \(n, N, 3\)"),
        (
            lambda: analysis.fluctuationSpectrum(np.full((2, 9, 3), np.nan)),
            "frame 0 has a coordinate that is not finite",
        ),
        (lambda: analysis.fluctuationSpectrum(np.ones((2, 9, 3)), 2), "coefficients must be fewer than the 9 vertices"),
        (
            lambda: analysis.fluctuationSpectrum([mh.Mesh.icosphere(1)] * 2),  # type: ignore[arg-type]
            r"the frames are a list of Mesh; .*np.array\(\[frame.mesh.vertices for frame in trajectory\]\)",
        ),
        (
            lambda: mh.heightSpectrum([mh.MeshFrame(0, mh.Mesh.icosphere(1), {})], [9, 9, 8]),  # type: ignore[arg-type]
            r"the frames are a list of MeshFrame; .* an array of shape \(n, N, 3\)",
        ),
        (
            lambda: analysis.heightSpectrum([np.ones((9, 3)), np.ones((8, 3))], [9, 9, 8]),
            "the frames are of 8 to 9 points",
        ),
        (
            lambda: analysis.fluctuationSpectrum(mh.Mesh.icosphere(2).vertices[np.newaxis], 4).fit(),
            "errors above 0, which take two frames or more",
        ),
        (lambda: analysis.meshStiffness([2, 9], 0.5), "radius is 0.5; it must be from 0 to 0.405"),
        (lambda: analysis.meshStiffness([2], -1), "is -1; it must be from 0 to 1.9"),
        (lambda: analysis.meshStiffness([2], math.nan), "is nan"),
        (lambda: analysis.autocorrelationTime([1.0]), "two or more finite numbers"),
        (lambda: analysis.autocorrelationTime([1, math.nan]), "finite"),
        (
            lambda: analysis.vertexDiffusion(np.ones((4, 9, 3)), np.zeros((1, 3), int), 4),
            "maxLag is 4; it must be a whole number from 1 to 3",
        ),
    ],
)
def test_what_is_refused(call, problem):
    with pytest.raises(ValueError, match=problem):
        call()
