"""Budding of a domain: where bud and flat domain have the same energy, and where the flat one gives way.

    python benchmarks/budding.py caps [--plot budding.png]
    python benchmarks/budding.py outlines [--tensions 3.5 4]
    python benchmarks/budding.py minima [--angle 20]
    python benchmarks/budding.py fluid [--subdivisions 3] [--steps 4000] [--tensions 2.5 5 7.5 10 15]

A domain of area pi L^2 with a line tension lambda at its boundary has, as a cap of curvature C, the energy
2 pi kappa (LC)^2 + 2 pi L lambda sqrt(1 - (LC)^2/4) + pi kappabar (LC)^2.  The membrane around it is a catenoid, which
costs nothing.  So bud and flat domain have equal energies at lambda L = 4 kappa + 2 kappabar, and the flat one is
unstable from twice that on (R. Lipowsky, J. Phys. II France 2, 1825, 1992).

A cap keeps its curvature up to the boundary, where the catenoid has none.  A domain that is free takes the shape
J0(kr), whose curvature is 0 at the boundary, and which costs less: it gives way from lambda L = 2.405^2 kappa on.

Here a collar of the domain's own material surrounds it.  What closes the surface behind the collar costs nothing, or in
`minima` a fiftieth, so that the membrane is as good as endless.  `caps` takes the energies of shapes as they are built,
ring by ring, without any minimization: caps, and J0.  `minima` lets caps go, shallow ones or buds, at one lambda after
another.  Its connectivity stays, and every triangle of the domain keeps its area, so that the line cannot squeeze it.
`outlines` minimizes the energy of free domains of revolution, from their outlines alone, as a check of both.

`fluid` is a vesicle of two species on a mesh that flows: it minimizes with flips from a sphere with a cap, as it is,
and again after some steps at 300 K with exchanges of species.  There tensions are in kappa over the vesicle's radius.
"""

import argparse
import math
from itertools import pairwise

import numpy as np
import openmm as mm
from openmm import app
from scipy.optimize import minimize
from scipy.special import j0, jn_zeros

import openmmhelfrich as mh

DOMAIN, COLLAR, REST = range(3)
KAPPA = 50.0
ROW = math.sqrt(3) / 2  # from ring to ring, in edges of length 1
ANGLES = (10, 20, 40, 60, 90, 120, 150, 160, 170)
FIRST = jn_zeros(0, 1)[0]
TENSIONS = {"minima": (4, 5, 5.5, 6, 6.5, 7, 9), "fluid": (2.5, 5, 7.5, 10, 15)}


def cap(theta, L):
    """Return the radii and heights of a cap of area pi L^2 that opens to theta, from its pole to its boundary."""
    C = max(2 * math.sin(theta / 2) / L, 1e-6)
    s = np.linspace(0, theta / C if theta > 0 else L, 4001)
    return np.sin(C * s) / C, (np.cos(C * s) - 1) / C


def bump(slope, L):
    """Return those of J0, with a slope at its boundary, scaled to the area pi L^2."""
    r = np.linspace(0, 1, 4001)
    z = slope * j0(FIRST * r) / (FIRST * 0.5191)  # J1 there is 0.5191
    area = np.sum(math.pi * (r[1:] + r[:-1]) * np.hypot(np.diff(r), np.diff(z)))
    scale = L * math.sqrt(math.pi / area)
    return scale * r, scale * (z - z[0])


def rings(domain, width, radius):
    """Return the radius, height and species of each ring of a domain, of a collar of a width, and of the rest, which
    goes on to a radius, and ends in half a sphere.  Behind the domain the surface is a catenoid.
    """
    r, z = domain
    way = np.append(0, np.cumsum(np.hypot(np.diff(r), np.diff(z))))
    number = round(way[-1] / ROW)
    step = way[-1] / (number - 0.5)  # the boundary is in the middle of two rings
    found = [(np.interp(s, way, r), np.interp(s, way, z), DOMAIN) for s in step * np.arange(number)]
    a, angle = r[-1], math.atan2(z[-2] - z[-1], r[-1] - r[-2])
    b, t, s = max(a * math.sin(angle), 1e-9), a * math.cos(angle), step / 2
    while found[-1][2] != REST or found[-1][0] < radius:
        height = z[-1] + b * (math.asinh(t / b) - math.asinh((t + s) / b))
        found.append((math.hypot(b, t + s), height, COLLAR if s < width else REST))
        s += ROW
    last, height, _ = found[-1]
    n = round(math.pi / 2 * last / ROW)
    angles = math.pi / 2 * np.arange(1, n + 1) / n
    return found + [(last * math.cos(x), height - last * math.sin(x), REST) for x in angles]


