"""Edges that never flip."""

import numpy as np
import openmm as mm
import pytest

import openmmhelfrich as mh
from membranes import createBlob, createContext, createForce, kelvin
from test_serialization import throughXml


def equatorOf(mesh):
    """Return the ring of edges at the border of a hemisphere of the icosphere, as an array of pairs."""
    x = mh.Mesh.icosphere(2).vertices
    isNear = np.round(x @ x[0], 6) >= 0
    isBorder = np.zeros(len(x), dtype=bool)
    isBorder[mesh.edges[isNear[mesh.edges].sum(axis=1) == 1]] = True
    isBorder &= isNear
    return mesh.edges[isBorder[mesh.edges].all(axis=1)]


def edgesOf(triangles):
    return {tuple(sorted((t[c], t[(c + 1) % 3]))) for t in np.asarray(triangles).tolist() for c in range(3)}


def createFixed(mesh, edges, **options):
    force = createForce(mesh, **options)
    for edge in edges:
        force.addFixedEdge(*edge)
    return force


def testOneByOne():
    force = mh.HelfrichForce()
    assert force.getNumFixedEdges() == 0
    assert force.addFixedEdge(np.int64(0), np.int32(1)) == 0
    assert force.addFixedEdge(3, 2) == 1
    assert force.getFixedEdgeParameters(1) == [3, 2]
    force.setFixedEdgeParameters(1, 2, 5)
    assert force.getNumFixedEdges() == 2 and force.getFixedEdgeParameters(1) == [2, 5]
    for index in (-1, 2):
        with pytest.raises(
            mm.OpenMMException, match=f"getFixedEdgeParameters: there is no fixed edge {index}; there are 2"
        ):
            force.getFixedEdgeParameters(index)
        with pytest.raises(
            mm.OpenMMException, match=f"setFixedEdgeParameters: there is no fixed edge {index}; there are 2"
        ):
            force.setFixedEdgeParameters(index, 0, 1)
    with pytest.raises(TypeError):
        force.addFixedEdge(0.5, 1)


def testBadEdges():
    mesh = createBlob(1)
    a, b = mesh.edges[0].tolist()
    stranger = next(
        v for v in range(len(mesh.vertices)) if v != a and tuple(sorted((a, v))) not in edgesOf(mesh.triangles)
    )
    for edge in [(a, stranger), (a, a), (-1, b), (a, len(mesh.vertices))]:
        with pytest.raises(
            mm.OpenMMException, match=rf"fixed edge 0 \({edge[0]}-{edge[1]}\) is not an edge of the triangles"
        ):
            createContext(mesh, createFixed(mesh, [edge]))
    with pytest.raises(mm.OpenMMException, match=rf"fixed edge 1 \({b}-{a}\) appears twice"):
        createContext(mesh, createFixed(mesh, [(a, b), (b, a)]))


def testSerialization():
    force = createFixed(createBlob(1), [(3, 1), (0, 2)])
    copied = throughXml(force)
    assert [copied.getFixedEdgeParameters(i) for i in range(copied.getNumFixedEdges())] == [[3, 1], [0, 2]]
    old = mm.XmlSerializer.serialize(createForce(createBlob(1))).replace('version="4"', 'version="1"')
    old = "\n".join(line for line in old.splitlines() if "FixedEdges" not in line)
    assert mh.HelfrichForce.cast(mm.XmlSerializer.deserialize(old)).getNumFixedEdges() == 0


@pytest.mark.parametrize("driver", ["flips", "hybrid"])
def testRing(driver):
    """A ring of fixed edges is still there after a hot run that leaves little of the rest, also when triangles are set
    and after a restart.
    """
    mesh = createBlob(2)
    ring = equatorOf(mesh)
    assert len(ring) > 10 and set(np.bincount(ring.ravel())) <= {0, 2}
    terms = ["bending", "area", "volume"]

    def create():
        force = createFixed(mesh, ring.tolist(), terms=terms)
        hot = kelvin(1000) if driver == "flips" else kelvin(50)
        integrator = (
            mh.EdgeFlipIntegrator(hot, 1) if driver == "flips" else mh.HybridMonteCarloIntegrator(hot, 1e-4, 10, 1, 0.5)
        )
        integrator.setRandomNumberSeed(3)
        return force, createContext(mesh, force, "CPU", integrator, {"Threads": "2"}), integrator

    force, context, integrator = create()
    integrator.step(20)
    checkpoint, middle = context.createCheckpoint(), force.getTrianglesInContext(context)
    integrator.step(20)
    end = force.getTrianglesInContext(context)
    wanted = set(map(tuple, np.sort(ring).tolist()))
    assert wanted <= edgesOf(end) and len(edgesOf(end) & edgesOf(mesh.triangles) - wanted) < len(mesh.edges) / 2
    flips = integrator if driver == "flips" else integrator.getFlipIntegrator()
    assert flips.getNumForbidden() > 0.8 * flips.getNumAttempted() * len(ring) / len(mesh.edges)

    force, context, integrator = create()
    context.loadCheckpoint(checkpoint)
    assert np.array_equal(force.getTrianglesInContext(context), middle)
    integrator.step(20)
    assert np.array_equal(force.getTrianglesInContext(context), end)
    context.reinitialize(True)
    assert np.array_equal(force.getTrianglesInContext(context), end)


def testTrianglesWithoutAFixedEdge():
    mesh = createBlob(1)
    ring = [mesh.edges[5].tolist()]
    free, fixed = createForce(mesh), createFixed(mesh, ring)
    flips = mh.EdgeFlipIntegrator(kelvin(1e6), 5)
    flips.setRandomNumberSeed(2)
    other = createContext(mesh, free, integrator=flips)
    flips.step(1)
    triangles = free.getTrianglesInContext(other)
    assert tuple(ring[0]) not in edgesOf(triangles)
    context = createContext(mesh, fixed, integrator=mh.EdgeFlipIntegrator(300, 1))
    for replace in (
        lambda: fixed.setTrianglesInContext(context, triangles),
        lambda: context.loadCheckpoint(other.createCheckpoint()),
    ):
        with pytest.raises(
            mm.OpenMMException, match=rf"fixed edge 0 \({ring[0][0]}-{ring[0][1]}\) is not an edge of the triangles"
        ):
            replace()
        assert np.array_equal(fixed.getTrianglesInContext(context), mesh.triangles)
