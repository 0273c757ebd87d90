"""The device with its load, step by step: TR-BDF2, its error, switches and contacts.

TR-BDF2 (Bank et al. 1985, Hosea and Shampine 1996) is of second order, A- and L-stable, and both
its implicit stages have one matrix. It goes on from the rates of change at the step's beginning;
where a contact has just changed them, Alexander's SDIRK of the same order and matrix takes the
step, which asks for none. After a switch one very short step of backward Euler does: what then
discharges at once through a diode, which lets nothing back, would go on by 1.4 times as much in a
second stage.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from circuits.kernel.emitter import call
from circuits.kernel.stage import NUMBERS, State, add_waves, slot_of, solve_stage
from circuits.kernel.switching import missed_controls, switched, turn
from circuits.kernel.tables import Probes, Tables
from harvester.compilation import compiled, inlined, uncounted
from harvester.device import contact
from harvester.device import system as systems
from harvester.engines.zones import crossing, overshoots
from harvester.record.record import fill

ROOT = np.sqrt(2.0)
# δ over the step; the first stages' place in it.
DIAGONAL = 1.0 - 0.5 * ROOT
STAGE = 2.0 - ROOT
# Of the first stage's change in the second, for either method.
BACKWARD, ALEXANDER = 0.5 * (1.0 + ROOT), 1.0 + ROOT
# A step's error against the transducer's energy, both as roots; it and the switches' controls are
# known the better the finer the grid of steps is chosen (STRICTNESS).
TOLERANCE = 1e-3
# Share of the length that the error would allow; the square of a step's error against what it may
# be up to which the next is no shorter.
CAUTION = 0.9
GROWING = CAUTION**6
# Weights of power at the step's beginning and its stages in its mean, for either method.
POWER_WEIGHTS = ((0.25 * ROOT, 0.25 * ROOT, DIAGONAL), (0.0, 1.0 - DIAGONAL, DIAGONAL))
# Of the power at both ends, a difference of their mean from the step's that asks for a point more:
# at five times this, two tenths of a percent of SECE's energy was missing.
POWER_DIFFERENCE = 0.002
# Of the transducer's energy, what a step's mean power may miss without one.
LEAST_ENERGY = 1e-5
# What is known of the rates of change at a step's beginning: all, nothing, that a switch turned.
KNOWN, UNKNOWN, TURNED = 1.0, 0.0, -1.0
# After a switch, the first step against the usual one; the shortest; how well its time is known.
RESTART, SHORTEST, LOCATED = 2.0**-10, 2.0**-34, 1e-4
# Share of the step that led across within which the time is known, too.
LOCATED_SHARE = 0.02
# Switchings within one step of the grid that are no chatter.
MOST_SWITCHINGS = 400
# Time over which the transducer's energy is averaged, in steps of the grid, and the share of one
# scaled volt below which a voltage does not count.
MEMORY, SMALL_VOLTAGE = 200.0, 1e-3

# Places among the numbers of a state.
(
    DISPLACEMENT, HELD_SPEED, ZONE, PHASE, PROPOSED, RATES_KNOWN, LAST_STEP, ENERGY, SWITCHINGS,
    TIME, MEAN_POWER, STRICTNESS,
) = range(NUMBERS)  # fmt: skip
FINE, STUCK, CHATTER = range(3)


@uncounted
def advance(
    s: Any,
    tables: Tables,
    probes: Probes,
    state: State,
    edges: np.ndarray,
    block: np.ndarray,
    segment: int,
    count: int,
    first_knot: int,
    spacing: float,
    steps_per_knot: int,
    steps_per_contact: int,
    record: Any,
    output: np.ndarray,
) -> Any:
    """Fill record and output from a segment of the noise on.

    The output's rows are its voltage (scaled) and the unknowns watched (V and A).

    Returns the segment reached, the points written, and FINE, STUCK or CHATTER with the switch.
    """
    numbers, y = state.numbers, state.y
    n = y.size
    step = spacing / steps_per_knot
    row_unit = probes.units[4]
    capacity = record.time.size
    points = 0
    free = np.searchsorted(edges, 0.0)
    left, right = edges[free - 1], edges[free]
    while segment < count and points + 1 < capacity:
        slope = (block[segment + 1] - block[segment]) / spacing
        phase = numbers[PHASE]
        end = (np.floor(phase / step + 1e-9) + 1.0) * step
        noise = block[segment] + slope * phase
        time = (first_knot + segment) * spacing + phase
        place = int(numbers[ZONE])
        low, high = edges[place], edges[place + 1]
        touching = not low < 0.0 < high
        x, v = numbers[DISPLACEMENT], y[n - 1]
        remaining = end - phase
        longest = min(numbers[PROPOSED], step)
        if touching:
            push = noise - systems.part_force(s.damper, v)
            speed = abs(v) + abs(push) * remaining
            longest = contact.step(s.contacts, x, speed * speed, longest, steps_per_contact)
        h = _length(longest, remaining, step)
        least = SHORTEST * step
        found, switch, entered = -1.0, -1, 0
        while True:
            if h < least:
                return segment, points, STUCK, 0
            settled, error, x1, missed = _try_step(
                s, tables, probes, state, time, h, noise, slope, x,
                (touching, low, high, numbers[HELD_SPEED]), row_unit,
            )  # fmt: skip
            if not settled:
                h *= 0.25
                numbers[PROPOSED] = h
                numbers[RATES_KNOWN] = UNKNOWN
                continue
            scale = probes.energy[0] * max(numbers[ENERGY], (SMALL_VOLTAGE * probes.energy[1]) ** 2)
            if h < LOCATED * step:  # No turning is located better; what is left is Newton's rest.
                missed = 0.0
            ratio = numbers[STRICTNESS] * max(error / scale / TOLERANCE**2, missed * missed)
            if ratio > 1.0 and entered == 0:
                numbers[PROPOSED] = h * max(0.1, _growth(ratio))
                h = _length(numbers[PROPOSED], remaining, step)
                continue
            v1 = y[n - 1] + state.change[n - 1]
            if entered == 0:
                entered, share = _leaves(low, high, x, v, x1, v1, h)
                if entered != 0 and share < 1.0:
                    h *= share
                    continue
            switch, share = switched(tables, state)
            if switch >= 0 and found < 0.0:
                found = max(min(LOCATED * step, LOCATED_SHARE * h), 4.0 * least)
            if switch >= 0 and h * (1.0 - share) > found:
                h = h * share + 0.5 * found
                entered = 0
                continue
            break
        power, stored = _load_power(probes, state), _stored(s, probes, state)
        _accept(probes, state, h, x1, ratio, step)
        if entered != 0:
            numbers[ZONE] = place + entered
            numbers[RATES_KNOWN] = UNKNOWN
            if not touching:
                numbers[HELD_SPEED] = abs(y[n - 1])
        if switch >= 0:
            numbers[SWITCHINGS] += 1.0
            if numbers[SWITCHINGS] > MOST_SWITCHINGS:
                return segment, points, CHATTER, switch
            turn(tables, state)
            numbers[RATES_KNOWN] = TURNED
            numbers[PROPOSED] = RESTART * step
        if h >= remaining:
            phase = end
            numbers[SWITCHINGS] = 0.0
        else:
            phase += h
        noise = block[segment] + slope * phase
        if phase > spacing * (1.0 - 1e-9):
            phase = 0.0
            segment += 1
            noise = block[segment]
        numbers[PHASE] = phase
        time = (first_knot + segment) * spacing + phase
        numbers[TIME] = time
        last = _load_power(probes, state)
        mean = numbers[MEAN_POWER] - (_stored(s, probes, state) - stored) / h
        missing = abs(2.0 * mean - power - last)
        counts = missing * h > LEAST_ENERGY * probes.units[3] * scale
        if points > 0 and counts and missing > POWER_DIFFERENCE * (abs(power) + abs(last)):
            # A current that jumped at the step's beginning: the point before it once more, with
            # the power that makes the mean of both ends the step's.
            _again(record, output, points, 2.0 * mean - last)
            points += 1
        _write(s, probes, state, record, output, points, time, noise, left, right)
        points += 1
    return segment, points, FINE, 0


@inlined
def _growth(ratio):
    """By how much the next step may be longer, from the square of this one's error."""
    return CAUTION / np.cbrt(np.sqrt(ratio))


