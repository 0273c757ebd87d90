"""Realizations in lockstep: the compiled integrator for a resistor as load.

All take the same steps between the knots of their noise. In free flight one loop without branches
steps them, which LLVM vectorizes for eight at a time. Realizations in contact, and those about to
touch, are gathered and stepped in a separate loop with individual steps until they reach the end of
the common step.

    realization   |------- step -------|------- step -------|
         0        o--------------------o--------------------o    free flight: `_fly`
         1        o---------x··x··x··x-o--------------------o    contact at x: `_gather`, then
         2        o--------------------o--------------------o    `_try` and `_go_on` until it
         …                                                       is at the step's end: `_arrive`

Nothing is shared and no operation is reordered: a realization's numbers do not depend on its
neighbours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from harvester.base.compilation import merged, uncounted
from harvester.device import contact, system
from harvester.device.record import Record
from harvester.device.schemes import one_step
from harvester.device.system import System
from harvester.device.zones import crossing, overshoots
from harvester.statistics import several
from harvester.statistics.several import TOGETHER, Tally

# The number of points allowed if none are kept. No run reaches it.
MOST_POINTS = 2**62
# Offsets of the rows of eight numbers in a block. The first rows are the state at the beginning of
# a step, with the number of the zone, its ends, the contacts' force and the length of the step
# before. Realizations that are stepped apart also have the excitation and its slope, the time since
# the knot, the step, and the number of zones by which the mass moves at the step's end.
STATE_ROWS = 14
(
    DISPLACEMENT, VELOCITY, TRANSDUCER, HELD_SPEED, ZONE, LOW, HIGH, REACTION, PREVIOUS, NOISE,
    SLOPE, PHASE, LENGTH, ENTERS,
) = range(0, STATE_ROWS * TOGETHER, TOGETHER)  # fmt: skip
MOTION_ROWS = 3  # X, X' and the transducer's state
# The next rows belong to the end of the step: the motion, the contacts' force and damping
# (1/s), the excitation, and whether the step is rejected.
ROWS = STATE_ROWS + 7
END = STATE_ROWS * TOGETHER
END_REACTION, CONTACT_DAMPING, EXCITED, LEAVES = range(
    END + MOTION_ROWS * TOGETHER, ROWS * TOGETHER, TOGETHER
)


class BatchWorkspace(NamedTuple):
    """States of the realizations, and work arrays.

    Attributes
    ----------
    states, apart
        All realizations, and copies of realizations stepped apart; shape (blocks of eight,
        ROWS · 8).
    which
        Index of the realization in each slot of `apart`.
    points
        Number of points of each realization since its last reset.
    columns
        The points of the first realizations, as many as are kept; shape (kept, fields of
        `Record`, points).
    """

    states: np.ndarray
    apart: np.ndarray
    which: np.ndarray
    points: np.ndarray
    columns: np.ndarray

    @classmethod
    def of(
        cls, s: System, starts: Sequence[tuple[float, float, float]], keep: int, points: int
    ) -> BatchWorkspace:
        """Set up realizations, the first `keep` with memory for `points` points (at least 2).

        A start is (X, X', transducer's state).
        """
        blocks = math.ceil(len(starts) / TOGETHER)
        states = np.zeros((blocks, ROWS, TOGETHER))
        edges = contact.edges(s.contacts)
        for k in range(blocks * TOGETHER):
            state = states[k // TOGETHER, :, k % TOGETHER]
            # Slots after the last realization are padding: they repeat its start.
            x, v, transducer = starts[min(k, len(starts) - 1)]
            zone = sum(x > edge if edge > 0.0 else x >= edge for edge in edges[1:-1])
            held, ends = system.held_impact_speed(s, x, v), edges[zone : zone + 2]
            reaction = system.contact_force(s, x, v, held, *ends)
            state[: PREVIOUS // TOGETHER] = x, v, transducer, held, zone, *ends, reaction
        return cls(
            states=states.reshape(blocks, -1),
            apart=np.zeros((blocks, ROWS * TOGETHER)),
            which=np.zeros(blocks * TOGETHER, dtype=np.int64),
            points=np.zeros(len(starts), dtype=np.int64),
            columns=np.empty((keep, len(Record._fields), points)),
        )


@uncounted
def advance(
    scheme: bool | None,
    s: System,
    edges: np.ndarray,
    noise: np.ndarray,
    first_knot: int,
    spacing: float,
    steps_per_sample: int,
    steps_per_contact: int,
    room: BatchWorkspace,
    tally: Tally,
    place: np.ndarray,
) -> None:
    """Integrate until the noise ends or the memory for a realization's points is full.

    Parameters
    ----------
    scheme
        `argument` of a `harvester.device.schemes.Scheme`.
    edges : ndarray
        Edges of the zones, from minus to plus infinity (scaled displacement).
    noise : ndarray, shape (knots, blocks, 8)
        The excitation of all realizations at its knots, `spacing` (s) apart.
    first_knot : int
        Number of the first of these knots in the run.
    steps_per_sample, steps_per_contact : int
        Steps between two samples, and fewest from the beginning of a contact to its end.
    tally : Tally
        Sums for the moments, updated in place.
    place : ndarray of int, changed
        The segment between knots, the step in it, how many realizations are stepped apart in it,
        and the batch under way.
    """
    free = 1
    while edges[free] < 0.0:
        free += 1
    left, right = edges[free - 1], edges[free]
    step = spacing / steps_per_sample
    segment, part, waiting, batch = place[0], place[1], place[2], place[3]
    # A loop over a constant number would be unrolled instead of vectorized. A single realization
    # needs one lane.
    lanes = noise.shape[2] if room.points.size > 1 else 1
    fullest, full = 0, room.columns.shape[2] - 1 if room.columns.shape[0] > 0 else MOST_POINTS
    while segment < noise.shape[0] - 1 and fullest < full:
        knots = (noise[segment], noise[segment + 1], spacing)
        begin = (first_knot + segment) * spacing
        start, end = part * step, (part + 1) * step
        if waiting == 0:
            at_knot = part == steps_per_sample - 1
            now = several.batch_of(tally, begin + start, begin + end)
            if now != batch:
                several.end_batch(tally, batch)
                batch = now
            _fly(scheme, s, left, right, knots, start, end, at_knot, lanes, room.states)
            waiting = _gather(s, start, end, steps_per_contact, room)
        while waiting > 0 and fullest < full:
            _try(scheme, s, waiting, lanes, room.apart)
            waiting, fullest = _go_on(
                s, edges, knots, begin, end, step, steps_per_contact, waiting, batch, room, tally
            )
        if waiting > 0:
            break
        part += 1
        if part == steps_per_sample:
            segment, part = segment + 1, 0
            begin, end = (first_knot + segment) * spacing, 0.0
        fullest = _arrive(s, begin + end, batch, lanes, room, tally)
        if part == 0 and batch >= 0 and (first_knot + segment) % tally.every == 0:
            several.sample(tally, begin)
    if batch >= 0:
        several.end_batch(tally, batch)
    place[0], place[1], place[2], place[3] = segment, part, waiting, batch


@merged
def _excitation(knots, block, k, phase):
    """The excitation of a realization, and its slope, at a time after the earlier of two knots."""
    before, after, spacing = knots
    slope = (after[block, k] - before[block, k]) / spacing
    return before[block, k] + slope * phase, slope


@merged
def _fly(scheme, s, left, right, knots, start, end, at_knot, lanes, states):
    """Step all realizations as if all were in free flight between `left` and `right`.

    Here and in `_try` the loop's body has no branch, so that LLVM vectorizes it for eight
    realizations.
    """
    length = end - start
    for block in range(states.shape[0]):
        cells = states[block]
        for k in range(lanes):
            x, v, state = cells[DISPLACEMENT + k], cells[VELOCITY + k], cells[TRANSDUCER + k]
            noise, slope = _excitation(knots, block, k, start)
            cells[NOISE + k], cells[SLOPE + k] = noise, slope
            x1, v1, state1 = one_step(
                scheme, s, False, left, right, 0.0, x, v, state, noise, slope, length, 0.0
            )
            turned = (v * v1 < 0.0) & overshoots(left, right, x, v, x1, v1, length)
            touches = (cells[LOW + k] >= 0.0) | (cells[HIGH + k] <= 0.0)
            leaves = touches | (x1 > right) | (x1 < left) | turned
            cells[END + DISPLACEMENT + k], cells[END + VELOCITY + k] = x1, v1
            cells[END + TRANSDUCER + k], cells[CONTACT_DAMPING + k] = state1, 0.0
            cells[EXCITED + k] = knots[1][block, k] if at_knot else knots[0][block, k] + slope * end
            cells[LEAVES + k] = 1.0 if leaves else 0.0


@merged
def _try(scheme, s, count, lanes, apart):
    """Step the gathered realizations as if none left its zone.

    Blocks are stepped whole: results in slots without a realization are not used.
    """
    for block in range((count + TOGETHER - 1) // TOGETHER):
        cells = apart[block]
        for k in range(lanes if count > 1 else 1):
            x, v, state = cells[DISPLACEMENT + k], cells[VELOCITY + k], cells[TRANSDUCER + k]
            low, high, held = cells[LOW + k], cells[HIGH + k], cells[HELD_SPEED + k]
            noise, slope, length = cells[NOISE + k], cells[SLOPE + k], cells[LENGTH + k]
            x1, v1, state1 = one_step(
                scheme, s, True, low, high, held, x, v, state, noise, slope, length,
                cells[REACTION + k],
            )  # fmt: skip
            turned = (v * v1 < 0.0) & overshoots(low, high, x, v, x1, v1, length)
            push, damping = contact.reaction(s.contacts, s.spring, x1, v1, held, low, high)
            cells[END + DISPLACEMENT + k], cells[END + VELOCITY + k] = x1, v1
            cells[END + TRANSDUCER + k] = state1
            cells[END_REACTION + k], cells[CONTACT_DAMPING + k] = push + damping * v1, damping
            cells[LEAVES + k] = 1.0 if (x1 > high) | (x1 < low) | turned else 0.0


@merged
def _gather(s, start, end, steps_per_contact, room):
    """Gather the realizations that cannot take the free-flight step; returns their number.

    These are in contact, or would leave the free zone in this step.
    """
    count = 0
    for realization in range(room.points.size):
        block, k = realization // TOGETHER, realization % TOGETHER
        states = room.states[block]
        if states[LEAVES + k] == 0.0:
            continue
        room.which[count] = realization
        cells, i = room.apart[count // TOGETHER], count % TOGETHER
        for row in range(0, PHASE, TOGETHER):
            cells[row + i] = states[row + k]
        cells[PHASE + i], cells[LENGTH + i], cells[ENTERS + i] = start, end - start, 0.0
        if states[LOW + k] < 0.0 < states[HIGH + k]:
            cells[PREVIOUS + i] = end - start
            _land(cells, i, states[END + DISPLACEMENT + k], states[END + VELOCITY + k])
        else:
            _resolve(s, end, steps_per_contact, cells, i)
        count += 1
    return count


@merged
def _go_on(s, edges, knots, begin, end, step, steps_per_contact, count, batch, room, tally):
    """Accept the steps tried in `_try`, but shorten and repeat steps that leave their zone.

    Returns the number of realizations before the end of the grid's step, and the largest number of
    points of any of them.
    """
    remaining, fullest = 0, 0
    for slot in range(count):
        cells, i = room.apart[slot // TOGETHER], slot % TOGETHER
        if cells[LEAVES + i] != 0.0 and cells[ENTERS + i] == 0.0:
            _land(cells, i, cells[END + DISPLACEMENT + i], cells[END + VELOCITY + i])
        else:
            realization = room.which[slot]
            block, k = realization // TOGETHER, realization % TOGETHER
            rows = tally.rows[block]
            _correct(s, cells, i, cells[LENGTH + i], batch >= 0, rows, k)
            _take(s, edges, end, cells, i)
            if cells[PHASE + i] > end - 1e-9 * knots[2]:
                states = room.states[block]
                if cells[LOW + i] < 0.0 < cells[HIGH + i]:
                    cells[NOISE + i] = states[EXCITED + k]
                    _correct(s, cells, i, step, batch >= 0, rows, k)
                for row in range(0, NOISE, TOGETHER):
                    states[row + k] = cells[row + i]
                for row in range(END, END + MOTION_ROWS * TOGETHER, TOGETHER):
                    states[row + k] = cells[row + i]
                states[CONTACT_DAMPING + k] = cells[CONTACT_DAMPING + i]
                continue
            cells[NOISE + i], _ = _excitation(knots, block, k, cells[PHASE + i])
            time = begin + cells[PHASE + i]
            _point(s, cells, i, DISPLACEMENT, NOISE, time, batch >= 0, tally, rows, k)
            several.follow(tally, block, k, k + 1, batch)
            fullest = max(fullest, _keep(room, rows, realization))
            _resolve(s, end, steps_per_contact, cells, i)
        if remaining < slot:
            others, j = room.apart[remaining // TOGETHER], remaining % TOGETHER
            for row in range(0, END, TOGETHER):
                others[row + j] = cells[row + i]
            room.which[remaining] = room.which[slot]
        remaining += 1
    return remaining, fullest


@merged
def _land(cells, i, x1, v1):
    """Shorten a step that leaves its zone, tried up to (x1, v1), to end at the zone's edge."""
    x, v, low, high = cells[DISPLACEMENT + i], cells[VELOCITY + i], cells[LOW + i], cells[HIGH + i]
    upwards = x1 > high or (x1 >= low and v > 0.0)
    edge, direction = (high, 1) if upwards else (low, -1)
    cells[LENGTH + i] = crossing(edge, direction, x, v, x1, v1, cells[LENGTH + i])
    cells[ENTERS + i] = direction


