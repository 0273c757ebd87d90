"""Compiled callbacks between ngspice and Python: noise, step sizes, solution.

ngspice calls these at every evaluation or step, so they are compiled C functions over one shared
structure. They call Python (`service`) only when a buffer is full or the window of noise must
advance, every thousand steps or so.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from llvmlite import ir

from circuits.equivalent.assembly import FIRST_ORDER_SHARE
from circuits.equivalent.elements import trapezoidal_prewarp_factor
from circuits.ngspice import load_steps
from harvester.base.compilation import (
    CACHED,
    address_of,
    carray,
    cfunc,
    cgutils,
    compiled,
    inlined,
    intrinsic,
    numba,
    types,
)
from harvester.device import spring as springs
from harvester.device import system as systems

if TYPE_CHECKING:
    from harvester.device.system import System

# Points that are collected before Python is called, and noise knots that are read ahead, over all
# copies.
BUFFERED_POINTS = 4096
BUFFERED_KNOTS = 65_536
# Fewest points and knots per copy, if there are many copies.
FEWEST_POINTS, FEWEST_KNOTS = 512, 1024
# Knots before the latest accepted time that remain in the window when it advances.
KNOTS_KEPT_BEHIND = 8
# Longest source name with ngspice's prefix, from which the copy's number is read. Names from
# `circuits.equivalent.elements` are shorter.
LONGEST_NAME = 64
# Last letter of the name of the source `elements.add_pace`.
CLOCK = ord("k")
# Columns of the buffer per copy, before the unknowns of the load's measures and the watched
# unknowns. Unused columns are 0.
COLUMNS = 9
DISPLACEMENT, VELOCITY, TERMINAL, NOISE, HELD_SPEED = range(5)
LOAD_CURRENT, OUTPUT, REFERENCE, TRANSDUCER = range(5, COLUMNS)

# Number of backward Euler steps with which ngspice begins, whatever the method. The following steps
# double up to the usual length, so that one of them damps each fast decay; with full steps
# immediately the trapezoidal rule would ring.
FIRST_ORDER_STEPS = 2
LENGTHENED_STEPS = FIRST_ORDER_STEPS + math.ceil(-math.log2(FIRST_ORDER_SHARE))

# A step proposed by ngspice is unchanged if more than this number of such steps remains to the next
# grid point: the step may end at a source's corner, which equal steps would only approach.
# Otherwise the remainder is divided into equal steps.
STEPS_TO_DIVIDE = 1.8
# A source's corner within this share of a grid step of a grid point is merged with it; ngspice
# merges corners of two sources at this distance.
MERGED = 5e-5
# The end of an interval in a load's plan, such as a jump, counts as reached within this share of a
# grid step.
LEAST_TO_END = 1e-9

# Reasons for a call of `service`.
BUFFER_FULL, WINDOW_ENDS, PLAN_ENDS = 0, 1, 2

STATE = np.dtype(
    [
        ("service", np.int64),  # address of a C function int (int reason)
        ("copies", np.int64),  # copies of the device in the netlist, each with separate noise
        ("points", np.int64),  # capacity of the buffer
        ("knots", np.int64),  # capacity of the window of noise
        ("time_vector", np.int64),  # index of the time in ngspice's vectors
        # Addresses of arrays:
        ("columns", np.int64),  # COLUMNS, measured and watched unknowns
        ("vectors", np.int64),  # int64 (copies, columns): index of each vector, or −1
        ("times", np.int64),  # float64 (points,)
        ("buffer", np.int64),  # float64 (copies, points, columns)
        ("window", np.int64),  # float64 (copies, knots): noise over ω²
        ("count", np.int64),  # points written
        ("steps", np.int64),
        ("spacing", np.float64),  # time between knots (s)
        ("first_knot", np.int64),  # index of the window's first knot
        ("steps_per_sample", np.int64),  # 0: ngspice chooses its steps
        ("steps_per_contact", np.int64),
        ("local_error", np.int64),  # whether ngspice's step is used if it is shorter
        ("system", np.int64),  # address of the numbers of a System
        ("free", np.float64, (2,)),  # limits of X without contact
        ("state_scale", np.float64),  # the transducer's scaled state per volt or ampere
        ("landing", np.float64),  # see `harvester.device.system.resolving_step`
        ("rate", np.float64),
        # Watched quantities of the load, see `circuits.ngspice.load_steps`. The last three are
        # addresses.
        ("first_watched", np.int64),  # index of the first watched column
        ("switch_count", np.int64),
        ("store_count", np.int64),
        ("switches", np.int64),
        ("stores", np.int64),
        ("memory", np.int64),  # float64 (copies, switches + 1)
        ("capacitance", np.float64),  # twice the energy per squared terminal voltage (F)
        ("least_energy", np.float64),  # twice the negligible energy (J)
        ("turn", np.float64),  # see `circuits.netlist.load_watch.Watch` (s)
        ("pace", np.float64),  # pre-warping factor of the motion's time
        ("line", np.float64),  # frequency of exact motion (rad/s); 0: none
        ("push", np.int64),  # address of float64 (copies,): latest acceleration
        ("slowed", np.float64),  # value of `_slowed` at the latest point
        ("owed", np.float64),  # remaining time correction (s)
        ("settling", np.float64),  # longest step after a knot (s); 0: no limit
        ("refinement", np.float64),  # divisor of the default step
        # The load's breakpoints: `circuits.netlist.source_schedule`. The last three `planned_…` are
        # addresses.
        ("planned_to", np.float64),  # end of the plan (s); infinite without one
        ("planned_count", np.int64),
        ("planned_place", np.int64),
        ("planned_ends", np.int64),
        ("planned_longest", np.int64),
        ("planned_jumps", np.int64),
        ("jumped", np.float64),  # time of the latest jump (s)
        ("jump_width", np.float64),  # duration of the latest jump (s)
    ],
    align=True,
)
_STATE = numba.from_dtype(STATE)
_pace_of = compiled(trapezoidal_prewarp_factor)


@intrinsic
def _pointer(typingctx, address):
    """Convert an address to a pointer."""

    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(types.int64), generate


@intrinsic
def _call(typingctx, address, reason):
    """Call the C function `int f(int)` at an address."""

    def generate(context, builder, signature, arguments):
        integer = ir.IntType(32)
        function = ir.FunctionType(integer, [integer])
        return builder.call(builder.inttoptr(arguments[0], function.as_pointer()), [arguments[1]])

    return types.int32(types.int64, types.int32), generate


@compiled
def _noise(state, copy, time):
    """Noise of one copy over ω² at `time`, linear between knots."""
    window = carray(_pointer(state.window), (state.copies, state.knots), np.float64)
    position = max(time / state.spacing - state.first_knot, 0.0)
    knot = min(int(position), state.knots - 2)
    share = position - knot
    return window[copy, knot] * (1.0 - share) + window[copy, knot + 1] * share


@compiled
def _fast(state, h):
    """Relative error, at a step of h, of the pre-warping for a grid step."""
    if h >= (1.0 - 1e-6) * state.spacing / state.steps_per_sample:
        return 0.0
    return 1.0 - _pace_of(state.line * h) / state.pace


@compiled
def _slowed(state, h):
    """Correction of the pre-warping at the end of a step of h.

    A step uses the mean of the corrections at its ends; the remainder is added to the next step.
    """
    return _fast(state, h) + state.owed * state.steps_per_sample / state.spacing


@compiled
def _slowing(state, copy, h, displaces):
    """Pre-warping source of a copy's displacement, or velocity, at the end of a step of h.

    Both are predicted for a motion at the frequency `line`. Correcting only one of both would add
    energy, since steps are short at one phase of the motion.
    """
    shape = (state.copies, state.points, state.columns)
    row = carray(_pointer(state.buffer), shape, np.float64)[copy, (state.count - 1) % state.points]
    push = carray(_pointer(state.push), state.copies, np.float64)[copy] / state.rate**2
    speed, ratio = row[VELOCITY], state.line / state.rate
    c, s = math.cos(state.line * h), math.sin(state.line * h)
    ahead = speed * c + push / ratio * s if displaces else push * c - speed * ratio * s
    return -_slowed(state, h) * ahead


@cfunc(types.int32(types.voidptr, types.int32, types.int32, types.CPointer(_STATE)), cache=CACHED)
def send_data(values: Any, count: int, identity: int, user: Any) -> int:
    """`SendData`: copy the saved nodes of an accepted point into the buffer.

    `values` is {int count, int index; vecvalues **vectors}, and a vecvalues {char *name;
    double real; …}.
    """
    state = carray(user, 1)[0]
    vectors = carray(_pointer(carray(values, 2, np.int64)[1]), count, np.int64)
    places = carray(_pointer(state.vectors), (state.copies, state.columns), np.int64)
    times = carray(_pointer(state.times), state.points, np.float64)
    shape = (state.copies, state.points, state.columns)
    buffer = carray(_pointer(state.buffer), shape, np.float64)
    row = state.count
    time = carray(_pointer(vectors[state.time_vector]), 2, np.float64)[1]
    times[row] = time
    for copy in range(state.copies):
        for column in range(state.columns):
            index = places[copy, column]
            if index >= 0:
                buffer[copy, row, column] = carray(_pointer(vectors[index]), 2, np.float64)[1]
        if places[copy, NOISE] < 0:
            buffer[copy, row, NOISE] = _noise(state, copy, time)
    if state.line > 0.0:
        h = time - times[(row - 1) % state.points]
        slowed = _slowed(state, h)
        state.owed += h * (_fast(state, h) - 0.5 * (state.slowed + slowed))
        state.slowed = slowed
    state.count = row + 1
    state.steps += 1
    if row + 1 == state.points:
        _call(state.service, np.int32(BUFFER_FULL))
        state.count = 0
    if time / state.spacing - state.first_knot > state.knots - KNOTS_KEPT_BEHIND:
        _call(state.service, np.int32(WINDOW_ENDS))
    return 0


@cfunc(
    types.int32(
        types.CPointer(types.double), types.double, types.voidptr, types.int32,
        types.CPointer(_STATE),
    ),
    cache=CACHED,
)  # fmt: skip
def get_noise(current: Any, time: float, name: Any, identity: int, user: Any) -> int:
    """`GetISRCData`: noise or pre-warping of the copy whose number is in the source's name."""
    state = carray(user, 1)[0]
    letters = carray(name, LONGEST_NAME, np.uint8)
    copy = character = 0
    while letters[character] != 0:
        if state.copies > 1 and 48 <= letters[character] <= 57:
            copy = 10 * copy + letters[character] - 48
        character += 1
    displaces = letters[character - 1] == CLOCK
    current[0] = 0.0 if displaces else _noise(state, copy, time) / state.pace
    if state.line > 0.0:
        times = carray(_pointer(state.times), state.points, np.float64)
        h = time - times[(state.count - 1) % state.points]
        current[0] += _slowing(state, copy, h, displaces)
    return 0