def ringMesh(rings):
    """Return a closed mesh whose vertices are on rings, the first and the last of which are points, and its species."""
    counts = [1] + [max(5, round(2 * math.pi * r)) for r, _, _ in rings[1:-1]] + [1]
    vertices, triangles, first = [], [], 0
    for k, ((r, z, _), n) in enumerate(zip(rings, counts)):
        angles = 2 * math.pi * (np.arange(n) + 0.5 * (k % 2)) / n
        vertices.append(np.column_stack((r * np.cos(angles), r * np.sin(angles), np.full(n, z))) * [n > 1, n > 1, 1])
    for k, (m, n) in enumerate(pairwise(counts)):
        i = j = 0
        while (m > 1 and i < m) or (n > 1 and j < n):
            upper, lower = (i + 1 + 0.5 * (k % 2)) / m, (j + 1 + 0.5 * ((k + 1) % 2)) / n
            a, b = first + i % m, first + m + j % n
            if n == 1 or (m > 1 and i < m and (j == n or upper < lower)):
                triangles.append((a, b, first + (i + 1) % m))
                i += 1
            else:
                triangles.append((a, b, first + m + (j + 1) % n))
                j += 1
        first += m
    species = np.repeat([kind for _, _, kind in rings], counts)
    return mh.Mesh(np.concatenate(vertices), np.array(triangles)), species


def build(domain, L):
    return ringMesh(rings(domain, 0.4 * L, 1.2 * L))


def radiusOf(vertices):
    """Return L, in edges, of a flat domain of so many vertices."""
    return math.sqrt(vertices * ROW / math.pi)


def createForce(mesh, species, lineTension, kappabar=0.0, soft=0.0):
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    for factor, gaussian in ((1, kappabar), (1, 0), (soft, 0)):
        force.addSpecies(KAPPA * factor, 0, KAPPA * gaussian)
    force.setVertexSpecies(species)
    force.setLineTension(DOMAIN, COLLAR, lineTension)
    return force


def createContext(mesh, force, *others):
    system = mesh.createSystem()
    for one in (force, *others):
        system.addForce(one)
    platform = mm.Platform.getPlatformByName("CPU")
    simulation = app.Simulation(mesh.topology(), system, mm.VerletIntegrator(1e-4), platform, {"Threads": "1"})
    simulation.context.setPositions(mesh.vertices)
    return simulation


def energies(domain, L, kappabar):
    """Return the energy of bending and Gaussian curvature over kappa, and the length of the boundary over L."""
    mesh, species = build(domain, L)
    force = createForce(mesh, species, 1.0, kappabar)
    terms = force.getEnergyTermsInContext(createContext(mesh, force).context)
    kJ = {name: float(getattr(x, "_value", x)) for name, x in terms.items()}
    return (kJ["bending"] + kJ.get("gaussian", 0)) / KAPPA, kJ["line"] / L


