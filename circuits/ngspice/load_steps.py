"""Steps that resolve a load's switching events and the energy exchange of capacitors and coils.

ngspice's control by the local error requires the same relative accuracy of every capacitor and
coil, whatever its energy, so that an idle coil's ringing takes most of the steps. It also locates
switching events by rejected steps, each followed by a first-order step. Here errors are weighted by
energy, and a switching event is approached from before.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from harvester.base.compilation import uncounted

# Largest error of a step in a capacitor or coil: the root of the error's energy over the largest
# recent energy.
TOLERANCE = 5e-5
# Shortest step for the load, and first step after a switching event if ngspice does not control the
# local error, as shares of the grid step.
SHORTEST, RESTART = 2.0**-10, 2.0**-13
# Largest ratio of a step to the previous one.
GROWTH = 2.0
# A step takes this share of the time left to a switching event. ngspice repeats a step that ends
# nearer to the threshold than 1.2 times the control's last change: 0.45 leaves 0.55/0.45 = 1.22.
APPROACH = 0.45
# A step takes this share of the time left to a zero of a coil's current, at which a series diode
# blocks. A current below IDLE times the allowed error is ignored.
COIL_APPROACH, IDLE = 0.5, 10.0
# A switching event is located to LOCATED of the switch's hysteresis, since a control that
# overshoots may toggle another switch. The best accuracy is LEAST_LOCATED of the shortest step, or,
# if ngspice controls the local error, the default grid's shortest step: in shorter steps
# ngspice's Newton iterations fail.
LOCATED, LEAST_LOCATED = 0.2, 1.0 / 64.0
# SHORTEST, RESTART and LOCATED of an endlessly toggling switch, in time constants of its control.
TURN_STEPS = 0.1, 0.01, 0.05
# Memory of the largest recent energy, in radians of the device's natural frequency.
MEMORY = 15.0
# Number of accepted points for the third derivative.
POINTS = 4
# States of a switch in `memory`. Their order matters: a switch that may still close is below
# CLOSED, one that may still open is above OPEN.
OPEN, UNKNOWN, CLOSED = 0.0, 0.5, 1.0


@uncounted
def limits_of(step: float, refinement: float, by_error: bool) -> tuple[float, float, float]:
    """The step limits (s) of `resolving_step`; `by_error` if ngspice controls the local error."""
    if by_error:
        shortest = SHORTEST * step * refinement
        return shortest, shortest, step
    return SHORTEST * step, LEAST_LOCATED * SHORTEST * step, RESTART * step


@uncounted
def limits_of_turn(limits: Any, turn: float) -> tuple[float, float, float]:
    """Limits for endlessly toggling switches with this time constant of the control (s)."""
    shortest, least_located, restart = limits
    steps = TURN_STEPS[0] * turn, TURN_STEPS[1] * turn, TURN_STEPS[2] * turn
    return min(shortest, steps[0]), min(least_located, steps[1]), min(restart, steps[2])


@uncounted
def resolving_step(
    history: Any,
    now: Any,
    switches: np.ndarray,
    stores: np.ndarray,
    memory: np.ndarray,
    energy: float,
    forgotten: float,
    tolerance: float,
    limits: Any,
    longest: float,
) -> float:
    """Longest step from an accepted point that resolves the load.

    Parameters
    ----------
    history : (float64 array (points, columns), float64 array (points,), int)
        Accepted points of one copy, their times (s), and the first column watched.
    now : (int, int, int, int)
        Indices of the latest points, the newest first.
    switches : ndarray, shape (switches, 2)
        Control above which each switch closes, and below which it opens.
    stores : ndarray, shape (stores, 2)
        Capacitance (F) or inductance (H); 1 for a coil, else 0.
    memory : ndarray, shape (switches + 1,)
        States of the switches (open, unknown, closed), and twice the reference energy (J); updated.
    energy : float
        Twice the present energy of the transducer (J).
    forgotten : float
        Decay rate of the largest recent energy (1/s).
    tolerance : float
        See `TOLERANCE`.
    limits : (float, float, float)
        Shortest step for the load, best accuracy of a switching event, longest step after one (s).
    longest : float
        Longest step allowed (s).
    """
    last = history[1][now[0]] - history[1][now[1]]
    longest = min(longest, GROWTH * last)
    longest = _turns(history, now, last, switches, memory, limits, longest)
    shortest = limits[0]
    stored = history[2] + 2 * len(switches)
    for m in range(len(stores)):
        if stores[m, 1] > 0.0:
            energy += stores[m, 0] * history[0][now[0], stored + 2 * m] ** 2
    memory[-1] = max(memory[-1] * (1.0 - min(last * forgotten, 1.0)), energy)
    for m in range(len(stores)):
        value, rate, third = _derivatives(history, now, stored + 2 * m)
        limit = tolerance * math.sqrt(memory[-1] / stores[m, 0])
        if third > 0.0:
            # The trapezoidal rule's error is a twelfth of the third derivative times h³.
            longest = min(longest, max((12.0 * limit / third) ** (1.0 / 3.0), shortest))
        if stores[m, 1] > 0.0 and value * rate < 0.0 and abs(value) > IDLE * limit:
            longest = min(longest, max(-COIL_APPROACH * value / rate, shortest))
    return longest


@uncounted
def _turns(history, now, last, switches, memory, limits, longest):
    """Longest step that resolves the switching events; `last` is the previous step."""
    shortest, least_known, restart = limits
    points, times, first = history
    for k in range(len(switches)):
        column = first + 2 * k
        control = points[now[0], column] - points[now[0], column + 1]
        old = points[now[1], column] - points[now[1], column + 1]
        older = points[now[2], column] - points[now[2], column + 1]
        rate = (control - old) / last
        expected = old + (old - older) / (times[now[1]] - times[now[2]]) * last
        closes, opens, state = switches[k, 0], switches[k, 1], memory[k]
        if control > closes:
            memory[k] = CLOSED
        elif control < opens:
            memory[k] = OPEN
        elif (state < CLOSED and expected > closes) or (state > OPEN and expected < opens):
            # ngspice toggles the switch by the predicted control, which the switching may have
            # reversed.
            memory[k], state = UNKNOWN, -1.0
        if memory[k] != state:
            longest = min(longest, restart)
            continue
        ahead = closes - control if rate > 0.0 else opens - control
        if ahead * rate > 0.0 and state != (CLOSED if rate > 0.0 else OPEN):
            left, width = ahead / rate, closes - opens
            approach = min(max(LOCATED * width / abs(rate), least_known), shortest)
            step = (
                left + 0.5 * approach if left <= approach else max(APPROACH * left, 0.5 * approach)
            )
            longest = min(longest, step)
    return longest


@uncounted
def _derivatives(history, now, column):
    """A store's voltage or current, its rate in the last step, and |third derivative|."""
    points, times, _ = history
    a = points[now[0], column] - points[now[0], column + 1]
    b = points[now[1], column] - points[now[1], column + 1]
    c = points[now[2], column] - points[now[2], column + 1]
    d = points[now[3], column] - points[now[3], column + 1]
    t0, t1, t2, t3 = times[now[0]], times[now[1]], times[now[2]], times[now[3]]
    ab, bc, cd = (a - b) / (t0 - t1), (b - c) / (t1 - t2), (c - d) / (t2 - t3)
    change = (ab - bc) / (t0 - t2) - (bc - cd) / (t1 - t3)
    return a, ab, 6.0 * abs(change / (t0 - t3))