@intrinsic
def _state(typingctx, user):
    """Cast the pointer `user` to the shared structure, whatever device type it has."""

    def generate(context, builder, signature, arguments):
        kind = context.get_value_type(signature.return_type)
        return builder.bitcast(arguments[0], kind)

    return types.CPointer(_STATE)(user), generate


@intrinsic
def _device(typingctx, user, address):
    """Read the device from an address, as the type that `user` points to."""
    device_type = user.dtype

    def generate(context, builder, signature, arguments):
        pointer = builder.inttoptr(arguments[1], context.get_data_type(device_type).as_pointer())
        return context.unpack_value(builder, device_type, pointer)

    return device_type(user, types.int64), generate


@inlined
def _resolved(state, s, copy, row, ahead, step):
    """Longest step from an accepted point of one copy that resolves the contacts.

    `row` is the point's row of the buffer, `ahead` the noise at the next knot, `step` the grid
    step. Stores the acceleration.
    """
    x, v = row[DISPLACEMENT], row[VELOCITY] * state.rate
    electrical = row[TRANSDUCER] * state.state_scale
    noise, change = row[NOISE] * state.rate**2, (ahead - row[NOISE]) * state.rate**2
    acceleration = systems.push(s, x, v, electrical, noise)
    carray(_pointer(state.push), state.copies, np.float64)[copy] = acceleration
    stiffness = springs.greatest_stiffness(s.spring, x)
    stiffness += systems.transducer_stiffness(s.transducer, stiffness)
    margin = abs(change) + stiffness * abs(v) * step
    low, high = state.free[0], state.free[1]
    return systems.resolving_step(
        s, low, high, x, v, acceleration, margin, step, state.steps_per_contact, state.landing
    )


