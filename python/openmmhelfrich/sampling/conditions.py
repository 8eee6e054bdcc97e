"""Conditions of a membrane that a run changes while it goes on: moduli, spontaneous curvature, line tension, tension
and pressure.

They go by the names of a configuration, and are measured in kJ/mol and powers of nm.  Tension, pressure and spontaneous
curvature are parameters of a Context; the others are those of a HelfrichForce, which a Context is told of.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
import openmm as mm

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


def currentConditions(context: mm.Context, force: HelfrichForce, names: Iterable[str]) -> dict[str, float]:
    """Return some conditions as they are in a Context, by their names."""
    return {name: _current(context, force, name) for name in names}


def setConditions(context: mm.Context, force: HelfrichForce, conditions: Mapping[str, float]) -> None:
    """Change some conditions in a Context, and those of the force with them."""
    ofForce = {name: value for name, value in conditions.items() if name not in _PARAMETERS}
    for name, value in conditions.items():
        if name in _PARAMETERS:
            context.setParameter(_PARAMETERS[name](force), value)
    for name, value in ofForce.items():
        if name == LINE_TENSION:
            for b in range(force.getNumSpecies()):
                for a in range(b):
                    force.setLineTension(a, b, value)
        else:
            _MODULI[name][1](force, value)
    if ofForce:
        force.updateParametersInContext(context)


def flatEnergy(context: mm.Context, force: HelfrichForce, mesh: Mesh) -> float:
    """Return the bending energy, in kJ/mol, that a Context's mesh, with its species, would have if it were flat
    everywhere.
    """
    species = [force.getSpeciesParameters(i)[:2] for i in range(force.getNumSpecies())]
    plain = [[value._value for value in each] for each in species] or [[force.getBendingModulus()._value, 0.0]]
    moduli, curvatures = np.transpose(plain)
    energies = moduli * (_current(context, force, CURVATURE) + curvatures) ** 2 / 2
    return float((energies[0 if mesh.species is None else mesh.species] * mesh.vertexAreas).sum())


def _current(context: mm.Context, force: HelfrichForce, name: str) -> float:
    if name in _PARAMETERS:
        return float(context.getParameter(_PARAMETERS[name](force)))
    if name == LINE_TENSION:
        return float(force.getLineTension(0, 1)._value)
    return float(_MODULI[name][0](force)._value)
