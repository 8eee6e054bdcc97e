"""Analysis of species: on meshes whose domains are known."""

import numpy as np
import pytest

import openmmhelfrich as mh
from membranes import createContext


def sphere(subdivisions=4, radius=2.0):
    return mh.Mesh.icosphere(subdivisions, radius)


def withCaps(mesh, height):
    """Give a sphere species 1 above a height and below minus twice that, which makes a large and a small cap."""
    z = mesh.vertices[:, 2]
    mesh.species = ((z > height) | (z < -2 * height)).astype(np.intc)
    return mesh


def testDomainsOfTwoCaps():
    mesh = withCaps(sphere(), 0.6)
    caps = mh.findDomains(mesh, 1)
    exact = [2 * np.pi * 2 * (2 - h) for h in (0.6, 1.2)]
    np.testing.assert_allclose(caps.areas, exact, rtol=0.05)
    assert caps.counts.sum() == np.count_nonzero(mesh.species) and len(caps.counts) == 2
    rims = [2 * np.pi * np.sqrt(4 - h**2) for h in (0.6, 1.2)]
    ratios = caps.boundaryLengths / rims
    assert np.all((ratios > 1) & (ratios < 1.25))  # boundaries follow the mesh in zigzag
    assert set(caps.labels[mesh.vertices[:, 2] > 0.6]) == {0} and set(caps.labels[mesh.species == 0]) == {-1}
    band = mh.findDomains(mesh, 0)
    assert len(band.areas) == 1 and band.areas.sum() + caps.areas.sum() == pytest.approx(mesh.area)
    assert band.boundaryLengths.sum() == pytest.approx(caps.boundaryLengths.sum())


@pytest.mark.parametrize("count", [2, 3, 5])
def testTheBoundaryIsWhatALineTensionActsOn(count):
    mesh = sphere(2)
    mesh.species = np.random.default_rng(count).integers(0, count, len(mesh.vertices)).astype(np.intc)
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    for _ in range(count):
        force.addSpecies(0, 0)
    for b in range(count):
        for a in range(b):
            force.setLineTension(a, b, 1)
    force.setVertexSpecies(mesh.species)
    context = createContext(mesh, force)
    energy = context.getState(energy=True).getPotentialEnergy()._value
    assert mh.boundaryLength(mesh) == pytest.approx(energy, rel=1e-12)


def testContactNumbersCountNeighbors():
    mesh = sphere(3)
    mesh.species = np.zeros(len(mesh.vertices), dtype=np.intc)
    assert mh.contactNumbers(mesh) == pytest.approx(2 * len(mesh.edges) / len(mesh.vertices))
    mesh.species[0] = 1  # a vertex of the icosahedron has five neighbors
    contacts = mh.contactNumbers(mesh)
    assert contacts[1].tolist() == [5, 0] and contacts[0, 1] == pytest.approx(5 / (len(mesh.vertices) - 1))


def testAProfileAlongAnAxis():
    mesh = withCaps(sphere(), 0.6)
    heights, parts = mh.compositionProfile(mesh, 1, bins=20)
    assert np.allclose(parts[heights > 0.8], 1, rtol=1e-12) and np.all(parts[(heights < 0.4) & (heights > -1.0)] == 0)
    _, across = mh.compositionProfile(mesh, 1, axis=(1, 0, 0), bins=4)
    assert np.all((across > 0) & (across < 1))


def testCurvatureWhereASpeciesIs():
    mesh = sphere(3)
    mesh = mh.Mesh(mesh.vertices * [1, 1, 2], mesh.triangles)  # a prolate, more curved at its poles
    mesh.species = (abs(mesh.vertices[:, 2]) > 3.6).astype(np.intc)
    excess, correlation = mh.speciesCurvature(mesh, 1)
    assert excess > 0.2 and 0.5 < correlation <= 1
    other, opposite = mh.speciesCurvature(mesh, 0)
    assert other < 0 and opposite == pytest.approx(-correlation)


def testTheSpectrumOfAHarmonic():
    mesh = sphere(5)
    x = mesh.vertices / 2
    mesh.species = (x[:, 2] > 0).astype(np.intc)  # a step: 1/2 + sum of odd l, c_1 = sqrt(3 pi)/2
    powers = mh.compositionSpectrum(mesh, 1, 4)
    assert powers[0] == pytest.approx(0, abs=1e-20)
    assert powers[1] * 3 == pytest.approx(3 * np.pi / 4, rel=0.02)
    assert powers[3] * 7 == pytest.approx(7 * np.pi / 64, rel=0.05)
    assert powers[2] < 1e-3 and powers[4] < 1e-3


def halved(mesh, names=()):
    mesh.speciesNames = names
    mesh.species = (mesh.vertices[:, 2] > 0).astype(int)
    return mesh


def testSpeciesGoByNames():
    mesh = halved(sphere(2), ("a", "b", "none"))
    assert np.array_equal(mh.findDomains(mesh, "b").labels, mh.findDomains(mesh, 1).labels)
    assert len(mh.findDomains(mesh, "none").areas) == 0 and mh.contactNumbers(mesh).shape == (3, 3)
    assert mh.speciesCurvature(mesh, "a") == mh.speciesCurvature(mesh, 0)


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda mesh: mh.findDomains(mesh), "the mesh has no species; give it some"),
        (lambda mesh: mh.findDomains(halved(mesh), 2), "the mesh has no species 2; it has 0 to 1, and more if"),
        (lambda mesh: mh.speciesCurvature(halved(mesh), -1), "the mesh has no species -1; it has 0 to 1"),
        (lambda mesh: mh.compositionProfile(halved(mesh), 4), "the mesh has no species 4"),
        (
            lambda mesh: mh.compositionSpectrum(halved(mesh), "lo"),
            "no species of the mesh is called 'lo'; they have no",
        ),
        (lambda mesh: mh.findDomains(halved(mesh, ("a", "b")), "lo"), "called 'lo'; they are called a, b"),
        (lambda mesh: mh.findDomains(halved(mesh, ("a", "b")), 2), r"the mesh has no species 2; it has 0 to 1$"),
        (lambda mesh: mh.compositionProfile(mesh, axis=(0, 0, 0)), "axis is"),
        (lambda mesh: mh.compositionProfile(mesh, bins=0), "bins is 0"),
        (lambda mesh: mh.compositionSpectrum(mesh, maxDegree=0), "maxDegree is 0"),
    ],
)
def testMistakes(ask, message):
    with pytest.raises(ValueError, match=message):
        ask(sphere(0))
