"""Steps of a load between points that are given, against what they are to resolve."""

import math

import numpy as np
import pytest

from circuits.ngspice import load_steps
from harvester.base.compilation import compiled

SHORTEST, LONGEST = 1e-6, 1e-3


@compiled
def resolving(points, times, switches, stores, memory, energy):
    limits = load_steps.limits_of(1e-6 / load_steps.SHORTEST, 1.0, False)
    return load_steps.resolving_step(
        (points, times, 0), (3, 2, 1, 0), switches, stores, memory, energy, 0.0, 1e-4, limits, 1e-3
    )


def step_at(times, columns, switches=(), stores=(), memory=None, energy=0.0):
    """The step from the latest of four points; each unknown stands against ground."""
    points = np.zeros((4, 2 * len(columns)))
    points[:, ::2] = np.transpose(columns)
    switches = np.array([(*each, 0.0) for each in switches]).reshape(-1, 3)
    stores = np.array(stores, dtype=float).reshape(-1, 2)
    memory = np.zeros(len(switches) + 1) if memory is None else memory
    return resolving(points, np.array(times), switches, stores, memory, energy)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [3e3, 1e6, -1e6])
@pytest.mark.parametrize("width", [0.1, 60.0])
def test_a_turn_is_approached_and_crossed_by_a_step_as_short_as_it_must_be(speed, width):
    """None ends so near before the threshold that ngspice would take it back."""
    high, low = 2.0 + 0.5 * width, 2.0 - 0.5 * width
    threshold = high if speed > 0.0 else low
    memory = np.array([0.0 if speed > 0.0 else 1.0, 0.0])
    times = [-4e-4, -3e-4, -2e-4, -1e-4]

    def control(time):
        return threshold + speed * (np.array(time) - 2e-3)

    for _ in range(200):
        h = step_at(times, [control(times)], [(high, low)], memory=memory)
        left = abs(threshold - control(times[-1])) / abs(speed)
        times = [*times[1:], times[-1] + h]
        if times[-1] > 2e-3:
            break
        assert left - h > 1.2 * h or h == pytest.approx(2.0 * (times[-2] - times[-3]))
    known = min(load_steps.LOCATED * width / abs(speed), SHORTEST)
    assert times[-1] - 2e-3 <= max(known, SHORTEST / 64.0)
    before = memory[0]
    restart = step_at(times, [control(times)], [(high, low)], memory=memory)
    assert memory[0] == 1.0 - before
    assert 0.0 < restart <= SHORTEST * load_steps.RESTART / load_steps.SHORTEST


def test_a_turn_that_throws_its_control_back_is_seen_and_the_other_threshold_approached():
    """A buck's switch opens at 4 V; its supply rises again at once, and closes it at 8 V."""
    memory, levels = np.array([load_steps.CLOSED, 0.0]), [(8.0, 4.0)]
    times = np.array([-3e-6, -2e-6, -1e-6, 0.0])
    restart = step_at(times, [[4.6, 4.3, 4.05, 4.1]], levels, memory=memory)
    assert memory[0] == load_steps.UNKNOWN
    assert 0.0 < restart <= SHORTEST * load_steps.RESTART / load_steps.SHORTEST
    approaching = step_at(1e3 * times, [[5.0, 6.0, 7.0, 7.9]], levels, memory=memory)
    assert approaching <= 0.1 / 900.0
    turned = step_at(times, [[7.8, 7.9, 7.98, 8.01]], levels, memory=memory)
    assert memory[0] == load_steps.CLOSED
    assert turned == restart
    # Open, it is not approached on the way down; closed, not on the way up.
    for state, way in (
        (load_steps.OPEN, [7.0, 6.0, 5.0, 4.1]),
        (load_steps.CLOSED, [5, 6, 7, 7.9]),
    ):
        assert step_at(1e3 * times, [way], levels, memory=np.array([state, 0.0])) == LONGEST


def test_a_control_that_leaves_its_threshold_asks_for_nothing():
    times = np.array([-3e-3, -2e-3, -1e-3, 0.0])
    assert step_at(times, [-1.0 - 1e3 * (times + 3e-3)], [(1.0, -1e9)]) == LONGEST


@pytest.mark.parametrize(("coil", "size"), [(False, 43e-9), (True, 0.1)])
def test_a_steps_error_is_that_of_the_trapezoidal_rule_against_the_energy(coil, size):
    """The same energy swings in either: the same steps, a twelfth of x''' h³ off."""
    rate, peak = 1e3, math.sqrt(2e-6 / size)
    times = np.array([-3e-4, -2e-4, -1e-4, 0.0]) + 4e-3
    value = peak * np.sin(rate * times)
    elsewhere = 2e-6 - (size * value[-1] ** 2 if coil else 0.0)
    h = step_at(times, [value], stores=[(size, coil)], energy=elsewhere)
    third = rate**3 * peak * abs(math.cos(rate * times[1:3].mean()))
    assert h == pytest.approx((12.0 * 1e-4 * peak / third) ** (1 / 3), rel=0.02)


def test_a_coils_current_that_comes_to_zero_is_approached():
    times = np.array([-3e-5, -2e-5, -1e-5, 0.0])
    h = step_at(times, [-1e3 * (times - 1.5e-5)], stores=[(0.1, True)])
    assert h == pytest.approx(load_steps.COIL_APPROACH * 1.5e-5)
    idle = step_at(times, [-1e-6 * (times - 1.5e-5)], stores=[(0.1, True)], energy=1.0)
    assert idle == pytest.approx(2e-5)
