"""The device with its load, step by step: TR-BDF2, its error, switches and contacts.

TR-BDF2 (Bank et al. 1985, Hosea and Shampine 1996) is of second order, A- and L-stable, and both
its implicit stages have one matrix. It needs the rates of change at the step's beginning. If a
contact has just changed them, Alexander's SDIRK, of the same order and with the same matrix, is
used, as it does not need them. After a switching event there is one very short step of backward
Euler: a capacitor may then discharge through a diode immediately. A second stage would continue
this discharge by a factor of 1.4, and the diode would block the backflow of the excess.

    t             t + γh          t + h        γ = 2 − √2
    ├─ trapezoidal ─┤               │          first stage
    ├───────────── BDF2 ────────────┤          second stage; both have one matrix

`_find_step` shortens h for four reasons, in this order: Newton's iterations diverge, the estimated
error is too large, a contact begins or ends within the step, a switch or source jumps within it.
Otherwise the step is accepted (`_accept`), and its points are recorded.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from circuits.kernel import waveform
from circuits.kernel.emitter import call
from circuits.kernel.mechanics import Device, evaluate
from circuits.kernel.points import add_points, given_power, load_power, stored_energy
from circuits.kernel.prewarping import DIAGONAL, retime
from circuits.kernel.stage import Rates, State, add_waves, slot_of, solve_stage
from circuits.kernel.switching import (
    accept_passed,
    missed_controls,
    missed_self_oscillation,
    passed,
    switched,
    turn,
)
from circuits.kernel.tables import Probes, Tables
from harvester.base.compilation import compiled, merged, uncounted
from harvester.device.zones import crossing, overshoots

ROOT = np.sqrt(2.0)
# End of TR-BDF2's first stage, as a share of the step: the value for which both stages have the
# same matrix (Hosea and Shampine 1996).
STAGE = 2.0 - ROOT
# Weight of the first stage's change in the second stage: for TR-BDF2's backward difference, and for
# Alexander's SDIRK.
BACKWARD, ALEXANDER = 0.5 * (1.0 + ROOT), 1.0 + ROOT
# Largest error of a step: the root of the error's energy over the root of the transducer's energy.
# `State.strictness` makes it smaller on a finer grid of steps.
TOLERANCE = 1e-3
# Safety factor of the next step relative to the step with the allowed error, so that few steps are
# rejected. The error's square grows as the sixth power of the step: below GROWING the next step is
# not shorter than this one.
CAUTION = 0.9
GROWING = CAUTION**6
# Weights of a step's mean power in the method's quadrature: power at the step's beginning, first
# stage and end, for TR-BDF2 and for Alexander's SDIRK.
POWER_WEIGHTS = ((0.25 * ROOT, 0.25 * ROOT, DIAGONAL), (0.0, 1.0 - DIAGONAL, DIAGONAL))
# Shares of a grid step. RESTART: the first step after a switching event. LEAST_RESTART: after a
# switching event a step this short is accepted whatever its error. SHORTEST: a run that needs a
# shorter step ends as STUCK. LOCATED: accuracy of the time of a switching event.
RESTART, LEAST_RESTART, SHORTEST, LOCATED = 2.0**-10, 2.0**-14, 2.0**-34, 1e-4
# RESTART and LOCATED of a self-oscillating switch, in time constants of its control.
TURN_RESTART, TURN_LOCATED = 0.05, 0.01
# Accuracy of the time of a switching event, as a share of the step that contains the event.
LOCATED_SHARE = 0.02
# A corner of a source counts as reached within this share of a grid step plus this share of the
# time (rounding).
LEAST_TO_CORNER, CLOCK_ROUNDING = 1e-9, 1e-15
# A switch that toggles more often than this within a grid step chatters.
MOST_SWITCHINGS = 400
# Largest number of located source jumps within a grid step, since a source that toggles itself back
# would jump endlessly.
MOST_JUMPS = 20
# Grid steps over which the transducer's energy, the reference of errors, is averaged. The second
# number is the smallest reference voltage (in scaled volts), for a device at rest.
MEMORY, SMALL_VOLTAGE = 200.0, 1e-3

# A run stops if a source chatters: in COUNTED steps with a mean length below SLIDING_STEP grid
# steps, it jumps by half its largest value in more than JUMPING_SHARE of the steps. Smooth sources
# change little in a step; a step load without hysteresis has steps of 1e-8 grid steps and jumps in
# every fourth.
COUNTED, JUMPING_SHARE, SLIDING_STEP = 131072, 0.125, 1e-6

# Return values of `advance`: completed, or the reason why it cannot continue.
FINE, STUCK, CHATTER, SOURCE_CHATTER = range(4)


@uncounted
def advance(
    device: Device,
    tables: Tables,
    probes: Probes,
    state: State,
    edges: np.ndarray,
    block: np.ndarray,
    segment: int,
    count: int,
    first_knot: int,
    spacing: float,
    steps_per_sample: int,
    steps_per_contact: int,
    plan: Any,
    record: Any,
    output: np.ndarray,
) -> Any:
    """Integrate until the block of noise ends or the record is full.

    Parameters
    ----------
    device : Device
        The mechanics, as compiled functions and numbers.
    tables, probes : Tables, Probes
        The load's network, and the indices of the record's numbers in it.
    state : State
        The state, changed in place.
    edges : ndarray
        Edges of the contact zones (scaled displacement).
    block : ndarray
        The excitation at its knots.
    segment, count : int
        First segment of the block, and its number of segments.
    first_knot : int
        Number of the block's first knot in the run.
    spacing : float
        Between two knots (s).
    steps_per_sample, steps_per_contact : int
        Steps of the grid between two knots, and fewest in a contact.
    plan : circuits.netlist.source_schedule.Breakpoints
        Steps prescribed by the load's sources.
    record : Record
        Filled with the accepted points.
    output : ndarray, shape (1 + watched, points)
        Filled with the output's voltage (scaled) and the unknowns that are watched (V and A).

    Returns
    -------
    int, int, int, int
        Last segment, number of points written, reason of the end (FINE, STUCK, CHATTER,
        SOURCE_CHATTER), index of the chattering switch or behavioural source.
    """
    scalars = state.scalars[0]
    step = spacing / steps_per_sample
    capacity = record.time.size
    points = planned = 0
    middle = np.searchsorted(edges, 0.0)
    free = (edges[middle - 1], edges[middle])
    while segment < count and points + 1 < capacity:
        slope = (block[segment + 1] - block[segment]) / spacing
        phase = scalars.phase
        end = (np.floor(phase / step + 1e-9) + 1.0) * step
        noise = block[segment] + slope * phase
        time = (first_knot + segment) * spacing + phase
        zone_index, bend = scalars.zone, _until_corner(tables, time, step)
        planned, until, allowed, jumps = _planned(plan, planned, time, step)
        remaining = min(end - phase, bend, until)
        low, high = edges[zone_index], edges[zone_index + 1]
        zone = (not low < 0.0 < high, low, high, scalars.held_speed)
        longest = _longest(
            device, tables, state, zone, noise, remaining, step, steps_per_contact, allowed
        )
        h, x1, ratio, scale, entered, switch, leaps = _find_step(
            device, tables, probes, state, time, longest, remaining, step, noise, slope, zone
        )
        if h < 0.0:
            return segment, points, STUCK, 0
        before = (load_power(probes, state), stored_energy(device, probes, state))
        _accept(probes, state, h, x1, ratio, step)
        accept_passed(tables, state)
        if entered != 0:
            _enter(state, zone_index + entered, zone)
        if switch >= 0 and _turn(tables, state, step):
            return segment, points, CHATTER, switch
        if tables.behavioural.shape[0] > 0:
            source = _chattering(tables, state, time + h, step)
            if source >= 0:
                return segment, points, SOURCE_CHATTER, source
        if leaps:
            _restart(scalars, step)
        phase += h
        if h >= bend or (jumps and h >= until):
            # The next step restarts as after a switch, but no voltage jumps.
            scalars.proposed = RESTART * step
        if phase >= end * (1.0 - CLOCK_ROUNDING):
            phase = end
            scalars.switchings = 0
        noise = block[segment] + slope * phase
        if phase > spacing * (1.0 - 1e-9):
            phase = 0.0
            segment += 1
            noise = block[segment]
        scalars.phase = phase
        time = (first_knot + segment) * spacing + phase
        scalars.time = time
        points = add_points(
            device, probes, state, record, output, points, h, before, scale, time, noise, free
        )
    return segment, points, FINE, 0


@merged
def _until_corner(tables, time, step):
    """Time until the next corner of a source; corners within rounding are ignored."""
    past = time + LEAST_TO_CORNER * step + CLOCK_ROUNDING * abs(time)
    corner = np.inf
    for k in range(tables.sources.shape[0]):
        kind = tables.sources[k, 1]
        corner = min(corner, waveform.next_corner(kind, tables.waves[k], tables.corners, past))
    return corner - time


@merged
def _planned(plan, interval, time, step):
    """Locate a time in the load's plan of steps.

    Returns the interval's index, the time left to its end, the longest step that it allows, and
    whether the load jumps at that end.
    """
    past = time + LEAST_TO_CORNER * step + CLOCK_ROUNDING * abs(time)
    while interval < plan.ends.size and plan.ends[interval] <= past:
        interval += 1
    if interval == plan.ends.size:
        return interval, np.inf, np.inf, False
    return interval, plan.ends[interval] - time, plan.longest[interval], plan.jumps[interval] > 0.0


@merged
def _longest(device, tables, state, zone, noise, remaining, step, steps_per_contact, allowed):
    """Longest next step allowed by the last error, the sources and a contact."""
    longest = min(state.scalars[0].proposed, step, allowed)
    for k in range(tables.sources.shape[0]):
        longest = min(longest, waveform.longest_step(tables.sources[k, 1], tables.waves[k]))
    if zone[0]:
        x, v = state.scalars[0].displacement, state.y[state.y.size - 1]
        now = (x, v, noise, remaining, longest, float(steps_per_contact))
        longest = evaluate(device.contact_step, device.numbers, now)
    return longest


@merged
def _find_step(device, tables, probes, state, time, longest, remaining, step, noise, slope, zone):
    """A step that is short enough for its error, the end of its zone and the switches.

    Returns its length (−1: none), the new X, the square of its error over the tolerance, the
    reference energy, the number of zones crossed, the switch that toggles, and whether a source
    jumps.
    """
    scalars, last = state.scalars[0], state.y.size - 1
    x, v = scalars.displacement, state.y[last]
    h, least = _length(longest, remaining, step), SHORTEST * step
    located = min(LOCATED * step, TURN_LOCATED * scalars.crossing_time)
    width, switch, entered, leaps = -1.0, -1, 0, False
    x1, ratio, scale = x, 0.0, 0.0
    while True:
        if h < least:
            h = -1.0
            break
        settled, error, carried, x1, missed = _try_step(
            device, tables, probes, state, time, h, noise, slope, x, zone, located
        )
        if not settled:
            h *= 0.25
            scalars.proposed = h
            scalars.rates = Rates.UNKNOWN
            continue
        scale = probes.energy[0] * max(scalars.energy, (SMALL_VOLTAGE * probes.energy[1]) ** 2)
        if scalars.rates == Rates.TURNED:
            # The error of backward Euler: for an oscillation, half the square of the angle of a
            # step.
            error = 0.25 * carried * carried / scale if h > LEAST_RESTART * step else 0.0
        ratio = scalars.strictness * max(error / scale / TOLERANCE**2, missed * missed)
        if ratio > 1.0 and entered == 0:
            scalars.proposed = h * max(0.1, _growth(ratio))
            h = _length(scalars.proposed, remaining, step)
            continue
        if entered == 0:
            v1 = v + state.change[last]
            entered, share = _leaves(zone[1], zone[2], x, v, x1, v1, h)
            if entered != 0 and share < 1.0:
                h *= share
                continue
        switch, share = switched(tables, state)
        leaps, its = passed(tables, state, time + h)
        # A source that jumps back immediately is located only MOST_JUMPS times.
        leaps = leaps and scalars.switchings < MOST_JUMPS
        if (switch >= 0 or leaps) and width < 0.0:
            width = max(min(located, LOCATED_SHARE * h), 4.0 * least)
        if leaps and its <= share and h > 2.0 * width:
            # A short step crosses the jump: during a step a source has its final value.
            h = h * its - 0.5 * width if h * its > width else h * its + 0.5 * width
            entered = 0
            continue
        if switch >= 0 and h * (1.0 - share) > width:
            h = h * share + 0.5 * width
            entered = 0
            continue
        break
    return h, x1, ratio, scale, entered, switch, leaps


@merged
def _enter(state, place, zone):
    """Change the contact zone of the state; at the end of free flight store the impact speed."""
    scalars = state.scalars[0]
    scalars.zone = place
    scalars.rates = Rates.UNKNOWN
    if not zone[0]:
        scalars.held_speed = abs(state.y[state.y.size - 1])


@merged
def _turn(tables, state, step):
    """Toggle the switches whose controls have crossed their thresholds; True if they chatter."""
    scalars = state.scalars[0]
    turn(tables, state)
    _restart(scalars, step)
    return scalars.switchings > MOST_SWITCHINGS


@merged
def _chattering(tables, state, time, step):
    """Index of the behavioural source that chatters, or −1."""
    scalars, jumps = state.scalars[0], state.jumps
    worst = 0
    for k in range(jumps.shape[0]):
        value = state.values[tables.behavioural[k, 3]]
        if abs(value - jumps[k, 0]) > 0.5 * jumps[k, 1]:
            jumps[k, 2] += 1.0
        jumps[k, 0] = value
        jumps[k, 1] = max(jumps[k, 1], abs(value))
        if jumps[k, 2] > jumps[worst, 2]:
            worst = k
    scalars.steps_taken += 1
    if scalars.steps_taken < COUNTED:
        return -1
    short = time - scalars.counted_from < COUNTED * SLIDING_STEP * step
    suspect = worst if short and jumps[worst, 2] > COUNTED * JUMPING_SHARE else -1
    scalars.steps_taken, scalars.counted_from = 0, time
    jumps[:, 2] = 0.0
    return suspect


@merged
def _restart(scalars, step):
    """Restart after a switching event: with a short step and unknown rates of change."""
    scalars.switchings += 1
    scalars.rates = Rates.TURNED
    scalars.proposed = min(RESTART * step, TURN_RESTART * scalars.crossing_time)


@merged
def _growth(ratio):
    """Growth factor for the next step, from the square of the present error."""
    return CAUTION / np.cbrt(np.sqrt(ratio))


@compiled
def _length(longest, remaining, step):
    """The longest allowed step: the grid step divided by a power of 2, or the remainder.

    Matrices are factored per step length, and few are stored (`memory.SLOTS`).
    """
    if longest >= remaining * (1.0 - 1e-9):
        return remaining
    h = step
    while h > longest:
        h *= 0.5
    return min(h, remaining)


@merged
def _guess(tables, state, share):
    """Newton's first guess: the present unknowns plus a share of their latest change.

    Without behavioural sources only the velocity needs a guess.
    """
    n = state.y.size
    for i in range(0 if tables.behavioural.shape[0] > 0 else n - 1, n):
        state.latest[i] = state.y[i] + (share * state.change[i] if share > 0.0 else 0.0)


@merged
def _set_sources(tables, state, time, noise, delta):
    """Set the right-hand side to a stage's contributions of η and time-varying sources."""
    if tables.sources.shape[0] + tables.driven.shape[0] > 0:
        state.right[:] = 0.0
        add_waves(tables.sources, tables.waves, tables.corners, state.right, time, delta)
        for k in range(tables.driven.shape[0]):
            state.right[tables.driven[k]] += delta * tables.drives[k] * noise


