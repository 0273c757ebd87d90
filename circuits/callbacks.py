"""Compiled callbacks between ngspice and Python: noise in, steps set, solution out.

ngspice calls these at every evaluation or step, so they are compiled C functions over one
shared structure. They call back into Python (`service`) only when a buffer is full or the
window of noise must move on, some thousand steps apart.
"""

import numba
import numpy as np
from llvmlite import ir
from numba import carray, cfunc, types
from numba.core import cgutils
from numba.extending import intrinsic

from harvester import forces
from harvester.compilation import compiled
from harvester.parameters import ScaledParameters

# The trapezoidal rule loses too little energy in a contact: at 30 steps the mean-square velocity of
# motion inside a well came out 1 % high, and the error falls with the square of the step.
STEPS_PER_CONTACT = 60
BUFFER = 4096
WINDOW = 65_536
# Knots kept behind the latest accepted time when the window moves.
MARGIN = 8
# Columns of the buffer; those of a netlist as load are 0 without one.
TIME, DISPLACEMENT, VELOCITY, PIEZO, NOISE, HELD = range(6)
LOAD_CURRENT, OUTPUT, REFERENCE = range(6, 9)
COLUMNS = 9

BUFFER_FULL, WINDOW_ENDS = 0, 1

STATE = np.dtype(
    [
        ("service", np.int64),  # address of a C function int (int reason)
        ("vectors", np.int64, (COLUMNS,)),  # place of each column among ngspice's vectors, or −1
        ("count", np.int64),  # rows written
        ("steps", np.int64),
        ("spacing", np.float64),  # of the knots
        ("first_knot", np.int64),  # of the window
        ("steps_per_knot", np.int64),  # 0: ngspice chooses its steps
        ("local_error", np.int64),  # ngspice's proposal counts too, within the grid
        ("parameters", np.float64, (len(ScaledParameters._fields),)),
        ("rate", np.float64),
        ("voltage_scale", np.float64),
        ("buffer", np.float64, (BUFFER, COLUMNS)),
        ("window", np.float64, (WINDOW,)),
    ],
    align=True,
)
_STATE = numba.from_dtype(STATE)


@intrinsic
def _pointer(typingctx, address):
    """An address as a pointer."""

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


@cfunc(types.int32(types.voidptr, types.int32, types.int32, types.CPointer(_STATE)), cache=True)
def send_data(values, count, identity, user):
    """`SendData`: copy the saved nodes of an accepted point into the buffer.

    `values` is {int count, int index; vecvalues **vectors}, and a vecvalues {char *name;
    double real; …}.
    """
    state = carray(user, 1)[0]
    vectors = carray(_pointer(carray(values, 2, np.int64)[1]), count, np.int64)
    row = state.count
    for column in range(COLUMNS):
        place = state.vectors[column]
        value = 0.0
        if place >= 0:
            value = carray(_pointer(vectors[place]), 2, np.float64)[1]
        state.buffer[row, column] = value
    state.count = row + 1
    state.steps += 1
    if row + 1 == BUFFER:
        _call(state.service, np.int32(BUFFER_FULL))
        state.count = 0
    reached = state.buffer[row, TIME] / state.spacing - state.first_knot
    if reached > WINDOW - MARGIN:
        _call(state.service, np.int32(WINDOW_ENDS))
    return 0


@cfunc(
    types.int32(
        types.CPointer(types.double),
        types.double,
        types.voidptr,
        types.int32,
        types.CPointer(_STATE),
    ),
    cache=True,
)
def get_noise(voltage, time, name, identity, user):
    """`GetVSRCData`: the noise at a time, linear between knots."""
    state = carray(user, 1)[0]
    place = max(time / state.spacing - state.first_knot, 0.0)
    knot = min(int(place), WINDOW - 2)
    share = place - knot
    voltage[0] = state.window[knot] * (1.0 - share) + state.window[knot + 1] * share
    return 0


@compiled
def _resolved(state, row, ahead, step):
    """Longest step from an accepted point that resolves the contact; `ahead`: the next knot."""
    q = state.parameters
    p = ScaledParameters(q[0], q[1], q[2], q[3], q[4], q[5], False, q[7], q[8], q[9], q[10])
    x, v = row[DISPLACEMENT], row[VELOCITY] * state.rate
    noise, change = row[NOISE] * state.rate**2, (ahead - row[NOISE]) * state.rate**2
    acceleration = forces.push(p, x, v, row[PIEZO] / state.voltage_scale, noise)
    stiffness = abs(p.linear_stiffness) + 3.0 * p.cubic_stiffness * x * x + p.coupling
    margin = abs(change) + stiffness * abs(v) * step
    return forces.resolving_step(p, x, v, acceleration, margin, step, STEPS_PER_CONTACT)


@cfunc(
    types.int32(
        types.double,
        types.CPointer(types.double),
        types.double,
        types.int32,
        types.int32,
        types.int32,
        types.CPointer(_STATE),
    ),
    cache=True,
)
def set_step(time, delta, before, redo, identity, location, user):
    """`GetSyncData`: the next step ends on the grid, or short of it near a contact.

    Location 0 is the start of a step, after the last point was accepted and sent. Under
    local-error control ngspice's proposal is taken where it is shorter. After a rejected step
    (location 1) ngspice's own shorter one stands.
    """
    state = carray(user, 1)[0]
    if location != 0 or state.steps_per_knot == 0:
        return 0
    step = state.spacing / state.steps_per_knot
    knot = np.floor(time / state.spacing + 1e-9)
    index = np.floor((time - knot * state.spacing) / step + 1e-6)
    remaining = knot * state.spacing + (index + 1.0) * step - time
    longest = remaining
    if state.steps > 0:
        ahead = state.window[int(knot) - state.first_knot + 1]
        longest = _resolved(state, state.buffer[(state.count - 1) % BUFFER], ahead, step)
    if state.local_error:
        longest = min(longest, delta[0])
    pieces = np.ceil(remaining / longest - 1e-6)
    delta[0] = remaining / max(pieces, 1.0)
    return 0
