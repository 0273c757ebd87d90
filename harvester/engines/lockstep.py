"""Realizations in step with each other: the compiled integrator of a resistor as load.

All take the same steps between the knots of their noise. In free flight they do so in one loop
without branches, which LLVM turns into instructions for eight of them at a time. Those in contact,
and those that the flight would bring into one, are gathered and stepped apart in a loop of the same
kind, each with steps of its own, until they are at the step's end again.

Nothing is shared and no operation is reordered: a realization's numbers do not depend on what runs
beside it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from harvester.compilation import inlined, uncounted
from harvester.device import contact, system
from harvester.engines.schemes import one_step
from harvester.engines.zones import crossing, overshoots
from harvester.record.record import Record

if TYPE_CHECKING:
    from harvester.device.system import System

# Realizations that one instruction takes: numbers of double precision in the widest registers.
TOGETHER = 8
# From so many on, eight take no longer than these one after the other.
FEWEST_TOGETHER = 2

# Rows of the states at a step's beginning; the zone's number and its ends.
DISPLACEMENT, VELOCITY, TRANSDUCER, HELD_SPEED, ZONE, LOW, HIGH = range(7)
STATE_ROWS = 7
MOTION_ROWS = 3  # X, X' and the transducer's state
# Rows behind them of those stepped apart: excitation and its slope, the time since the knot, the
# step, and by how many zones the mass moves at its end.
NOISE, SLOPE, PHASE, LENGTH, ENTERS = range(7, 12)
APART_ROWS = 12
# Rows of a step's ends, behind X, X' and the transducer's state: the excitation, damping by
# contacts (1/s), and whether the flight does not hold.
CONTACT_DAMPING, LEAVES, EXCITED = 3, 4, 5
END_ROWS = 6
# Columns of a record under way that are still to be completed: they hold what is named here.
EXCITATION, DAMPING = Record._fields.index("input_power"), Record._fields.index("loss_power")
STATE = Record._fields.index("transducer_state")


class Room(NamedTuple):
    """Where the realizations are, and room to work in.

    Attributes
    ----------
    states : ndarray, shape (STATE_ROWS, realizations)
    ends : ndarray, shape (END_ROWS, realizations)
    apart, tried : ndarray, shape (APART_ROWS, ·) and (END_ROWS, ·)
        Those stepped apart, and where their steps end.
    which : ndarray of int64
        The realization that stands in each place of `apart`.
    columns : ndarray, shape (realizations, fields of `Record`, points)
    points : ndarray of int64, shape (realizations,)
        Points written of each.
    """

    states: np.ndarray
    ends: np.ndarray
    apart: np.ndarray
    tried: np.ndarray
    which: np.ndarray
    columns: np.ndarray
    points: np.ndarray

    @classmethod
    def of(cls, s: System, starts: Sequence[tuple[float, float, float]], points: int) -> Room:
        """Realizations at their starts (X, X', transducer's state), with room for so many points.

        Parameters
        ----------
        s : harvester.device.system.System
        starts : sequence of (float, float, float)
        points : int
            Of each realization, at least 2.
        """
        count = len(starts)
        whole = math.ceil(count / TOGETHER) * TOGETHER
        states = np.zeros((STATE_ROWS, count))
        states[: TRANSDUCER + 1] = np.transpose(starts)
        edges = contact.edges(s.contacts)
        for state in states.T:
            x = state[DISPLACEMENT]
            zone = sum(x > edge if edge > 0.0 else x >= edge for edge in edges[1:-1])
            state[HELD_SPEED] = system.speed_held(s, x, state[VELOCITY])
            state[ZONE], state[LOW], state[HIGH] = zone, edges[zone], edges[zone + 1]
        return cls(
            states=states,
            ends=np.zeros((END_ROWS, count)),
            apart=np.zeros((APART_ROWS, whole)),
            tried=np.zeros((END_ROWS, whole)),
            which=np.zeros(whole, dtype=np.int64),
            columns=np.empty((count, len(Record._fields), points)),
            points=np.zeros(count, dtype=np.int64),
        )


@uncounted
def advance(
    heun: bool | None,
    s: System,
    edges: np.ndarray,
    noise: np.ndarray,
    first_knot: int,
    spacing: float,
    steps_per_knot: int,
    steps_per_contact: int,
    room: Room,
    place: np.ndarray,
) -> None:
    """Integrate until the noise is at its end or a realization has no room for points.

    `heun` as in `harvester.engines.schemes.one_step`; `edges` are those of the zones; `noise` has
    a row for each knot, a column for each realization. `place`, changed, is the segment between
    knots, the step in it, and how many realizations are stepped apart in it.
    """
    free = np.searchsorted(edges, 0.0)
    left, right = edges[free - 1], edges[free]
    step = spacing / steps_per_knot
    segment, part, waiting = place[0], place[1], place[2]
    fullest, full = 0, room.columns.shape[2] - 1
    while segment < noise.shape[0] - 1 and fullest < full:
        knots = (noise[segment], noise[segment + 1], spacing)
        begin = (first_knot + segment) * spacing
        start, end = part * step, (part + 1) * step
        if waiting == 0:
            at_knot = part == steps_per_knot - 1
            _fly(heun, s, left, right, knots, start, end, at_knot, room.states, room.ends)
            waiting = _gather(s, knots, start, end, steps_per_contact, room)
        while waiting > 0 and fullest < full:
            _try(heun, s, left, right, waiting, room.apart, room.tried)
            waiting, fullest = _go_on(s, edges, knots, begin, end, steps_per_contact, waiting, room)
        if waiting > 0:
            break
        part += 1
        if part == steps_per_knot:
            segment, part = segment + 1, 0
            begin, end = (first_knot + segment) * spacing, 0.0
        fullest = _arrive(begin + end, room)
    place[0], place[1], place[2] = segment, part, waiting
    for k in range(room.points.size):
        _complete(s, room.columns[k], room.points[k])


@inlined
def _excitation(knots, k, phase):
    """The excitation of a realization and its slope, so long after the earlier of two knots."""
    before, after, spacing = knots
    slope = (after[k] - before[k]) / spacing
    return before[k] + slope * phase, slope


@uncounted
def _fly(heun, s, left, right, knots, start, end, at_knot, states, ends):
    """Step all realizations as if all flew freely between `left` and `right`.

    Here and in `_try` no condition ends a turn early: LLVM asks for it.
    """
    length = end - start
    for k in range(states.shape[1]):
        x, v, state = states[DISPLACEMENT, k], states[VELOCITY, k], states[TRANSDUCER, k]
        noise, slope = _excitation(knots, k, start)
        x1, v1, state1 = one_step(
            heun, s, False, left, right, 0.0, x, v, state, noise, slope, length
        )
        turned = (v * v1 < 0.0) & overshoots(left, right, x, v, x1, v1, length)
        touches = (states[LOW, k] >= 0.0) | (states[HIGH, k] <= 0.0)
        ends[DISPLACEMENT, k], ends[VELOCITY, k], ends[TRANSDUCER, k] = x1, v1, state1
        ends[CONTACT_DAMPING, k] = 0.0
        ends[EXCITED, k] = knots[1][k] if at_knot else knots[0][k] + slope * end
        ends[LEAVES, k] = 1.0 if touches | (x1 > right) | (x1 < left) | turned else 0.0


@uncounted
def _try(heun, s, left, right, count, apart, tried):
    """Step those apart as if none left its zone, and some places more that stand for nothing."""
    if count >= FEWEST_TOGETHER:
        count = (count + TOGETHER - 1) // TOGETHER * TOGETHER
    for i in range(count):
        x, v, state = apart[DISPLACEMENT, i], apart[VELOCITY, i], apart[TRANSDUCER, i]
        low, high, held = apart[LOW, i], apart[HIGH, i], apart[HELD_SPEED, i]
        noise, slope, length = apart[NOISE, i], apart[SLOPE, i], apart[LENGTH, i]
        x1, v1, state1 = one_step(heun, s, True, low, high, held, x, v, state, noise, slope, length)
        turned = (v * v1 < 0.0) & overshoots(low, high, x, v, x1, v1, length)
        tried[DISPLACEMENT, i], tried[VELOCITY, i], tried[TRANSDUCER, i] = x1, v1, state1
        damping = contact.loss_rate(s.contacts, s.spring, x1, v1, held)
        tried[CONTACT_DAMPING, i] = damping if (x1 < left) | (x1 > right) else 0.0
        tried[LEAVES, i] = 1.0 if (x1 > high) | (x1 < low) | turned else 0.0


@uncounted
def _gather(s, knots, start, end, steps_per_contact, room):
    """Put those for which the flight does not hold apart; returns how many."""
    states, ends, apart = room.states, room.ends, room.apart
    count = 0
    for k in range(states.shape[1]):
        if ends[LEAVES, k] == 0.0:
            continue
        room.which[count] = k
        for row in range(STATE_ROWS):
            apart[row, count] = states[row, k]
        apart[NOISE, count], apart[SLOPE, count] = _excitation(knots, k, start)
        apart[PHASE, count], apart[LENGTH, count], apart[ENTERS, count] = start, end - start, 0.0
        if states[LOW, k] < 0.0 < states[HIGH, k]:
            _land(apart, count, ends, k)
        else:
            _resolve(s, end, steps_per_contact, apart, count)
        count += 1
    return count


@uncounted
def _go_on(s, edges, knots, begin, end, steps_per_contact, count, room):
    """Take the steps tried apart, those that leave their zone again and shorter.

    Returns how many are not at the end yet, and the points of the realization with most.
    """
    apart, tried, columns, points = room.apart, room.tried, room.columns, room.points
    rest, fullest = 0, 0
    for i in range(count):
        if tried[LEAVES, i] != 0.0 and apart[ENTERS, i] == 0.0:
            _land(apart, i, tried, i)
        else:
            _take(edges, end, apart, tried, i)
            k, x, v = room.which[i], apart[DISPLACEMENT, i], apart[VELOCITY, i]
            damping = tried[CONTACT_DAMPING, i]
            if apart[PHASE, i] > end - 1e-9 * knots[2]:
                for row in range(STATE_ROWS):
                    room.states[row, k] = apart[row, i]
                for row in range(MOTION_ROWS):
                    room.ends[row, k] = apart[row, i]
                room.ends[CONTACT_DAMPING, k] = damping
                continue
            apart[NOISE, i], _ = _excitation(knots, k, apart[PHASE, i])
            time, noise = begin + apart[PHASE, i], apart[NOISE, i]
            _write(columns, points, k, time, x, v, apart[TRANSDUCER, i], damping, noise)
            fullest = max(fullest, points[k])
            _resolve(s, end, steps_per_contact, apart, i)
        if rest < i:
            for row in range(APART_ROWS):
                apart[row, rest] = apart[row, i]
            room.which[rest] = room.which[i]
        rest += 1
    return rest, fullest


@inlined
def _land(apart, i, tried, k):
    """Shorten a step that leaves its zone to where it does; the step tried ends in column `k`."""
    x, v, low, high = apart[DISPLACEMENT, i], apart[VELOCITY, i], apart[LOW, i], apart[HIGH, i]
    x1, v1 = tried[DISPLACEMENT, k], tried[VELOCITY, k]
    upwards = x1 > high or (x1 >= low and v > 0.0)
    edge, direction = (high, 1) if upwards else (low, -1)
    apart[LENGTH, i] = crossing(edge, direction, x, v, x1, v1, apart[LENGTH, i])
    apart[ENTERS, i] = direction


@inlined
def _take(edges, end, apart, tried, i):
    """Take a step apart: its state and time, and the zone into which it leads."""
    longest = end - apart[PHASE, i]
    apart[PHASE, i] = end if apart[LENGTH, i] >= longest else apart[PHASE, i] + apart[LENGTH, i]
    for row in range(MOTION_ROWS):
        apart[row, i] = tried[row, i]
    if apart[ENTERS, i] != 0.0:
        if apart[LOW, i] < 0.0 < apart[HIGH, i]:
            apart[HELD_SPEED, i] = abs(apart[VELOCITY, i])
        apart[ZONE, i] += apart[ENTERS, i]
        zone = int(apart[ZONE, i])
        apart[LOW, i], apart[HIGH, i] = edges[zone], edges[zone + 1]
        apart[ENTERS, i] = 0.0


@inlined
def _resolve(s, end, steps_per_contact, apart, i):
    """Choose the step apart: to the end, or in contact one that resolves it."""
    longest = end - apart[PHASE, i]
    apart[LENGTH, i] = longest
    if not apart[LOW, i] < 0.0 < apart[HIGH, i]:
        x, v, state = apart[DISPLACEMENT, i], apart[VELOCITY, i], apart[TRANSDUCER, i]
        # A mass at rest on the stopper is pressed in by what else acts.
        speed = abs(v) + abs(system.push(s, x, v, state, apart[NOISE, i])) * longest
        length = contact.step(s.contacts, x, speed * speed, longest, steps_per_contact)
        if length < longest:
            # Steps of one length, as integrals by trapezoids are best with.
            apart[LENGTH, i] = longest / np.ceil(longest / length)


@inlined
def _write(columns, points, k, time, x, v, state, damping, noise):
    """Write a realization's next point, to be completed."""
    place = points[k]
    columns[k, 0, place], columns[k, 1, place], columns[k, 2, place] = time, x, v
    columns[k, STATE, place], columns[k, DAMPING, place] = state, damping
    columns[k, EXCITATION, place] = noise
    points[k] = place + 1


