"""Temperature schedules: their values, and what is refused."""

import math

import pytest
from openmm import unit

import openmmhelfrich as mh


def test_exponential():
    schedule = mh.ExponentialSchedule(start=1000 * unit.kelvin, rate=0.01, minimum=100, firstStep=50)
    assert schedule(0) == schedule(50) == 1000
    assert schedule(150) == pytest.approx(1000 / math.e)
    assert schedule(100) / schedule(60) == pytest.approx(math.exp(-0.4))
    assert schedule(10**6) == 100


def test_exponential_over_a_number_of_steps():
    schedule = mh.ExponentialSchedule.over(200, 900, 300, firstStep=10)
    assert schedule(10) == 900 and schedule(110) == pytest.approx((900 * 300) ** 0.5)
    assert schedule(209) > 300 and schedule(211) == 300


def test_table():
    schedule = mh.TableSchedule([10, 20, 40], unit.Quantity([300, 200, 100], unit.kelvin))
    assert [schedule(n) for n in (0, 10, 15, 20, 30, 40, 99)] == [300, 300, 250, 200, 150, 100, 100]


def test_functions_tables_and_constants_are_schedules():
    assert mh.createSchedule(lambda n: (300 - n) * unit.kelvin)(100) == 200
    assert mh.createSchedule(([0, 2], [1, 3]))(1) == 2
    assert mh.createSchedule(250)(10**9) == 250
    assert mh.createSchedule(mh.ExponentialSchedule(300, 0, 300))(7) == 300


@pytest.mark.parametrize(
    "create, problem",
    [
        (lambda: mh.ExponentialSchedule(-1, 0.1, 1), "start is -1.0 K; it must be positive"),
        (lambda: mh.ExponentialSchedule(float("nan"), 0.1, 1), "start is nan"),
        (lambda: mh.ExponentialSchedule(300, 0.1, 0), "minimum is 0.0 K; it must be positive"),
        (lambda: mh.ExponentialSchedule(300, 0.1, 400), "must not be above the start, 300.0 K"),
        (lambda: mh.ExponentialSchedule(300, -0.1, 200), "rate is -0.1; it must be finite and not negative"),
        (lambda: mh.ExponentialSchedule(300 * unit.nanometer, 0.1, 200), "must be a temperature"),
        (lambda: mh.ExponentialSchedule.over(0, 300, 200), "steps is 0; it must be positive"),
        (lambda: mh.TableSchedule([1, 2], [300]), "2 steps and 1 temperatures"),
        (lambda: mh.TableSchedule([], []), "at least one"),
        (lambda: mh.TableSchedule([1, 1], [300, 200]), "step 1 is 1; steps must be finite and ascend"),
        (lambda: mh.TableSchedule([1, 2], [300, 0]), "temperature at step 2 is 0.0 K"),
        (lambda: mh.createSchedule("cold"), "'cold'; it must be a temperature, a pair of steps"),
        (
            lambda: mh.createSchedule(lambda n: 1 - n)(1),
            "temperature at step 1 is 0.0 K; it must be positive and finite",
        ),
    ],
)
def test_what_is_refused(create, problem):
    with pytest.raises(ValueError, match=problem):
        create()
