"""One implicit stage of a step: Newton's iterations on the circuit and the motion together.

Every stage solves for the change u of the unknowns y since the step's beginning in

    C u + q(y + u) − q(y) + δ [G (y + u) + i(y + u) − s] = r,

and for X = X₀ + δ X'. Changes are used, because next to a storage capacitor's charge a diode's
current would be lost by rounding.
"""

from __future__ import annotations

import enum
from collections import namedtuple
from typing import Any

import numpy as np

from circuits.kernel import waveform
from circuits.kernel.emitter import call
from circuits.kernel.mechanics import Device, evaluate
from circuits.kernel.memory import SLOTS, fresh_memory
from circuits.kernel.tables import Circuit, Tables
from circuits.netlist.expression_graph import evaluate as evaluate_graph
from circuits.netlist.expression_graph import slopes as graph_slopes
from harvester.base.compilation import compiled, merged

MOST_ITERATIONS = 40
# Newton's iterations end at a relative step below these: the next step would be about its square.
# The first applies to the velocity out of contact, where the force is smooth, relative to its
# largest value so far; the second to other unknowns, and in contact.
SMOOTH_STEP, RELATIVE_STEP = 1e-2, 1e-5
# Number of switches whose states fit exactly into a float64, as bits of an integer.
SWITCHES_PER_KEY = 52
# Relative change of displacement and velocity for difference quotients of the force.
DIFFERENCE = 1e-6


class Rates(enum.IntEnum):
    """Whether the rates of change at a step's beginning are known."""

    TURNED = -1  # A switch toggled: unknown, and the next step is backward Euler.
    UNKNOWN = 0
    KNOWN = 1


# The scalars of a state, in addition to its vectors.
SCALARS = np.dtype(
    [
        ("displacement", np.float64),  # X, scaled
        ("held_speed", np.float64),  # impact speed of the present contact, scaled
        ("zone", np.int64),  # index of the zone of X between contacts
        ("phase", np.float64),  # time since the last knot of the noise (s)
        ("proposed", np.float64),  # length of the next step (s)
        ("rates", np.int64),  # a member of `Rates`
        ("last_step", np.float64),  # s
        ("energy", np.float64),  # running mean of the squared terminal voltage (V²)
        ("switchings", np.int64),  # switching events within the present grid step
        ("time", np.float64),  # s
        ("mean_power", np.float64),  # power into the transducer in the step, scaled
        ("strictness", np.float64),  # divisor of the default error limit
        ("line", np.float64),  # frequency of exact motion (rad/s); 0: none
        ("timed_for", np.float64),  # length of step (s) of `pace` and `cancelled`
        ("pace", np.float64),  # see `circuits.kernel.prewarping`
        ("cancelled", np.float64),  # numerical damping of the method (1/s)
        ("crossing_time", np.float64),  # time constant of endlessly toggling switches (s)
        ("steps_taken", np.int64),  # steps since the latest check for chatter
        ("counted_from", np.float64),  # time of that check (s)
    ],
    align=True,
)


class State(
    namedtuple(
        "State",
        "code address slots stride motion core keys y rates largest change stored right error "
        "filtered solution iterated voltages before charges new_charges slopes sizes switches "
        "capacity conductance latest closed values shares jumps passing scalars",
    )
):
    """A realization of a circuit with n unknowns, m junctions: arrays changed in place.

    Attributes
    ----------
    code : addresses of the circuit's functions; `address` : address of its memory.
    slots, stride : index of the stored factors in the memory, and number of values per slot.
    keys : (SLOTS + 2, 1 + words) δ and switch states of each slot's factors; then the next and the
        latest slot; then the requested δ and states.
    motion : index of the velocity in `solution`; `core` (c,) indices of the core's unknowns.
    y … capacity, conductance : views of the memory, see `circuits.kernel.memory.Layout`.
    latest : (n + 1,) y + u of the last iteration, ground last.
    closed : (k,) int64, whether each switch is closed.
    values, shares : (k,) values of the expression graph, and derivatives of its result by them.
    jumps : (k, 3) for each behavioural source: value, largest magnitude, number of jumps.
    passing : (k,) values at the step's beginning whose zero crossings make sources jump.
    scalars : (1,) of `SCALARS`.
    """