def caps(options):
    print("vertices  kappabar/kappa  transition, lambda L/kappa  flat cap gives way")
    for vertices in (150, 300, 1200):
        L = radiusOf(vertices)
        for kappabar in (0.0, -0.5, 0.5):
            _, flat = energies(cap(0, L), L, kappabar)
            found = np.array([energies(cap(math.radians(angle), L), L, kappabar) for angle in ANGLES])
            y = np.sin(np.radians(ANGLES) / 2) ** 2
            complete = y @ found[:, 0] / (y @ y)  # of least squares, as the energy is proportional to y
            spinodal = found[1, 0] / (flat - found[1, 1])
            theory = 4 + 2 * kappabar
            print(f"{vertices:8}  {kappabar:14.1f}  {complete / flat:8.3f} (theory {theory:.0f}, "
                  f"{complete / flat / theory - 1:+.1%})  {spinodal:8.3f} (theory {2 * theory:.0f}, "
                  f"{spinodal / 2 / theory - 1:+.1%})", flush=True)  # fmt: skip
            if options.plot and vertices == 300 and not kappabar:
                plot(options.plot, y, found, flat)
        energy, boundary = energies(bump(0.35, L), L, 0.0)
        _, flat = energies(cap(0, L), L, 0.0)
        print(f"{vertices:8}  {0.0:14.1f}  J0 gives way at {energy / (flat - boundary):.3f} (theory {FIRST**2:.3f})")


def plot(path, y, found, flat):
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5, 3.5), layout="constrained")
    axes, grid = figure.subplots(), np.linspace(0, 1, 400)
    for k, tension in enumerate((2, 4, 6, 8, 10)):
        axes.plot(grid, grid + tension / 4 * np.sqrt(1 - grid), f"C{k}-", linewidth=1, label=f"λL/κ = {tension}")
        axes.plot([0, *y], [tension * flat / (8 * math.pi), *(found @ [1, tension] / (8 * math.pi))], f"C{k}o", ms=4)
    axes.set(xlabel="(LC/2)², 0 flat, 1 a complete bud", ylabel="energy / 8πκ", title="Caps, and theory (lines)")
    axes.legend(fontsize=8)
    figure.savefig(path, dpi=120)


def outlineEnergy(angles, tension):
    """Return the energy over kappa of a domain of revolution, from the angle of its outline at equal distances, and the
    radius of its boundary over L.  Its scale does not matter.
    """
    step, angles = 1 / len(angles), np.append(0, angles)
    middle = (angles[1:] + angles[:-1]) / 2
    r = np.append(0, np.cumsum(np.cos(middle)) * step)
    between = np.maximum((r[1:] + r[:-1]) / 2, 1e-4)
    bending = math.pi * np.sum((np.diff(angles) / step + np.sin(middle) / between) ** 2 * between) * step
    L = math.sqrt(2 * np.sum(between) * step)
    return bending + tension * 2 * math.pi * abs(r[-1]) / L + 1e6 * min(0, r.min()) ** 2, r[-1] / L


def outlines(options):
    print("from      lambda L/kappa  energy/kappa  radius of the boundary over L  flat domain")
    s = np.arange(1, 101) / 100
    for start, angle, tensions in (("bud", 150, (3.5, 3.75, 4.0, 4.25)), ("shallow", 10, (5.6, 5.7, 5.8, 5.9, 6.0))):
        for tension in options.tensions or tensions:
            found = minimize(lambda x: outlineEnergy(x, tension)[0], math.radians(angle) * s,  # noqa: B023
                             method="L-BFGS-B", options={"maxfun": 100000})  # fmt: skip
            radius = outlineEnergy(found.x, tension)[1]
            print(f"{start:8}  {tension:14.2f}  {found.fun:12.3f}  {radius:29.3f}  {2 * math.pi * tension:11.3f}",
                  flush=True)  # fmt: skip


def keepAreas(mesh, species):
    """Return a force that keeps the area of each triangle that has a vertex of the domain."""
    force = mm.CustomCompoundBondForce(
        3,
        "k*(A/A0-1)^2; A=sqrt(max(1e-9, 2*(a*b+b*c+c*a)-a^2-b^2-c^2))/4;"
        "a=distance(p1,p2)^2; b=distance(p2,p3)^2; c=distance(p3,p1)^2",
    )
    force.addPerBondParameter("A0")
    force.addGlobalParameter("k", 50 * KAPPA)
    for triangle, area in zip(mesh.triangles, mesh.triangleAreas):
        if np.any(species[triangle] == DOMAIN):
            force.addBond([int(vertex) for vertex in triangle], [float(area)])
    return force