@compiled
def _length(longest, remaining, step):
    """A whole division of the grid's step by a power of 2, or what remains of it."""
    if longest >= remaining * (1.0 - 1e-9):
        return remaining
    h = step
    while h > longest:
        h *= 0.5
    return min(h, remaining)


@inlined
def _try_step(s, tables, probes, state, time, h, noise, slope, x, zone, row_unit):
    """A step of length h from the state.

    Returns whether Newton settled, its error's energy, the new X, and the error of the switches'
    controls against what they may have. Its change stands in `state.change`.
    """
    y, numbers, code, memory = state.y, state.numbers, state.code, state.address
    n = y.size
    known, euler = numbers[RATES_KNOWN] == KNOWN, numbers[RATES_KNOWN] == TURNED
    delta = h if euler else DIAGONAL * h
    slot = slot_of(tables, state, delta)
    share, factor = (STAGE, BACKWARD) if known else (DIAGONAL, ALEXANDER)
    if euler:
        share = 1.0
    last = numbers[LAST_STEP]
    call(code.predict, memory, slot, share * h / last if last > 0.0 else 0.0, 0.0, 0.0)
    behavioural = tables.behavioural.shape[0] > 0
    if behavioural:
        for i in range(n):
            state.latest[i] = y[i]
    state.latest[n - 1] = y[n - 1]
    if known:
        state.latest[n - 1] += STAGE * h * state.rates[n - 1] / row_unit
    base = x + (delta * y[n - 1] if known else 0.0)
    settled, error, missed, moved, mean, power = True, 0.0, 0.0, 0.0, 0.0, 0.0
    for stage in range(1 if euler else 2):
        ahead = share * h if stage == 0 else h
        if tables.sources.shape[0] > 0:
            state.right[:] = 0.0
            add_waves(
                tables.sources, tables.waves, tables.corners, state.right, time + ahead, delta
            )
        push = delta * row_unit * (noise + slope * ahead)
        if stage == 0:
            call(code.begin, memory, slot, delta, delta if known else 0.0, push)
        else:
            call(code.again, memory, slot, delta, factor, push)
        settled = solve_stage(s, tables, state, slot, delta, time + ahead, base, zone, row_unit)
        further = 1.0 / share - 1.0 if stage == 0 else 0.0
        call(code.finish, memory, slot, further, 0.0, 0.0)
        if not settled:
            break
        moved = base - x + delta * (y[n - 1] + state.change[n - 1])
        power = _given_power(s, probes, state, 1.0)
        weights = POWER_WEIGHTS[0] if known else POWER_WEIGHTS[1]
        if stage == 0:
            mean = weights[0] * _given_power(s, probes, state, 0.0) + weights[1] * power
            base = x + factor * moved
            if behavioural:
                for i in range(n):
                    state.latest[i] = y[i] + state.change[i] / share
            state.latest[n - 1] = y[n - 1] + state.change[n - 1] / share
    if settled:
        numbers[MEAN_POWER] = power if euler else mean + DIAGONAL * power
        call(code.conclude, memory, slot, delta, 0.0 if euler else factor, h)
        if known:
            error = call(code.error, memory, slot, 0.0, 0.0, 0.0)
            missed = missed_controls(tables, state)
    return settled, error, x + moved, missed


