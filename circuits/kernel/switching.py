"""Switches with hysteresis: switching times within a step, and errors of their controls."""

from __future__ import annotations

from typing import Any

from circuits.kernel.tables import Tables
from circuits.netlist.expression_graph import evaluate
from harvester.base.compilation import merged

# Tolerance of a switch's control, relative to its distance from the threshold plus its hysteresis.
# At 0.1, series SSHI missed voltage extremes (7 % of the mean square); at 0.01, ringing after a
# diode's breakdown was 20 % too large.
CONTROL_TOLERANCE = 0.001
# Tolerance of the charges and fluxes of a self-oscillating load, relative to their largest value:
# at five times this tolerance, the mean square of a relaxation oscillation was 0.6 % too large.
# Values below LEAST_OWN of the largest voltage or current are raised to it, so that rounding errors
# do not shorten steps.
OWN_TOLERANCE, LEAST_OWN = 2e-5, 1e-4


@merged
def _control(tables, state, k):
    """Control of a switch before and after the step."""
    n = state.y.size
    a, z = tables.switches[k, 2], tables.switches[k, 3]
    before = (state.y[a] if a < n else 0.0) - (state.y[z] if z < n else 0.0)
    change = (state.change[a] if a < n else 0.0) - (state.change[z] if z < n else 0.0)
    return before, before + change


@merged
def switched(tables: Tables, state: Any) -> tuple[int, float]:
    """The switch that toggles first within the step (−1: none), and the share before it."""
    first, least = -1, 2.0
    for k in range(state.closed.size):
        before, after = _control(tables, state, k)
        limit = tables.switch_values[k, 3 - state.closed[k]]
        passed = after > limit if state.closed[k] == 0 else after < limit
        if passed:
            share = (limit - before) / (after - before) if after != before else 0.0
            share = min(max(share, 0.0), 1.0)
            if share < least:
                first, least = k, share
    return first, least


@merged
def passed(tables: Tables, state: Any, time: float) -> tuple[bool, float]:
    """Whether a source jumps within a step that ends at `time`, and the share before it."""
    least = 2.0
    if tables.zero_crossings.size > 0:
        evaluate(tables.graph, state.values, state.latest, time)
    for k in range(tables.zero_crossings.size):
        before, after = state.passing[k], state.values[tables.zero_crossings[k]]
        if before * after < 0.0:
            least = min(least, before / (before - after))
    return least <= 1.0, least


@merged
def accept_passed(tables: Tables, state: Any) -> None:
    """Store the values at the step's end whose zero crossings make sources jump."""
    for k in range(tables.zero_crossings.size):
        state.passing[k] = state.values[tables.zero_crossings[k]]


@merged
def turn(tables: Tables, state: Any) -> None:
    """Toggle every switch whose control has crossed its threshold."""
    n = state.y.size
    for k in range(state.closed.size):
        a, z = tables.switches[k, 2], tables.switches[k, 3]
        control = (state.y[a] if a < n else 0.0) - (state.y[z] if z < n else 0.0)
        limit = tables.switch_values[k, 3 - state.closed[k]]
        if state.closed[k] == 0 and control > limit:
            state.closed[k] = 1
        elif state.closed[k] == 1 and control < limit:
            state.closed[k] = 0


@merged
def missed_self_oscillation(tables: Tables, state: Any) -> float:
    """Largest error of a self-oscillating load's charges and fluxes, over its tolerance.

    Such a load has a separate tolerance, since its energy may be a millionth of the device's
    energy.
    """
    sizes, greatest = (0.0, 0.0), 0.0
    for k in range(tables.own.shape[0]):
        size = state.largest[tables.own[k, 0]]
        if tables.own[k, 1] == 0:
            sizes = (max(sizes[0], size), sizes[1])
        else:
            sizes = (sizes[0], max(sizes[1], size))
    for k in range(tables.own.shape[0]):
        row = tables.own[k, 0]
        size = sizes[0] if tables.own[k, 1] == 0 else sizes[1]
        size = max(state.largest[row], LEAST_OWN * size)
        greatest = max(greatest, abs(state.filtered[row]) / (OWN_TOLERANCE * size))
    return greatest


@merged
def missed_controls(tables: Tables, state: Any) -> float:
    """Largest error of a switch's control, over its tolerance."""
    n = state.y.size
    greatest = 0.0
    for k in range(state.closed.size):
        a, z = tables.switches[k, 2], tables.switches[k, 3]
        error = (state.filtered[a] if a < n else 0.0) - (state.filtered[z] if z < n else 0.0)
        after = _control(tables, state, k)[1]
        low, high = tables.switch_values[k, 2], tables.switch_values[k, 3]
        limit = high if state.closed[k] == 0 else low
        free = abs(after - limit) + high - low + 1e-3 * abs(limit) + 1e-9
        greatest = max(greatest, abs(error) / (CONTROL_TOLERANCE * free))
    return greatest