def minima(options):
    L, angle = radiusOf(options.vertices), math.radians(options.angle)
    print(f"lambda L/kappa   boundary over 2 pi L ({math.cos(angle / 2):.3f} at first), every 150 iterations")
    for tension in options.tensions:
        mesh, species = build(cap(angle, L), L)
        force = createForce(mesh, species, tension * KAPPA / L, soft=0.02)
        force.setTether(1e3, 0.5, 1.9, 2)
        simulation = createContext(mesh, force, keepAreas(mesh, species))
        lengths, energy = [], 0.0
        for _ in range(6):
            mh.minimize(simulation, force, maxIterations=150)
            positions = simulation.context.getState(getPositions=True).getPositions(asNumpy=True)._value
            moved = mh.Mesh(positions, mesh.triangles)
            moved.species = species
            domain = mh.findDomains(moved, DOMAIN)
            lengths.append(domain.boundaryLengths[0] / (2 * math.sqrt(math.pi * domain.areas[0])))
            bending = (2 * moved.vertexMeanCurvatures**2 * moved.vertexAreas)[species != REST].sum()
            energy = bending + tension * domain.boundaryLengths[0] / L
        print(f"{tension:14.2f}  ", *(f"{length:.3f}" for length in lengths),
              f" energy/kappa {energy:.2f}, flat {2 * math.pi * tension:.2f}", flush=True)  # fmt: skip


def shapeOf(simulation, force):
    """Return the bending energy over 8 pi kappa and the line's over kappa of the membrane of a Simulation, the part of
    the area that its domain has, and the boundary over 2 pi L.
    """
    positions = simulation.context.getState(positions=True).getPositions(asNumpy=True)._value
    species = force.getVertexSpeciesInContext(simulation.context)
    mesh = mh.Mesh(positions, force.getTrianglesInContext(simulation.context), species=species)
    domains, terms = mh.findDomains(mesh, DOMAIN), force.getEnergyTermsInContext(simulation.context)
    kappa, area = force.getBendingModulus(), domains.areas.sum()
    bending, line = terms["bending"] / kappa, terms["line"] / kappa
    return (
        bending / (8 * math.pi),
        line,
        area / mesh.area,
        domains.boundaryLengths.sum() / math.sqrt(4 * math.pi * area),
    )


def fluid(options):
    print("tension R/kappa  after                    bending/8 pi kappa  line/kappa  sum/kappa  area  boundary/2 pi L")
    for tension in options.tensions:
        kappa, species = 20.0, [{"name": "domain", "fraction": 0.2, "region": "cap"}, {"name": "rest"}]
        membrane = {"bending_modulus": kappa, "line_tension": tension * kappa, "reduced_volume": 0.84}
        sampling = {"seed": 1, "approach": "none", "exchange_probability": 0.05}
        config = {"membrane": membrane, "sampling": sampling, "species": species, "platform": {"threads": 1}}
        scene = mh.Scene.of(config, mh.Mesh.icosphere(options.subdivisions))
        force = scene.createForce()
        simulation = scene.createSimulation(force)
        for steps in (0, options.steps):
            simulation.step(steps)
            result = mh.minimizeFluid(simulation, force, maxIterations=50000)
            bending, line, area, boundary = shapeOf(simulation, force)
            after = f"{steps:5} steps, {'' if result.converged else 'not '}converged"
            print(f"{tension:15.1f}  {after:24}  {bending:16.3f}  {line:10.2f}  {8 * math.pi * bending + line:9.2f}  "
                  f"{area:4.3f}  {boundary:8.3f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["caps", "outlines", "minima", "fluid"])
    parser.add_argument("--vertices", type=int, default=150, help="of the domain")
    parser.add_argument("--tensions", type=float, nargs="+", default=None, help="lambda L/kappa, or R/kappa")
    parser.add_argument("--subdivisions", type=int, default=3, help="of the vesicle")
    parser.add_argument("--steps", type=int, default=4000, help="of Monte Carlo between minimizations of the vesicle")
    parser.add_argument("--angle", type=float, default=20, help="to which the caps open, in degrees")
    parser.add_argument("--plot")
    options = parser.parse_args()
    options.tensions = options.tensions or TENSIONS.get(options.what)
    {"caps": caps, "outlines": outlines, "minima": minima, "fluid": fluid}[options.what](options)