@inlined
def _load_power(probes, state):
    """Voltage times current at the terminals, scaled."""
    y = state.y
    return y[probes.places[0]] * y[probes.places[1]] * probes.units[3]


@inlined
def _stored(s, probes, state):
    """The transducer's energy, scaled; 0 where it keeps none."""
    place = probes.places[2]
    if place < 0:
        return 0.0
    return systems.transducer_energy(s.transducer, state.y[place] * probes.units[1])


@inlined
def _given_power(s, probes, state, share):
    """What the mass gives the transducer beyond its own loss, a share of the change ahead (scaled).

    Less what the transducer stores it is the load's power, also over a step in which a pulse
    empties it: the motion is smooth there, voltage times current is not.
    """
    y, change, places, units = state.y, state.change, probes.places, probes.units
    branch, place = places[1], places[2]
    amperes = y[branch] + share * change[branch]
    if place < 0:
        return (y[places[0]] + share * change[places[0]]) * amperes * units[3]
    v = y[y.size - 1] + share * change[y.size - 1]
    electrical = (y[place] + share * change[place]) * units[1]
    own = systems.own_loss(s.transducer, v, electrical, amperes * units[2])
    return systems.part_force(s.transducer, v, electrical) * v - own


@compiled
def _leaves(low, high, x, v, x1, v1, h):
    """By how many zones a step leads, −1, 0 or 1, and the share of it at which it does."""
    entered = 0
    if x1 > high or x1 < low:
        entered = 1 if x1 > high else -1
    elif v * v1 < 0.0 and overshoots(low, high, x, v, x1, v1, h):
        entered = 1 if v > 0.0 else -1
    if entered == 0:
        return 0, 1.0
    edge = high if entered == 1 else low
    return entered, crossing(edge, entered, x, v, x1, v1, h) / h


@inlined
def _accept(probes, state, h, x1, ratio, step):
    """The step's end becomes the state; the next step follows its error."""
    numbers, y = state.numbers, state.y
    call(state.code.accept, state.address, state.slots, 0.0, 0.0, 0.0)
    numbers[DISPLACEMENT] = x1
    numbers[LAST_STEP] = h
    numbers[RATES_KNOWN] = KNOWN
    if ratio > GROWING or numbers[PROPOSED] < step:
        growth = min(_growth(ratio), 4.0)
        if growth >= 1.0:
            numbers[PROPOSED] = min(max(h * growth, numbers[PROPOSED]), step)
        else:
            numbers[PROPOSED] = h * growth
    square = y[probes.places[0]] ** 2
    numbers[ENERGY] += (square - numbers[ENERGY]) * min(h / (MEMORY * step), 1.0)


@compiled
def _again(record, output, point, power):
    """The last point of a record once more, with another power into the load."""
    for column in record:
        column[point] = column[point - 1]
    record.load_power[point] = power
    for row in output:
        row[point] = row[point - 1]


@inlined
def _write(s, probes, state, record, output, point, time, noise, left, right):
    """One point of the record."""
    numbers, y = state.numbers, state.y
    n = y.size
    places, units = probes.places, probes.units
    x, v = numbers[DISPLACEMENT], y[n - 1]
    volts, amperes = y[places[0]], y[places[1]]
    electrical = y[places[2]] * units[1] if places[2] >= 0 else 0.0
    loss = systems.loss_power(s, x, v, numbers[HELD_SPEED], x < left or x > right)
    own = systems.own_loss(s.transducer, v, electrical, amperes * units[2])
    power = volts * amperes * units[3]
    fill(record, point, time, x, v, volts * units[0], power, noise * v, loss, own, electrical)
    output[0, point] = (y[places[3]] - y[places[4]]) * units[0]
    for k in range(1, output.shape[0]):
        output[k, point] = y[places[4 + k]]