@compiled
def _load_step(state, copy, points, step, longest):
    """Longest step from an accepted point that resolves the load of a copy."""
    count, size = state.count, state.points
    times = carray(_pointer(state.times), size, np.float64)
    memory_shape = (state.copies, state.switch_count + 1)
    last = (count - 1) % size
    limits = load_steps.limits_of(step, state.refinement, state.store_count == 0)
    limits = load_steps.limits_of_turn(limits, state.turn)
    return load_steps.resolving_step(
        (points, times, state.first_watched),
        (last, (count - 2) % size, (count - 3) % size, (count - 4) % size),
        carray(_pointer(state.switches), (state.switch_count, 2), np.float64),
        carray(_pointer(state.stores), (state.store_count, 2), np.float64),
        carray(_pointer(state.memory), memory_shape, np.float64)[copy],
        state.least_energy + state.capacitance * points[last, TERMINAL] ** 2,
        state.rate / load_steps.MEMORY,
        load_steps.TOLERANCE / state.refinement**2,
        limits,
        longest,
    )


@inlined
def _shortest(state, s, ahead, step):
    """Longest step that resolves contacts and loads of all copies.

    `ahead` is the next knot's index in the window, `step` the grid step.
    """
    shape = (state.copies, state.points, state.columns)
    buffer = carray(_pointer(state.buffer), shape, np.float64)
    window = carray(_pointer(state.window), (state.copies, state.knots), np.float64)
    row = (state.count - 1) % state.points
    shortest = step
    for copy in range(state.copies):
        longest = _resolved(state, s, copy, buffer[copy, row], window[copy, ahead], step)
        if state.switch_count + state.store_count > 0 and state.steps >= load_steps.POINTS:
            longest = _load_step(state, copy, buffer[copy], step, longest)
        shortest = min(shortest, longest)
    return shortest


