"""Minima of vesicles with spontaneous curvature, beside what continuum theory says.

    python benchmarks/spontaneous_curvature.py neck [--vertices 2562]
    python benchmarks/spontaneous_curvature.py seifert [--vertices 2562] [--volumes 0.6 0.905]

`neck` minimizes two spheres that a neck joins, c_0 = 3 at v = 0.74578, where ideal ones have 0.0877 of 8 pi kappa.
`seifert` minimizes at the points that were digitized from Fig. 9 and 11 of Seifert, Berndl and Lipowsky, Phys. Rev. A
44, 1182 (1991), from several shapes each, and prints the lowest energy.
"""

import argparse
import math

import numpy as np
from scipy.ndimage import gaussian_filter1d

import openmmhelfrich as mh

SEIFERT = {
    2.4: [(0.600, 0.125), (0.650, 0.074), (0.695, 0.037), (0.753, 0.111), (0.823, 0.125), (0.905, 0.107)],
    3.0: [
        (0.501, 0.087),
        (0.559, 0.035),
        (0.603, 0.071),
        (0.661, 0.049),
        (0.706, 0.011),
        (0.707, 0.105),
        (0.793, 0.254),
        (0.893, 0.289),
    ],
}


def spheres(radii, neck=0.3):
    """Return the outline of spheres in a row, joined by round necks of about a radius."""
    points, z = [], 0.0
    for i, r in enumerate(radii):
        first = math.asin(min(neck / r, 1)) if i > 0 else 0.0
        last = math.pi - (math.asin(min(neck / r, 1)) if i < len(radii) - 1 else 0.0)
        angles = np.linspace(first, last, 400)
        z -= r * math.cos(first) if i > 0 else 0.0
        points.append(np.column_stack((r * np.sin(angles), z + r * np.cos(angles))))
        z += r * math.cos(last)
    outline = np.concatenate(points)
    way = np.append(0, np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=1) + 1e-9))
    even = np.linspace(0, way[-1], 2000)
    outline = np.column_stack([np.interp(even, way, x) for x in outline.T])
    mirrored = np.concatenate((outline * [-1, 1], outline[1:-1][::-1]))  # closed, so that the poles stay round
    width = 0.08 * len(mirrored) / (2 * way[-1])
    outline = np.column_stack([gaussian_filter1d(x, width, mode="wrap") for x in mirrored.T])[:2000] * [-1, 1]
    outline[0, 0] = outline[-1, 0] = 0
    return outline


def twoSpheres(reducedVolume):
    """Return the radii of two spheres of total area 4 pi with a reduced volume."""
    a = np.linspace(math.sqrt(0.5), 1, 100001)
    volumes = a**3 + (1 - a * a) ** 1.5
    i = int(np.argmin(abs(volumes - reducedVolume)))
    return a[i], math.sqrt(1 - a[i] ** 2)


def starts(reducedVolume, vertices):
    """Yield shapes to start from, by name."""
    yield "prolate", mh.spheroid(vertices, mh.spheroidAspectRatio(max(reducedVolume, 0.55), "prolate"))
    if reducedVolume > 0.65:
        yield "two spheres", mh.surfaceOfRevolution(spheres(twoSpheres(max(reducedVolume, 0.708))), vertices)
    if reducedVolume < 0.72:
        yield "three spheres", mh.surfaceOfRevolution(spheres([1 / math.sqrt(3)] * 3), vertices)


def minimum(mesh, c0, reducedVolume, rounds=3, bounds=(0.8, 1.35)):
    """Return the energy over 8 pi kappa of a minimum, its reduced volume, and why the search ended.

    Between rounds of minimization, a few cold Monte Carlo steps move it out of corners of the mesh.  The bounds are
    those of the tether, in mean edges.
    """
    mesh = mh.Mesh(mesh.vertices * math.sqrt(4 * math.pi / mesh.area), mesh.triangles)
    edge = float(mesh.edgeLengths.mean())
    scene = mh.Scene.of(
        {
            "membrane": {
                "bending_modulus": 20,
                "spontaneous_curvature": c0,
                "area_modulus": 2e7,
                "volume_modulus": 2e7,
                "target_area": 4 * math.pi,
                "reduced_volume": reducedVolume,
            },
            "tether": {"min_length": bounds[0] * edge, "max_length": bounds[1] * edge},
            "sampling": {"approach": "none", "seed": 1},
            "platform": {"threads": 1},
        },
        mesh,
    )
    force = scene.createForce()
    simulation = scene.createSimulation(force)
    result = mh.minimizeFluid(simulation, force, maxIterations=3000)
    for _ in range(rounds - 1):
        simulation.integrator.setTemperature(3)
        simulation.step(60)
        result = mh.minimizeFluid(simulation, force, maxIterations=3000)
    geometry = force.getGeometryInContext(simulation.context)
    v = 6 * math.sqrt(math.pi) * geometry.volume._value / geometry.area._value**1.5
    bending = result.energies["bending"]
    return float(getattr(bending, "_value", bending)) / (8 * math.pi * 20 * scene.kT), v, result.reason


def neck(options):
    c0 = 3.0
    product = (1 + math.sqrt(1 + c0 * c0)) / c0**2
    total, difference = math.sqrt(1 + 2 * product), math.sqrt(1 - 2 * product)
    radii = (total + difference) / 2, (total - difference) / 2
    mesh = mh.surfaceOfRevolution(spheres(radii), options.vertices)
    energy, v, reason = minimum(mesh, c0, sum(r**3 for r in radii))
    print(f"c_0 = 3, radii {radii[0]:.4f} and {radii[1]:.4f}: v {v:.5f}, energy {energy:.4f} (ideal 0.0877); {reason}")


def seifert(options):
    print("c_0   v      digitized  found   differs  from")
    for c0, points in SEIFERT.items():
        for v, expected in [point for point in points if point[0] in options.volumes]:
            found = [
                (minimum(mesh, c0, v, bounds=bounds)[0], name)
                for name, mesh in starts(v, options.vertices)
                for bounds in ((0.8, 1.35), (0.7, 1.45))
            ]
            energy, name = min(found)
            print(f"{c0:.1f}  {v:.3f}  {expected:.3f}      {energy:.4f}  {energy - expected:+.4f}  {name}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["neck", "seifert"])
    parser.add_argument("--vertices", type=int, default=2562)
    volumes = [v for points in SEIFERT.values() for v, _ in points]
    what = "of the points of seifert, by default all"
    parser.add_argument(
        "--volumes", type=float, nargs="+", choices=volumes, default=volumes, metavar="VOLUME", help=what
    )
    options = parser.parse_args()
    {"neck": neck, "seifert": seifert}[options.what](options)
