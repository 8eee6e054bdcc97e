"""Temperature schedules: functions of the number of Monte Carlo steps made, to cool a membrane into a minimum of its
energy.

A schedule is anything that can be called with a step and returns a temperature in K.  It depends on nothing but the
step, so that a run that is stopped and continued goes on as if it never had stopped.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from openmm import unit

from ..units import valueIn

Temperature: TypeAlias = float | unit.Quantity
Schedule = Callable[[int], float]


@dataclass(frozen=True)
class ExponentialSchedule:
    """Exponential cooling, T(n) = max(T_0 exp(-lambda (n-n_0)), T_min), and T_0 before step n_0.

    ::

        schedule = mh.ExponentialSchedule(start=300, rate=0.01, minimum=3)
        print(schedule(0), schedule(100))

    Attributes
    ----------
    start : float or Quantity
        T_0, in K
    rate : float
        lambda, per step; 0 keeps the temperature
    minimum : float or Quantity
        T_min, in K, at most T_0
    firstStep : int
        n_0, the step at which cooling begins

    Raises
    ------
    ValueError
        if one of them is out of range
    """

    start: Temperature
    rate: float
    minimum: Temperature
    firstStep: int = 0

    def __post_init__(self) -> None:
        for name in ("start", "minimum"):
            object.__setattr__(self, name, _temperature(f"ExponentialSchedule: {name}", getattr(self, name)))
        if self.minimum > self.start:
            raise ValueError(
                f"ExponentialSchedule: minimum is {self.minimum} K; it must not be above the start, {self.start} K"
            )
        if not (math.isfinite(self.rate) and self.rate >= 0):
            raise ValueError(f"ExponentialSchedule: rate is {self.rate}; it must be finite and not negative")

    @classmethod
    def over(cls, steps: int, start: Temperature, minimum: Temperature, firstStep: int = 0) -> "ExponentialSchedule":
        """Create the schedule that reaches its minimum after a number of steps."""
        start, minimum = (
            _temperature("ExponentialSchedule: start", start),
            _temperature("ExponentialSchedule: minimum", minimum),
        )
        if not steps > 0:
            raise ValueError(f"ExponentialSchedule: steps is {steps}; it must be positive")
        return cls(start, math.log(start / minimum) / steps, minimum, firstStep)

    def __call__(self, step: int) -> float:
        """Return the temperature at a step, in K."""
        return max(self.start * math.exp(-self.rate * max(step - self.firstStep, 0)), self.minimum)


@dataclass(frozen=True)
class TableSchedule:
    """Temperatures at given steps, with straight lines between them and the first and last temperature outside.

    ::

        schedule = mh.TableSchedule([0, 100, 200], [300, 300, 30])
        print(schedule(150))  # 165 K

    Attributes
    ----------
    steps : sequence of numbers
        the steps, ascending
    temperatures : sequence of numbers or Quantity
        the temperature at each, in K

    Raises
    ------
    ValueError
        if their numbers differ, the steps do not ascend, or a temperature is not positive
    """

    steps: Sequence[float]
    temperatures: Sequence[float]

    def __post_init__(self) -> None:
        steps = tuple(map(float, self.steps))
        temperatures = tuple(float(t) for t in valueIn(self.temperatures, unit.kelvin, "temperatures"))
        if len(steps) != len(temperatures) or not steps:
            raise ValueError(
                f"TableSchedule: there are {len(steps)} steps and {len(temperatures)} temperatures; there must be as "
                "many of both, at least one"
            )
        for i, step in enumerate(steps):
            if not math.isfinite(step) or (i > 0 and step <= steps[i - 1]):
                raise ValueError(f"TableSchedule: step {i} is {step:g}; steps must be finite and ascend")
            _temperature(f"TableSchedule: the temperature at step {step:g}", temperatures[i])
        object.__setattr__(self, "steps", steps)
        object.__setattr__(self, "temperatures", temperatures)

    def __call__(self, step: int) -> float:
        """Return the temperature at a step, in K."""
        return float(np.interp(step, self.steps, self.temperatures))


def createSchedule(schedule: Any) -> Schedule:
    """Return a schedule whose every temperature is checked.

    ::

        schedule = mh.createSchedule(([0, 100], [300, 30]))
        print(schedule(50))

    Parameters
    ----------
    schedule : float, Quantity, pair of sequences, or callable
        a constant temperature in K; steps and temperatures of a :class:`TableSchedule`; or a schedule, which is any
        function from a step to a temperature

    Raises
    ------
    ValueError
        if it is none of these; from the schedule, if it returns what is not a positive, finite temperature
    """
    if callable(schedule):
        return lambda step: _temperature(f"the schedule's temperature at step {step}", schedule(step))
    if unit.is_quantity(schedule) or isinstance(schedule, (int, float)):
        temperature = _temperature("the temperature", schedule)
        return lambda step: temperature
    try:
        steps, temperatures = schedule
    except (TypeError, ValueError):
        raise ValueError(
            f"the schedule is {schedule!r}; it must be a temperature, a pair of steps and temperatures, or a function "
            "of the step"
        ) from None
    return TableSchedule(steps, temperatures)


def _temperature(name: str, value: Any) -> float:
    try:
        kelvin = float(valueIn(value, unit.kelvin))
    except TypeError:
        raise ValueError(f"{name} is {value!r}; it must be a temperature") from None
    if not (math.isfinite(kelvin) and kelvin > 0):
        raise ValueError(f"{name} is {kelvin} K; it must be positive and finite")
    return kelvin