@merged
def _try_step(device, tables, probes, state, time, h, noise, slope, x, zone, located):
    """Try a step of length h from the state; its change is stored in `state.change`.

    Returns
    -------
    bool, float, float, float, float
        Whether Newton's iterations converged, the energy of the step's error, the energy that a
        step of backward Euler moves from part to part (0 for other steps), the new X, and the error
        of the switches' controls over the tolerance.
    """
    y, scalars, code, memory = state.y, state.scalars[0], state.code, state.address
    n, row_unit = y.size, probes.units[4]
    rates_known, euler = scalars.rates == Rates.KNOWN, scalars.rates == Rates.TURNED
    delta = h if euler else DIAGONAL * h
    retime(tables, state, 0.0 if euler else h)
    pace = scalars.pace
    slot = slot_of(tables, state, delta)
    share, factor = (STAGE, BACKWARD) if rates_known else (DIAGONAL, ALEXANDER)
    if euler:
        share = 1.0
    last = scalars.last_step
    call(code.predict, memory, slot, share * h / last if last > 0.0 else 0.0, 0.0, 0.0)
    _guess(tables, state, 0.0)
    if rates_known:
        state.latest[n - 1] += STAGE * h * state.rates[n - 1] / row_unit
    base = x + (delta * pace * y[n - 1] if rates_known else 0.0)
    settled, error, carried, missed, moved, mean, power = True, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for stage in range(1 if euler else 2):
        ahead = share * h if stage == 0 else h
        excitation = noise + slope * ahead
        _set_sources(tables, state, time + ahead, excitation, delta)
        push = delta * row_unit / pace * excitation
        if stage == 0:
            call(code.begin, memory, slot, delta, delta if rates_known else 0.0, push)
        else:
            call(code.again, memory, slot, delta, factor, push)
        settled = solve_stage(
            device, tables, state, slot, delta, time + ahead, base, zone, row_unit
        )
        further = 1.0 / share - 1.0 if stage == 0 else 0.0
        call(code.finish, memory, slot, further, 0.0, 0.0)
        if not settled:
            break
        moved = base - x + delta * pace * (y[n - 1] + state.change[n - 1])
        power = given_power(device, probes, state, slope, 1.0)
        weights = POWER_WEIGHTS[0] if rates_known else POWER_WEIGHTS[1]
        if stage == 0:
            mean = weights[0] * given_power(device, probes, state, slope, 0.0) + weights[1] * power
            base = x + factor * moved
            _guess(tables, state, 1.0 / share)
    if settled:
        scalars.mean_power = power if euler else mean + DIAGONAL * power
        call(code.conclude, memory, slot, delta, 0.0 if euler else factor, h)
        if rates_known:
            error = call(code.error, memory, slot, 0.0, 0.0, 0.0)
            # Newton's residual limits the accuracy of a located switching event.
            if h >= located:
                missed = missed_controls(tables, state)
                if tables.own.shape[0] > 0:
                    missed = max(missed, missed_self_oscillation(tables, state))
        elif euler:
            for i in range(n - 1):
                carried += abs(state.stored[i] * state.change[i])
    return settled, error, carried, x + moved, missed


