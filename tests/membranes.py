"""Membranes, forces and contexts for tests."""

import numpy as np
import openmm as mm
from openmm import unit

import openmmhelfrich as mh

PLATFORMS = ["Reference", "CPU"]
TERMS = ["bending", "area", "volume", "areaDifference", "tether", "repulsion", "tension", "pressure"]
TERMS_OF_SPECIES = ["gaussian", "line", "pair"]


def createBlob(subdivisions=2, noise=0.1, seed=1):
    """Return a rough, flat ellipsoid away from the origin, whose two faces are close enough to repel each other."""
    mesh = mh.Mesh.icosphere(subdivisions)
    random = np.random.default_rng(seed)
    edge = mesh.edgeLengths.mean()
    mesh.vertices = (
        mesh.vertices * [1, 0.9, 0.4]
        + random.uniform(-noise * edge, noise * edge, mesh.vertices.shape)
        + [0.3, -0.2, 0.5]
    )
    return mesh


def createForce(mesh, terms=TERMS, exclusionLevel=1):
    """Return a force on a mesh with some terms, each far from its minimum, in an energy landscape of some hundred
    kJ/mol.
    """
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    edge = mesh.edgeLengths.mean()
    if "bending" in terms:
        force.setBendingModulus(20)
    if "area" in terms:
        force.setAreaModulus(3000)
        force.setTargetArea(1.2 * mesh.area)
    if "volume" in terms:
        force.setVolumeModulus(2000)
        force.setTargetVolume(1.3 * mesh.volume)
    if "areaDifference" in terms:
        force.setAreaDifferenceModulus(1500)
        force.setLeafletSeparation(0.1)
        force.setTargetAreaDifference(0.17 * mesh.vertexMeanCurvatures.sum())
    if "tether" in terms:
        force.setTether(7, 0.9 * edge, 1.1 * edge, 3)
    if "repulsion" in terms:
        force.setRepulsion(0.5, 2.6 * edge, 2, exclusionLevel)
    if "tension" in terms:
        force.setTension(30)
    if "pressure" in terms:
        force.setPressure(-40)
    return force


def createContext(mesh, force, platform="Reference", integrator=None, properties=None, mass=1.0):
    """Return a Context of a mesh's System, with a force or several, at the mesh's positions."""
    system = mesh.createSystem(mass)
    for f in force if isinstance(force, list) else [force]:
        system.addForce(f)
    context = mm.Context(
        system, integrator or mm.VerletIntegrator(0.001), mm.Platform.getPlatform(platform), properties or {}
    )
    context.setPositions(mesh.vertices)
    return context


def energyOf(context, groups=-1):
    return context.getState(energy=True, groups=groups).getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole)


def forcesOf(context, groups=-1):
    return (
        context.getState(forces=True, groups=groups)
        .getForces(asNumpy=True)
        .value_in_unit(unit.kilojoule_per_mole / unit.nanometer)
    )


def positionsOf(context):
    return context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)


def termsOf(force, context):
    return {
        term: energy.value_in_unit(unit.kilojoule_per_mole)
        for term, energy in force.getEnergyTermsInContext(context).items()
    }


def kelvin(kT):
    """Return the temperature at which kT is so many kJ/mol."""
    return kT / unit.MOLAR_GAS_CONSTANT_R.value_in_unit(unit.kilojoule_per_mole / unit.kelvin)


def flipped(mesh, count, seed):
    """Return a mesh with other positions and some edges flipped."""
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    system = mesh.createSystem()
    system.addForce(force)
    integrator = mh.EdgeFlipIntegrator(300, 0.1)
    integrator.setRandomNumberSeed(seed)
    context = mm.Context(system, integrator, mm.Platform.getPlatform("Reference"))
    context.setPositions(mesh.vertices)
    integrator.step(count)
    return mh.Mesh(
        mesh.vertices * (1 + 0.01 * np.random.default_rng(seed).random((len(mesh.vertices), 1))),
        force.getTrianglesInContext(context),
    )


def uvSphere(segments, rings):
    """Return a sphere of radius 1 by degrees of longitude and latitude, as programs for drawing make it."""
    polar, around = np.pi * np.arange(1, rings) / rings, 2 * np.pi * np.arange(segments) / segments
    theta, phi = (grid.ravel() for grid in np.meshgrid(polar, around, indexing="ij"))
    body = np.column_stack((np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)))
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(rings - 2), np.arange(segments), indexing="ij"))
    a, b = i * segments + j, i * segments + (j + 1) % segments
    north, south, first, last = len(body), len(body) + 1, np.arange(segments), (rings - 2) * segments
    beside = (first + 1) % segments
    triangles = np.concatenate(
        (
            np.column_stack((a, a + segments, b)),
            np.column_stack((b, a + segments, b + segments)),
            np.column_stack((np.full(segments, north), first, beside)),
            np.column_stack((np.full(segments, south), last + beside, last + first)),
        )
    )
    return mh.Mesh(np.concatenate((body, [[0, 0, 1], [0, 0, -1]])), triangles)


def cube(side=1.0, corner=(0, 0, 0)):
    """Return a cube of twelve triangles."""
    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    faces = ["013", "032", "467", "475", "045", "051", "237", "276", "026", "064", "157", "173"]
    return mh.Mesh(np.multiply(side, corners) + corner, [[int(c) for c in face] for face in faces])