@merged
def _take(s, edges, end, cells, i):
    """Accept a gathered realization's step: set its state, time and new zone."""
    longest = end - cells[PHASE + i]
    length = cells[LENGTH + i]
    cells[PHASE + i] = end if length >= longest else cells[PHASE + i] + length
    for row in range(0, MOTION_ROWS * TOGETHER, TOGETHER):
        cells[row + i] = cells[END + row + i]
    cells[REACTION + i] = cells[END_REACTION + i]
    if cells[ENTERS + i] != 0.0:
        if cells[LOW + i] < 0.0 < cells[HIGH + i]:
            cells[HELD_SPEED + i] = abs(cells[VELOCITY + i])
        cells[ZONE + i] += cells[ENTERS + i]
        zone = int(cells[ZONE + i])
        low, high = edges[zone], edges[zone + 1]
        x, v, held = cells[DISPLACEMENT + i], cells[VELOCITY + i], cells[HELD_SPEED + i]
        cells[LOW + i], cells[HIGH + i], cells[ENTERS + i] = low, high, 0.0
        cells[REACTION + i] = system.contact_force(s, x, v, held, low, high)


@merged
def _resolve(s, end, steps_per_contact, cells, i):
    """Choose a gathered realization's step: to the end, or short enough for a contact."""
    longest = end - cells[PHASE + i]
    cells[LENGTH + i] = longest
    if not cells[LOW + i] < 0.0 < cells[HIGH + i]:
        x, v, state = cells[DISPLACEMENT + i], cells[VELOCITY + i], cells[TRANSDUCER + i]
        # The other forces press a mass at rest into the stopper.
        speed = abs(v) + abs(system.push(s, x, v, state, cells[NOISE + i])) * longest
        length = contact.step(s.contacts, x, speed * speed, longest, steps_per_contact)
        if length < longest:
            # Steps of equal length: integrals by trapezoids are then most accurate.
            cells[LENGTH + i] = longest / np.ceil(longest / length)


