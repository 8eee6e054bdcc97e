"""Conditions of a membrane that a run or a state changes: moduli, spontaneous curvature, line tension, pair energies,
tension and pressure.

They go by the names of a configuration, and are measured in kJ/mol and powers of nm.  What single species have, and
what acts between two of them, has their numbers: "bending_modulus[1]", "line_tension[0,1]", "pair_energy[0,1]".
Tension, pressure and the common spontaneous curvature are parameters of a Context; the others are those of a
HelfrichForce, which a Context is told of.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
import openmm as mm
from numpy.typing import NDArray
from openmm import app

from ..geometry.mesh import Mesh
from ..helfrich import HelfrichForce

CURVATURE, LINE_TENSION = "spontaneous_curvature", "line_tension"
_PARAMETERS: dict[str, Callable[[HelfrichForce], str]] = {
    CURVATURE: HelfrichForce.getSpontaneousCurvatureParameter,
    "tension": HelfrichForce.getTensionParameter,
    "pressure": HelfrichForce.getPressureParameter,
}
_MODULI: dict[str, tuple[Callable[[HelfrichForce], Any], Callable[[HelfrichForce, float], None]]] = {
    "bending_modulus": (HelfrichForce.getBendingModulus, HelfrichForce.setBendingModulus),
    "gaussian_modulus": (HelfrichForce.getGaussianModulus, HelfrichForce.setGaussianModulus),
    "area_modulus": (HelfrichForce.getAreaModulus, HelfrichForce.setAreaModulus),
    "volume_modulus": (HelfrichForce.getVolumeModulus, HelfrichForce.setVolumeModulus),
    "area_difference_modulus": (HelfrichForce.getAreaDifferenceModulus, HelfrichForce.setAreaDifferenceModulus),
}
# The terms that conditions are the moduli of.
TERMS = {
    "bending_modulus": "bending",
    "area_modulus": "area",
    "volume_modulus": "volume",
    "area_difference_modulus": "areaDifference",
    "tension": "tension",
    "pressure": "pressure",
    "gaussian_modulus": "gaussian",
    LINE_TENSION: "line",
    "pair_energy": "pair",
}
# In the order of HelfrichForce.getSpeciesParameters().
_OF_SPECIES = ("bending_modulus", CURVATURE, "gaussian_modulus")
_OF_PAIRS: dict[str, tuple[Callable[..., Any], Callable[..., None]]] = {
    LINE_TENSION: (HelfrichForce.getLineTension, HelfrichForce.setLineTension),
    "pair_energy": (HelfrichForce.getPairEnergy, HelfrichForce.setPairEnergy),
}


def currentConditions(context: mm.Context, force: HelfrichForce, names: Iterable[str]) -> dict[str, float]:
    """Return some conditions as they are in a Context, by their names.

    The line tension between all species is the greatest of pairs, where these differ.
    """
    return {
        name: float(context.getParameter(_PARAMETERS[name](force)) if name in _PARAMETERS else _ofForce(force, name))
        for name in names
    }


def setConditions(context: mm.Context, force: HelfrichForce, conditions: Mapping[str, float]) -> None:
    """Change some conditions in a Context, and those of the force with them."""
    for name, value in conditions.items():
        if name in _PARAMETERS:
            context.setParameter(_PARAMETERS[name](force), value)
    ofForce = {name: value for name, value in conditions.items() if name not in _PARAMETERS}
    if ofForce:
        putConditions(force, ofForce)
        force.updateParametersInContext(context)


def singleNames(force: HelfrichForce, name: str) -> list[str]:
    """Return the names of the single numbers that a condition stands for: that of the Context parameter that it is,
    those of all pairs, or its own, with the numbers of a pair in order.
    """
    key, numbers = _parts(name)
    if name in _PARAMETERS:
        return [_PARAMETERS[name](force)]
    if name == LINE_TENSION:
        return [f"{name}[{a},{b}]" for a, b in _pairs(force)]
    return [f"{key}[{','.join(map(str, sorted(numbers)))}]"] if numbers else [name]


def conditionNames(force: HelfrichForce, names: Iterable[str]) -> list[str]:
    """Return names of which those of Context parameters that are conditions are these conditions'."""
    conditions = {parameter(force): name for name, parameter in _PARAMETERS.items()}
    return [conditions.get(name, name) for name in names]


def putConditions(force: HelfrichForce, conditions: Mapping[str, float]) -> None:
    """Change some conditions of a force that are no parameters of a Context."""
    for name, value in conditions.items():
        key, numbers = _parts(name)
        if name == LINE_TENSION:
            for a, b in _pairs(force):
                force.setLineTension(a, b, value)
        elif len(numbers) == 1:
            values = [each._value for each in force.getSpeciesParameters(numbers[0])]
            values[_OF_SPECIES.index(key)] = value
            force.setSpeciesParameters(numbers[0], *values)
        elif numbers:
            _OF_PAIRS[key][1](force, *numbers, value)
        else:
            _MODULI[key][1](force, value)