@uncounted
def _arrive(time, room):
    """Let all realizations be at the step's end; returns the points of the one with most."""
    states, ends, fullest = room.states, room.ends, 0
    for k in range(states.shape[1]):
        x, v, state = ends[DISPLACEMENT, k], ends[VELOCITY, k], ends[TRANSDUCER, k]
        states[DISPLACEMENT, k], states[VELOCITY, k], states[TRANSDUCER, k] = x, v, state
        damping, noise = ends[CONTACT_DAMPING, k], ends[EXCITED, k]
        _write(room.columns, room.points, k, time, x, v, state, damping, noise)
        fullest = max(fullest, room.points[k])
    return fullest


@uncounted
def _complete(s, columns, count):
    """Turn what points hold into a `Record`'s columns."""
    for i in range(count):
        v, state, noise = columns[2, i], columns[STATE, i], columns[EXCITATION, i]
        damping = system.damping_rate(s.damper, v) + columns[DAMPING, i]
        current = system.load_current(s.transducer, v, state)
        own = system.own_loss(s.transducer, v, state, current)
        columns[3, i] = system.terminal_voltage(s.transducer, v, state)
        columns[4, i] = system.load_power(s.transducer, v, state)
        columns[EXCITATION, i] = noise * v
        columns[DAMPING, i] = damping * v * v + own
        columns[7, i] = own
