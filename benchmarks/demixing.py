"""Where two species on a sphere demix: Binder cumulants at three sizes.

    python benchmarks/demixing.py frozen [--plot demixing.png]
    python benchmarks/demixing.py fluid --J 0.535 [--plot demixing.png]

An edge between unlike vertices costs J, and mutations at equal chemical potentials change one vertex at a time.  With
spins of +-1 that is the Ising model with a coupling of J/2, since an unlike pair costs twice the coupling.  On a
triangular lattice without end it orders at J/kT = ln(3)/2 = 0.5493.  `frozen` stays on icospheres, which are such
lattices but for twelve vertices.  `fluid` also makes flips and trajectories.

One run at each size, near the transition, is reweighted to other J: the energy of pairs is J times the number of unlike
edges, and nothing else depends on J.  Errors are those of a jackknife over blocks.
"""

import argparse
import math
from itertools import pairwise

import numpy as np
import openmm as mm
from openmm import app, unit
from scipy.optimize import brentq

import openmmhelfrich as mh

temperature = 300 * unit.kelvin
kT = (temperature * unit.MOLAR_GAS_CONSTANT_R).value_in_unit(unit.kilojoules_per_mole)
kappa = 20 * kT
SWEEPS_A_STEP = 10
BLOCKS = 20
LEAST = 1000  # sweeps, so that each block has samples


def createForce(mesh, J, isFluid):
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    for _ in range(2):
        force.addSpecies(kappa, 0)
    force.setVertexSpecies(np.random.default_rng(1).integers(2, size=len(mesh.vertices)))
    force.setPairEnergy(0, 1, J * kT)
    if isFluid:
        edge = mesh.edgeLengths.mean()
        force.setAreaModulus(1e5 * kT)
        force.setTargetArea(mesh.area)
        force.setVolumeModulus(1e5 * kT)
        force.setTargetVolume(0.95 * mesh.volume)
        force.setTether(1000 * kT, 0.8 * edge, 1.35 * edge, 2)
    return force


def createSimulation(mesh, force, isFluid, seed):
    exchange = mh.SpeciesExchangeIntegrator(temperature, SWEEPS_A_STEP * len(mesh.vertices) / len(mesh.edges))
    exchange.setProposal("mutation")
    exchange.setRandomNumberSeed(seed)
    integrator = exchange
    if isFluid:
        integrator = mh.HybridMonteCarloIntegrator(temperature, 1e-4, 20, 0.3, 0.1)
        integrator.addMove(exchange, 0.8)  # 0.1 of the steps are trajectories
        integrator.setRandomNumberSeed(seed)
    system = mesh.createSystem()
    system.addForce(force)
    platform = mm.Platform.getPlatformByName("CPU")
    simulation = app.Simulation(mesh.topology(), system, integrator, platform, {"Threads": "1"})
    simulation.context.setPositions(mesh.vertices)
    if isFluid:
        mh.adaptStepSize(simulation, 300)
    return simulation, exchange


def sample(subdivisions, J, isFluid, sweeps, seed=1):
    """Return the magnetizations and the numbers of unlike edges of a run, after a tenth of it."""
    mesh = mh.Mesh.icosphere(subdivisions)
    force = createForce(mesh, J, isFluid)
    simulation, exchange = createSimulation(mesh, force, isFluid, seed)
    start, rows = exchange.getNumAttempted(), []
    while exchange.getNumAttempted() - start < sweeps * len(mesh.vertices):
        simulation.integrator.step(4 if isFluid else 1)
        triangles = force.getTrianglesInContext(simulation.context)
        species = force.getVertexSpeciesInContext(simulation.context)
        corners = species[triangles]
        unlike = np.count_nonzero(corners != np.roll(corners, 1, axis=1)) // 2
        rows.append((2 * np.mean(species) - 1, unlike))
    return np.array(rows[len(rows) // 10 :]).T


def cumulant(rows, J0, J):
    """Return Binder's U = 1 - <m^4>/3<m^2>^2 at J, of samples made at J0."""
    m, unlike = rows
    weights = np.exp(-(J - J0) * (unlike - unlike.mean()))
    return 1 - np.average(m**4, weights=weights) / (3 * np.average(m**2, weights=weights) ** 2)


def withoutBlock(rows, i):
    return np.delete(rows, np.array_split(np.arange(rows.shape[1]), BLOCKS)[i], axis=1)


def jackknife(values):
    return math.sqrt((BLOCKS - 1) / BLOCKS * np.sum((np.array(values) - np.mean(values)) ** 2))


def errorOf(rows, J0, J):
    """Return the standard error of the cumulant at J."""
    return jackknife([cumulant(withoutBlock(rows, i), J0, J) for i in range(BLOCKS)])


def crossing(small, large, J0):
    """Return where the cumulants of two sizes are equal, nearest to J0, and its error, or nan and nan."""

    def difference(J):
        return cumulant(small, J0, J) - cumulant(large, J0, J)

    grid = np.linspace(0.94 * J0, 1.06 * J0, 25)
    turns = np.flatnonzero(np.diff(np.sign([difference(J) for J in grid])))
    if not len(turns):
        return math.nan, math.nan
    i = min(turns, key=lambda turn: abs(grid[turn] - J0))
    J = brentq(difference, grid[i], grid[i + 1])
    slope = (difference(J + 0.005) - difference(J - 0.005)) / 0.01
    return J, math.hypot(errorOf(small, J0, J), errorOf(large, J0, J)) / abs(slope)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["frozen", "fluid"])
    parser.add_argument("--sweeps", type=int, default=100000)
    parser.add_argument("--J", type=float, default=math.log(3) / 2, help="of the runs, in kT")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--plot")
    options = parser.parse_args()
    if options.sweeps < LEAST:
        parser.error(
            f"--sweeps is {options.sweeps}; it must be at least {LEAST}, so that each of {BLOCKS} blocks has samples"
        )
    J0, samples = options.J, {}
    for subdivisions in (2, 3, 4):
        n = 10 * 4**subdivisions + 2
        rows = samples[n] = sample(subdivisions, J0, options.what == "fluid", options.sweeps, options.seed)
        error = errorOf(rows, J0, J0)
        independent = rows.shape[1] / (2 * mh.autocorrelationTime(abs(rows[0])))
        print(f"{n} vertices, J = {J0:.4f} kT: U {cumulant(rows, J0, J0):.4f} +- {error:.4f}, |m| "
              f"{abs(rows[0]).mean():.4f}, {independent:.0f} independent samples", flush=True)  # fmt: skip
    sizes = sorted(samples)
    for a, b in pairwise(sizes):
        J, error = crossing(samples[a], samples[b], J0)
        print(f"{a} and {b} vertices: J = {J:.4f} +- {error:.4f} kT, U {cumulant(samples[a], J0, J):.4f}")
    if options.plot:
        plot(samples, J0, options.plot, options.what)


def plot(samples, J0, path, what):
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5, 3.5), layout="constrained")
    axes = figure.subplots()
    grid = np.linspace(0.95 * J0, 1.05 * J0, 41)
    for n, rows in samples.items():
        U = np.array([cumulant(rows, J0, J) for J in grid])
        errors = [errorOf(rows, J0, J) for J in grid]
        (line,) = axes.plot(grid, U, label=f"{n} vertices")
        axes.fill_between(grid, U - errors, U + errors, color=line.get_color(), alpha=0.3, linewidth=0)
    axes.axvline(math.log(3) / 2, color="gray", linewidth=0.8, linestyle=":")
    axes.set(xlabel="J / kT", ylabel="Binder cumulant", title=f"Two species, {what} sphere")
    axes.legend()
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main()