def requireConditions(force: HelfrichForce, names: Iterable[str], others: Iterable[str] = ()) -> None:
    """Raise a ValueError unless a force has the conditions of some names, which may have been other names too."""
    count = force.getNumSpecies()
    for name in names:
        if name in _PARAMETERS:
            continue
        key, numbers = _parts(name)
        known: Iterable[str] = _OF_SPECIES if len(numbers) == 1 else _OF_PAIRS if numbers else [*_MODULI, LINE_TENSION]
        if key not in known:
            raise ValueError(
                f"there is no parameter '{name}'; it must be one of {', '.join([*_known(count), *others])}"
            )
        for number in numbers:
            if number >= count:
                raise ValueError(f"'{name}' is of the species {number}, and there are {count}, from 0 on")
        if key == LINE_TENSION and (count < 2 or len(set(numbers)) == 1):
            raise ValueError(f"'{name}' has no effect; a line tension is between two different species")
        if key in ("bending_modulus", "gaussian_modulus") and count and not numbers:
            raise ValueError(f"'{name}' is that of a membrane without species; give that of one, as '{name}[0]'")


def boxOf(state: mm.State, force: HelfrichForce) -> Any:
    """Return the box vectors of a State if its membrane is periodic, otherwise None."""
    return state.getPeriodicBoxVectors(asNumpy=True) if force.usesPeriodicBoundaryConditions() else None


def positionsOf(context: mm.Context) -> NDArray[np.float64]:
    """Return the present positions of all particles, in nm: an (N, 3) array."""
    positions: NDArray[np.float64] = context.getState(positions=True).getPositions(asNumpy=True)._value
    return positions


def currentMesh(simulation: app.Simulation, force: HelfrichForce, speciesNames: Iterable[str] = ()) -> Mesh:
    """Return a Mesh of the present positions, live triangles and species, and of the beads, which follow the
    vertices.
    """
    state = simulation.context.getState(positions=True)
    positions = state.getPositions(asNumpy=True)
    box = boxOf(state, force)
    triangles = force.getTrianglesInContext(simulation.context)
    numVertices = int(triangles.max()) + 1
    species = force.getVertexSpeciesInContext(simulation.context)
    beads = positions[numVertices:]
    return Mesh(positions[:numVertices], triangles, box, beads, species, speciesNames)


def moduliOf(context: mm.Context, force: HelfrichForce) -> dict[str, float]:
    """Return the modulus of each term, in kJ/mol and powers of nm; tension and pressure as they are in a Context."""
    own = currentConditions(context, force, (name for name in TERMS if name not in _OF_PAIRS))
    return {TERMS[name]: value for name, value in own.items()} | {
        "tether": float(force.getTether()[0]._value),
        "repulsion": float(force.getRepulsion()[0]._value),
    }


def flatEnergy(context: mm.Context, force: HelfrichForce, mesh: Mesh) -> float:
    """Return the bending energy, in kJ/mol, that a Context's mesh, with its species, would have if it were flat
    everywhere.
    """
    species = [force.getSpeciesParameters(i)[:2] for i in range(force.getNumSpecies())]
    plain = [[value._value for value in each] for each in species] or [[force.getBendingModulus()._value, 0.0]]
    moduli, curvatures = np.transpose(plain)
    energies = moduli * (currentConditions(context, force, [CURVATURE])[CURVATURE] + curvatures) ** 2 / 2
    return float((energies[0 if mesh.species is None else mesh.species] * mesh.vertexAreas).sum())


def _ofForce(force: HelfrichForce, name: str) -> float:
    key, numbers = _parts(name)
    if name == LINE_TENSION:
        return max(force.getLineTension(a, b)._value for a, b in _pairs(force))
    if len(numbers) == 1:
        return force.getSpeciesParameters(numbers[0])[_OF_SPECIES.index(key)]._value
    return (_OF_PAIRS[key] if numbers else _MODULI[key])[0](force, *numbers)._value


def _parts(name: str) -> tuple[str, tuple[int, ...]]:
    """Return a name without the numbers of species in brackets, and these."""
    found = re.fullmatch(r"(\w+)\[(\d+(?:,\d+)?)\]", name.replace(" ", ""))
    return (found[1], tuple(map(int, found[2].split(",")))) if found else (name, ())


def _pairs(force: HelfrichForce) -> Iterable[tuple[int, int]]:
    return ((a, b) for b in range(force.getNumSpecies()) for a in range(b))


def _known(numSpecies: int) -> list[str]:
    """Return the names of conditions."""
    ofSpecies = [f"{name}[0]" for name in _OF_SPECIES] + [f"{name}[0,1]" for name in _OF_PAIRS]
    ofAll = [*_MODULI] if numSpecies == 0 else [*list(_MODULI)[2:], LINE_TENSION, *ofSpecies]
    return [*_PARAMETERS, *ofAll]