@compiled
def _leaves(low, high, x, v, x1, v1, h):
    """Neighbouring zone that a step enters (−1, 0, 1), and the share of the step before it."""
    entered = 0
    if x1 > high or x1 < low:
        entered = 1 if x1 > high else -1
    elif v * v1 < 0.0 and overshoots(low, high, x, v, x1, v1, h):
        entered = 1 if v > 0.0 else -1
    if entered == 0:
        return 0, 1.0
    edge = high if entered == 1 else low
    return entered, crossing(edge, entered, x, v, x1, v1, h) / h


@merged
def _accept(probes, state, h, x1, ratio, step):
    """Make the step's end the state, and propose the next step from the error."""
    scalars, y = state.scalars[0], state.y
    call(state.code.accept, state.address, state.slots, 0.0, 0.0, 0.0)
    scalars.displacement = x1
    scalars.last_step = h
    scalars.rates = Rates.KNOWN
    if ratio > GROWING or scalars.proposed < step:
        growth = min(_growth(ratio), 4.0)
        if growth >= 1.0:
            scalars.proposed = min(max(h * growth, scalars.proposed), step)
        else:
            scalars.proposed = h * growth
    square = y[probes.places[0]] ** 2
    scalars.energy += (square - scalars.energy) * min(h / (MEMORY * step), 1.0)