@merged
def _powers(s, v, state, noise, contact_damping):
    """Voltage, load power, input power, loss and the transducer's own loss in one state."""
    damping = system.damping_rate(s.damper, v) + contact_damping
    current = system.load_current(s.transducer, v, state)
    transducer_loss = system.own_loss(s.transducer, v, state, current)
    put_in = noise * system.base_speed(s.transducer, v, state, current)
    voltage = system.terminal_voltage(s.transducer, v, state)
    load = system.load_power(s.transducer, v, state)
    return voltage, load, put_in, damping * v * v + transducer_loss, transducer_loss


@merged
def _point(s, cells, i, motion, excited, time, measured, tally, rows, k):
    """Add a point to a realization's sums.

    Its motion and its excitation begin at these rows of `cells`, in the slot `i`; `rows` and `k`
    locate the sums.
    """
    x, v = cells[motion + DISPLACEMENT + i], cells[motion + VELOCITY + i]
    state, noise = cells[motion + TRANSDUCER + i], cells[excited + i]
    values = _powers(s, v, state, noise, cells[CONTACT_DAMPING + i])
    stored_state = system.kept_state(s.transducer, state, noise)
    several.add_point(rows, k, measured, tally.low, tally.high, time, x, v, *values, stored_state)


@merged
def _correct(s, cells, i, length, measured, rows, k):
    """Correct the trapezoids' sums where the next step has another length than the last one.

    The trapezoids of equal steps h miss h²/12 times the change of the integrand's slope (Euler and
    Maclaurin). In steady motion this sums to 0, except where the length changes: at contacts. The
    slope is a central difference, exact for powers, which are quadratic in the state. The contact's
    own dissipation begins and ends with slope 0.
    """
    before = cells[PREVIOUS + i]
    cells[PREVIOUS + i] = length
    if length == before or not measured:
        return
    x, v, state = cells[DISPLACEMENT + i], cells[VELOCITY + i], cells[TRANSDUCER + i]
    noise, slope = cells[NOISE + i], cells[SLOPE + i]
    acceleration = system.push(s, x, v, state, noise) - cells[REACTION + i]
    rate = system.state_rate(s.transducer, v + system.base_rate(s.transducer, slope), state)
    longer = max(length, before)
    for ahead in (-longer, longer):
        x1, v1 = x + ahead * v, v + ahead * acceleration
        voltage, load, put_in, loss, transducer_loss = _powers(
            s, v1, state + ahead * rate, noise + ahead * slope, 0.0
        )
        weight = (length * length - before * before) / (24.0 * ahead)
        sums = (voltage * voltage, x1 * x1, v1 * v1, load, put_in, loss)
        for row in range(len(sums)):
            rows[several.SQUARE_VOLTAGES + row * TOGETHER + k] += weight * sums[row]
        rows[several.OWN_LOSSES + k] += weight * transducer_loss


@merged
def _keep(room, rows, realization):
    """Count a realization's latest point, and store it if it is to be kept; return the count."""
    k, point = realization % TOGETHER, room.points[realization]
    room.points[realization] = point + 1
    if realization >= room.columns.shape[0]:
        return 0
    for row in range(room.columns.shape[1]):
        room.columns[realization, row, point] = rows[row * TOGETHER + k]
    return point + 1


@merged
def _arrive(s, time, batch, lanes, room, tally):
    """Move all realizations to the step's end; return the largest number of points of any."""
    measured, fullest, count = batch >= 0, 0, room.points.size
    for block in range(room.states.shape[0]):
        cells, rows = room.states[block], tally.rows[block]
        for k in range(lanes):
            cells[DISPLACEMENT + k] = cells[END + DISPLACEMENT + k]
            cells[VELOCITY + k] = cells[END + VELOCITY + k]
            cells[TRANSDUCER + k] = cells[END + TRANSDUCER + k]
            _point(s, cells, k, END, EXCITED, time, measured, tally, rows, k)
        several.follow(tally, block, 0, min(TOGETHER, count - block * TOGETHER), batch)
    for realization in range(count):
        fullest = max(fullest, _keep(room, tally.rows[realization // TOGETHER], realization))
    return fullest