def fresh_state(circuit: Circuit) -> State:
    """A state of a circuit, all zero. Its vectors are views of one block of memory, which
    they keep alive."""
    tables, order, at = circuit.tables, circuit.order, circuit.layout
    memory = fresh_memory(tables, at)
    n, m, k = tables.steady.size, len(tables.junctions), len(tables.graph)
    core = order.columns[order.linear :].copy()
    lengths = {
        **dict.fromkeys(("y", "rates", "largest", "change", "stored", "right"), n),
        **dict.fromkeys(("error", "filtered"), n),
        "solution": core.size + 1,
        **dict.fromkeys(("iterated", "voltages", "before", "charges", "new_charges"), m),
        "slopes": len(tables.inputs),
        "sizes": len(tables.behavioural),
        "switches": len(tables.switches),
        **dict.fromkeys(("capacity", "conductance"), len(tables.entries)),
    }
    views = (memory[getattr(at, name) :][:length] for name, length in lengths.items())
    state = State(
        circuit.code,
        memory.ctypes.data,
        at.slots,
        len(order.places),
        int(np.flatnonzero(core == n - 1)[0]),
        core,
        np.zeros((SLOTS + 2, 2 + len(tables.switches) // SWITCHES_PER_KEY)),
        **dict(zip(lengths, views, strict=True)),
        latest=np.zeros(n + 1),
        closed=tables.switches[:, 4].copy(),
        values=tables.graph_values.copy(),
        shares=np.zeros(k),
        jumps=np.zeros((len(tables.behavioural), 3)),
        passing=np.zeros(len(tables.zero_crossings)),
        scalars=np.zeros(1, SCALARS).view(np.recarray),
    )
    state.scalars[0].pace, state.scalars[0].crossing_time = 1.0, circuit.load.self_oscillation.turn
    return state


@merged
def _has_wanted_key(keys: np.ndarray, slot: int) -> bool:
    """Whether a slot's factors match the δ and switch states in the last row of the keys."""
    equal = True
    for k in range(keys.shape[1]):
        equal &= keys[slot, k] == keys[SLOTS + 1, k]
    return equal


@merged
def slot_of(tables: Tables, state: State, delta: float) -> int:
    """Memory index of the factors for a step's δ, computed if necessary."""
    keys, closed = state.keys, state.closed
    wanted = SLOTS + 1
    keys[wanted, 0] = delta
    for word in range(1, keys.shape[1]):
        key = 0.0
        for k in range((word - 1) * SWITCHES_PER_KEY, min(word * SWITCHES_PER_KEY, closed.size)):
            key = 2.0 * key + closed[k]
        keys[wanted, word] = key
    slot = int(keys[SLOTS, 1])
    if not _has_wanted_key(keys, slot):
        for k in range(closed.size):
            state.switches[k] = tables.switch_values[k, closed[k]]
        slot = 0
        # The slots form a ring buffer, searched from the latest.
        while slot < SLOTS and not _has_wanted_key(keys, slot):
            slot += 1
        if slot == SLOTS:
            slot = int(keys[SLOTS, 0])
            keys[SLOTS, 0] = (slot + 1) % SLOTS
            for word in range(keys.shape[1]):
                keys[slot, word] = keys[wanted, word]
            address = state.slots + slot * state.stride
            call(state.code.factor, state.address, address, delta, 0.0, 0.0)
        keys[SLOTS, 1] = slot
    return state.slots + slot * state.stride


@merged
def force(
    device: Device, touching: bool, low: float, high: float, held: float, x: float, v: float
) -> float:
    """Force of spring, damper and active contacts against the motion."""
    acts = 1.0 if touching else 0.0
    return evaluate(device.pull, device.numbers, (acts, low, high, held, x, v))


@compiled
def add_waves(
    sources: np.ndarray,
    waves: np.ndarray,
    corners: np.ndarray,
    right: np.ndarray,
    time: float,
    delta: float,
) -> None:
    """Add δ s of the time-varying sources to a right-hand side."""
    for k in range(sources.shape[0]):
        right[sources[k, 0]] += delta * waveform.value(sources[k, 1], waves[k], corners, time)


@compiled
def _linearise(rows, behavioural, inputs, values, shares, latest, y, slopes, sizes, time):
    """Linearise behavioural sources at the latest iterate, in terms of the change u."""
    evaluate_graph(rows, values, latest, time)
    position = 0
    for k in range(behavioural.shape[0]):
        first, last = behavioural[k, 2], behavioural[k, 3]
        graph_slopes(rows, values, shares, first, last)
        sizes[k] = values[last]
        while position < inputs.shape[0] and inputs[position, 0] == k:
            unknown = inputs[position, 2]
            slopes[position] = shares[inputs[position, 1]]
            sizes[k] += slopes[position] * (y[unknown] - latest[unknown])
            position += 1


@merged
def _near(state, only_motion, smooth):
    """Whether the core's unknowns changed little; stores the latest iterate."""
    settled = True
    for position in range(state.motion if only_motion else 0, state.core.size):
        unknown = state.core[position]
        moving = position == state.motion
        new = state.y[unknown] + state.solution[position]
        moved = abs(new - state.latest[unknown])
        # NaN counts as a large change, so that the iteration continues or fails.
        free = SMOOTH_STEP if smooth and moving else RELATIVE_STEP
        settled = settled and moved <= free * max(state.largest[unknown], abs(new))
        state.latest[unknown] = new
        if only_motion:
            break
    return settled


@merged
def solve_stage(
    device: Device,
    tables: Tables,
    state: State,
    slot: int,
    delta: float,
    time: float,
    x_base: float,
    zone: Any,
    row_unit: float,
) -> bool:
    """Run Newton's iterations of a stage; True if they converged.

    Parameters
    ----------
    device : circuits.kernel.mechanics.Device
    tables : circuits.kernel.tables.Tables
    state : State
        `latest` holds a guess of y + u (without behavioural sources of the velocity alone),
        `iterated` a guess of the junctions' voltages.
    slot : int
        Slot of the factors, from `slot_of`.
    delta, time : float
    x_base : float
        X₀ in X = X₀ + δ X'.
    zone : (bool, float, float, float)
        Whether contacts act, both ends of the zone, and the held impact speed.
    row_unit : float
        Unit of the velocity's row.
    """
    code, memory = state.code, state.address
    last = state.y.size - 1
    touching, low, high, held = zone
    way, cancelled = delta * state.scalars[0].pace, state.scalars[0].cancelled
    v = state.latest[last]
    pull = force(device, touching, low, high, held, x_base + way * v, v) + cancelled * v
    nearby = DIFFERENCE * state.largest[last]
    per_nearby = delta * row_unit / nearby
    slope = force(device, touching, low, high, held, x_base + way * (v + nearby), v + nearby)
    slope = (slope + cancelled * (v + nearby) - pull) * per_nearby
    behavioural = tables.behavioural.shape[0] > 0
    settled = False
    for _ in range(MOST_ITERATIONS):
        if behavioural:
            _linearise(
                tables.graph, tables.behavioural, tables.inputs, state.values, state.shares,
                state.latest, state.y, state.slopes, state.sizes, time,
            )  # fmt: skip
        push = slope * (v - state.y[last]) - delta * row_unit * pull
        settled = call(code.iterate, memory, slot, delta, push, slope) > 0.0
        settled &= _near(state, not behavioural, not touching)
        if settled:
            break
        v = state.latest[last]
        pull = force(device, touching, low, high, held, x_base + way * v, v) + cancelled * v
    return settled