@inlined
def _planned(state, time, remaining, step):
    """Time until the next step end in the load's plan, and the longest step that the plan allows.

    After a jump steps double, starting from the jump's width, as after a switching event.
    """
    while time > state.planned_to - MERGED * step:
        _call(state.service, np.int32(PLAN_ENDS))
    count = state.planned_count
    if count == 0 and state.jump_width == 0.0:
        return remaining, np.inf
    ends = carray(_pointer(state.planned_ends), count, np.float64)
    widths = carray(_pointer(state.planned_longest), count, np.float64)
    jumps = carray(_pointer(state.planned_jumps), count, np.float64)
    interval = state.planned_place
    while interval < count and ends[interval] <= time + LEAST_TO_END * step:
        if jumps[interval] > 0.0:
            state.jumped, state.jump_width = ends[interval], widths[interval]
        interval += 1
    state.planned_place = interval
    longest = np.inf
    if state.jump_width > 0.0:
        longest = max(time - state.jumped, state.jump_width)
    if interval < count:
        longest = min(longest, widths[interval])
        remaining = min(remaining, ends[interval] - time)
    return remaining, longest


@compiled
def _set_step(time, delta, before, redo, identity, location, user):
    """Set the next step: it ends on the grid, or earlier near a contact.

    Location 0 is the start of a step, after the last point was accepted and sent. Under local-error
    control ngspice's proposal is used if it is shorter. After a rejected step (location 1)
    ngspice's shorter step is used.
    """
    state = carray(_state(user), 1)[0]
    if location != 0 or state.steps_per_sample == 0:
        return np.int32(0)
    step = state.spacing / state.steps_per_sample
    knot = np.floor(time / state.spacing + 1e-9)
    index = np.floor((time - knot * state.spacing) / step + 1e-6)
    remaining = knot * state.spacing + (index + 1.0) * step - time
    if state.settling > 0.0 and time - knot * state.spacing < MERGED * step:
        state.jumped, state.jump_width = knot * state.spacing, state.settling
    remaining, planned = _planned(state, time, remaining, step)
    longest = min(remaining, planned)
    if state.steps > 0:
        s = _device(user, state.system)
        longest = min(_shortest(state, s, int(knot) - state.first_knot + 1, step), planned)
    if state.steps < LENGTHENED_STEPS:
        doublings = max(state.steps - FIRST_ORDER_STEPS + 1, 0)
        longest = min(longest, FIRST_ORDER_SHARE * step * 2.0**doublings)
    if state.local_error and delta[0] < longest:
        longest = delta[0]
        if remaining > (1.0 - 1e-9) * step:
            longest = max(longest, MERGED * step)
        if remaining > STEPS_TO_DIVIDE * longest:
            delta[0] = longest
            return np.int32(0)
        if remaining - longest < MERGED * step:
            longest = remaining
    pieces = np.ceil(remaining / longest - 1e-6)
    delta[0] = remaining / max(pieces, 1.0)
    return np.int32(0)


def step_setter(system: System) -> int:
    """Address of the `GetSyncData` function for a device with these kinds of parts."""
    floats = types.float64, types.CPointer(types.float64), types.float64
    user = types.CPointer(numba.typeof(system))
    return address_of(_set_step, *floats, types.int32, types.int32, types.int32, user)
