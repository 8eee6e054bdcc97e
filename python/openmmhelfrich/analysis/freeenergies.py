"""Free energies of thermodynamic states, from samples of some of them: temperatures, targets, moduli, spontaneous
curvatures, line tensions, pair energies and chemical potentials.

MBAR (M. R. Shirts and J. D. Chodera, J. Chem. Phys. 129, 124105, 2008) takes the energy of each sample in each state.
"""

import copy
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import openmm as mm
from numpy.typing import ArrayLike, NDArray

from ..display import Brief
from ..geometry.mesh import Mesh
from ..helfrich import HelfrichForce
from ..io.vtkhdf import MeshFrame
from ..optional import dataFrame, require
from ..sampling.states import Membrane, ThermodynamicState
from .correlation import autocorrelationTime


@dataclass(frozen=True, eq=False, repr=False)
class FreeEnergies(Brief):
    """What samples of some states say of all.

    Attributes
    ----------
    freeEnergies, freeEnergyErrors : (K,) arrays of float
        -ln Z of each state relative to the first, with standard errors
    overlap : (K, K) array of float
        the overlap matrix: how probably a sample of one state could be one of another.  Neighbors should have 0.03 or
        more
    autocorrelationTimes : (K,) array of float
        integrated autocorrelation times of the series that were given, in their steps; NaN where there is none
    numSamples : (K,) array of int
        the samples of each state, thinned to one in an autocorrelation time
    """

    freeEnergies: np.ndarray
    freeEnergyErrors: np.ndarray
    overlap: np.ndarray
    autocorrelationTimes: np.ndarray
    numSamples: np.ndarray
    _mbar: Any
    _chosen: np.ndarray

    def means(self, values: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean of something in each state, and its standard error.

        Parameters
        ----------
        values : (N,) array
            its value for each of the samples that were given, in their order
        """
        given = np.asarray(values, dtype=float)
        if given.shape != (len(self._chosen),):
            raise ValueError(
                f"means: there are {given.size} values; there must be one for each of {len(self._chosen)} samples"
            )
        found = self._mbar.compute_expectations(given[self._chosen])
        return found["mu"], found["sigma"]

    def toDataFrame(self) -> Any:
        """Return a pandas.DataFrame with a row for each state; overlap is that with the next one."""
        return dataFrame(
            {
                "freeEnergy": self.freeEnergies,
                "freeEnergyError": self.freeEnergyErrors,
                "overlap": [*np.diag(self.overlap, 1), math.nan],
                "autocorrelationTime": self.autocorrelationTimes,
                "numSamples": self.numSamples,
            }
        )


def freeEnergies(u_kn: ArrayLike, N_k: ArrayLike) -> FreeEnergies:
    """Combine the samples of several states, by their reduced energies in all of them.

    ::

        random = np.random.default_rng(1)  # of springs of the stiffness 1 and 2
        x = np.concatenate([random.normal(size=500), random.normal(scale=0.5**0.5, size=500)])
        result = mh.freeEnergies([x**2 / 2, x**2], [500, 500])
        print(result.freeEnergies[1])  # about ln(2)/2

    Parameters
    ----------
    u_kn : (K, N) array
        E/kT in each state, of the samples of the first state, one after the other, then those of the second, and so on:
        what :meth:`ReplicaExchange.samples` and :func:`reducedEnergies` return
    N_k : (K,) array of int
        how many samples are of each state; 0 for a state that none is of

    Raises
    ------
    ValueError
        if the arrays do not go together, there are fewer than two samples of a state, or pymbar or emcee is not
        installed
    """
    u, counts = _checked(u_kn, N_k)
    mbar = require("pymbar", "free energies", "analysis").MBAR
    ends = np.cumsum(counts)
    times, chosen = np.full(len(counts), np.nan), np.zeros(counts.sum(), dtype=bool)
    for k in np.flatnonzero(counts).tolist():
        first = int(ends[k] - counts[k])
        times[k] = _longestTime(u[:, first : ends[k]], k)
        chosen[first + np.arange(0, counts[k], times[k]).astype(int)] = True
    numSamples = np.array([part.sum() for part in np.split(chosen, ends[:-1])])
    # Energies of thousands of kT would keep the equations from being solved.
    origin = u[:, chosen].mean(axis=1)
    result = mbar(u[:, chosen] - origin[:, np.newaxis], numSamples, initialize="BAR" if np.all(counts) else "zeros")
    differences = result.compute_free_energy_differences()
    return FreeEnergies(
        differences["Delta_f"][0] + origin - origin[0],
        differences["dDelta_f"][0],
        result.compute_overlap()["matrix"],
        times,
        numSamples,
        result,
        chosen,
    )


def reducedEnergies(
    frames: Iterable[MeshFrame | Mesh], force: HelfrichForce, states: Sequence[ThermodynamicState]
) -> NDArray[np.float64]:
    """Return E/kT of a membrane's shapes in several states: a (states, frames) array.

    ::

        mh.run("vesicle.toml")
        frames, scene = mh.readMeshTrajectory("vesicle.vtkhdf"), mh.Scene.of("vesicle.toml")
        force = scene.createForce()
        states = [mh.ThermodynamicState(300, {"bending_modulus": k}) for k in (50, 52)]
        u_kn = mh.reducedEnergies(frames, force, states)

    Those of a run of one state, with :func:`freeEnergies`, are reweighted to others.

    Parameters
    ----------
    frames : iterable of MeshFrame or Mesh
        the shapes, each with its triangles, and its species; one without has those of the force
    force : HelfrichForce
        the membrane; what the states do not name is as it has it.  It is not changed
    states : sequence of ThermodynamicState
        the states.  Where they have chemical potentials, the energy is less by those of all vertices

    Raises
    ------
    ValueError
        if there are no states, a parameter of theirs is unknown, or a shape is of another membrane
    """
    if not states:
        raise ValueError("reducedEnergies: there are no states; give at least one")
    membrane, given, rows = None, [], []
    for number, frame in enumerate(frames):
        mesh = frame.mesh if isinstance(frame, MeshFrame) else frame
        if membrane is None:
            membrane = _membraneOf(mesh, force)
            given = _parametersOf(membrane, states)
        try:
            rows.append(np.divide(_energies(membrane, mesh, given), [state.thermalEnergy for state in states]))
        except mm.OpenMMException as error:
            raise ValueError(f"reducedEnergies: frame {number}: {error}") from None
    return np.array(rows, dtype=float).reshape(-1, len(states)).T


def _membraneOf(mesh: Mesh, force: HelfrichForce) -> Membrane:
    """Return a membrane of a force like another one, in a Context of its own."""
    system = mesh.createSystem()
    system.addForce(copy.deepcopy(force))
    context = mm.Context(system, mm.VerletIntegrator(0.001), mm.Platform.getPlatform("CPU"))
    context.setPositions(mesh.vertices)
    return Membrane(context, HelfrichForce.cast(system.getForce(0)))


def _parametersOf(membrane: Membrane, states: Sequence[ThermodynamicState]) -> list[dict[str, float]]:
    """Return the parameters of states, each of which has all that one of them has."""
    for state in states:
        membrane.require(state.parameters)
    named = [membrane.named(state.parameters) for state in states]
    own = membrane.current(dict.fromkeys(name for parameters in named for name in parameters))
    return [own | parameters for parameters in named]


def _energies(membrane: Membrane, mesh: Mesh, parameters: Sequence[dict[str, float]]) -> list[float]:
    """Return the energy of a shape, in kJ/mol, with each of some parameters."""
    force = membrane.force
    assert force is not None
    membrane.context.setPositions(mesh.vertices)
    force.setTrianglesInContext(membrane.context, mesh.triangles)
    if force.getNumSpecies() > 0:
        species = force.getVertexSpecies() if mesh.species is None else mesh.species
        force.setVertexSpeciesInContext(membrane.context, species)
    energies = []
    for each in parameters:
        membrane.takeOn(each)
        energies.append(membrane.energy(each))
    return energies


def _longestTime(u: NDArray[np.float64], k: int) -> float:
    """Return the longest autocorrelation time of the energy of a series in its own state, and of the differences to
    that in the states beside it.
    """
    beside = [i for i in (k - 1, k + 1) if 0 <= i < len(u)]
    return max(autocorrelationTime(series) for series in (u[k], *(u[i] - u[k] for i in beside)))


def _checked(u_kn: ArrayLike, N_k: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    u, counts = np.asarray(u_kn, dtype=float), np.asarray(N_k)
    if u.ndim != 2 or counts.shape != u.shape[:1] or counts.dtype.kind not in "iu" or counts.sum() != u.shape[1]:
        raise ValueError(
            f"freeEnergies: u_kn has the shape {u.shape}, and N_k is {counts.tolist()}; u_kn must have a row for each "
            "state, and N_k, whole numbers, add up to its columns"
        )
    if np.any((counts < 0) | (counts == 1)) or not np.any(counts):
        raise ValueError(
            f"freeEnergies: N_k is {counts.tolist()}; of each state there must be none or two samples or more"
        )
    if not np.all(np.isfinite(u)):
        k, n = np.argwhere(~np.isfinite(u))[0]
        raise ValueError(f"freeEnergies: the energy of sample {n} in state {k} is {u[k, n]}; it must be finite")
    return u, counts.astype(np.int64)
