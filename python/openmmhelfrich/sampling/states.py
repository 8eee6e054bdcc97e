"""Thermodynamic states: a temperature, and what the energy of a membrane depends on; how a Context takes on a state,
and what its energy is then.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import openmm as mm
from openmm import unit

from ..helfrich import HelfrichForce, SpeciesExchangeIntegrator
from ..units import thermalEnergy
from .conditions import currentConditions, requireConditions, setConditions, singleNames
from .moves import movesOf


@dataclass(frozen=True)
class ThermodynamicState:
    """What replicas exchange, and what samples are reweighted to.

    ::

        state = mh.ThermodynamicState(300 * unit.kelvin, {force.getTargetVolumeParameter(): 0.9 * mesh.volume})
        stiff = mh.ThermodynamicState(300 * unit.kelvin, {"bending_modulus": 60})

    Attributes
    ----------
    temperature : float or Quantity
        in K
    parameters : dict
        numbers in kJ/mol and powers of nm, by name: Context parameters, such as ``force.getTargetVolumeParameter()``;
        "bending_modulus", "gaussian_modulus", "area_modulus", "volume_modulus", "area_difference_modulus",
        "spontaneous_curvature", "tension" and "pressure" of the membrane; "line_tension" between all its species; and
        with the numbers of species "bending_modulus[0]", "spontaneous_curvature[0]", "gaussian_modulus[0]",
        "line_tension[0,1]", "pair_energy[0,1]", "chemical_potential[0]"
    stepSize : float or Quantity, optional
        for trajectories in this state, in ps; by default that of the simulation which begins in it
    """

    temperature: float | unit.Quantity
    parameters: dict[str, float] = field(default_factory=dict)
    stepSize: float | unit.Quantity | None = None

    @property
    def thermalEnergy(self) -> float:
        """kT, in kJ/mol."""
        return thermalEnergy(self.temperature)


def mutationsOf(integrator: Any) -> list[SpeciesExchangeIntegrator]:
    """Return the moves of an integrator that change how many vertices are of each species."""
    moves = movesOf(integrator, onlyUsed=True)
    return [m for m in moves if isinstance(m, SpeciesExchangeIntegrator) and m.getProposal() == "mutation"]


class Membrane:
    """A Context with a membrane, or with none, and the parameters of states that it can take on.

    Attributes
    ----------
    force : HelfrichForce or None
        the membrane
    """

    def __init__(self, context: mm.Context, force: HelfrichForce | None, integrator: Any = None):
        """Create it of a Context, its membrane, and an integrator whose moves have chemical potentials."""
        self.context, self.force = context, force
        self._mutations = [] if integrator is None else mutationsOf(integrator)
        self._integrator = context.getIntegrator() if integrator is None else integrator
        self._known = set(dict(context.getParameters()))

    def named(self, parameters: Mapping[str, Any]) -> dict[str, float]:
        """Return the parameters of a state by the names of single numbers, in their order.

        Raises a ValueError if two of them are the same number.
        """
        single: dict[str, float] = {}
        givenBy: dict[str, str] = {}
        for name, value in parameters.items():
            for own in [name] if self.force is None or name in self._known else singleNames(self.force, name):
                if own in single:
                    raise ValueError(
                        f"the parameters '{givenBy[own]}' and '{name}' are both given, which both set {own}"
                    )
                single[own], givenBy[own] = float(value), name
        return {name: single[name] for name in sorted(single)}

    def ofForce(self, parameters: Mapping[str, float]) -> dict[str, float]:
        """Return the parameters that are conditions of the membrane's force."""
        own = {name: value for name, value in parameters.items() if name not in self._known}
        return {name: value for name, value in own.items() if _species(name) is None}

    def require(self, parameters: Iterable[str]) -> None:
        """Raise a ValueError unless there are parameters of some names."""
        count = 0 if self.force is None else self.force.getNumSpecies()
        for name in parameters:
            number = _species(name)
            if name in self._known:
                continue
            if self.force is None:
                raise ValueError(f"there is no parameter '{name}', and no membrane that has it")
            if number is None:
                requireConditions(self.force, [name], sorted(self._known))
            elif number >= count:
                raise ValueError(f"'{name}' is of the species {number}, and there are {count}, from 0 on")

    def current(self, names: Iterable[str]) -> dict[str, float]:
        """Return the present values of parameters by their names, of which chemical potentials are 0."""
        values = {name: self.context.getParameter(name) if name in self._known else 0.0 for name in names}
        if self.force is None:
            return values
        return values | currentConditions(self.context, self.force, self.ofForce(values))

    def takeOn(self, parameters: Mapping[str, float]) -> None:
        """Give the Context, the membrane and the moves the parameters of a state."""
        for name, value in parameters.items():
            if name in self._known:
                self.context.setParameter(name, value)
            elif (number := _species(name)) is not None:
                for move in self._mutations:
                    move.setChemicalPotential(number, value)
        conditions = self.ofForce(parameters)
        if conditions and self.force is not None:
            setConditions(self.context, self.force, conditions)

    def energy(self, parameters: Mapping[str, float]) -> float:
        """Return the potential energy, in kJ/mol, in the state that the Context has taken on, of the groups of forces
        that are integrated, less the chemical potentials of all vertices.
        """
        state = self.context.getState(energy=True, groups=self._integrator.getIntegrationForceGroups())
        return state.getPotentialEnergy().value_in_unit(unit.kilojoules_per_mole) - self._work(parameters)

    def _work(self, parameters: Mapping[str, float]) -> float:
        """Return the sum of the chemical potentials of all vertices, in kJ/mol."""
        given = {_species(name): value for name, value in parameters.items() if _species(name) is not None}
        if self.force is None or not (given or self._mutations):
            return 0.0
        counts = np.bincount(self.force.getVertexSpeciesInContext(self.context), minlength=self.force.getNumSpecies())
        own = [
            self._mutations[0].getChemicalPotential(i)._value if self._mutations else 0.0 for i in range(len(counts))
        ]
        return float(sum(n * given.get(i, own[i]) for i, n in enumerate(counts.tolist())))


def _species(name: str) -> int | None:
    """Return the number of the species whose chemical potential has this name, or None."""
    found = re.fullmatch(r"chemical_potential\[(\d+)\]", name)
    return int(found[1]) if found else None
