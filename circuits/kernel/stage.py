"""One implicit stage of a step: Newton's iterations on the circuit and the motion together.

Every stage asks for the change u of the unknowns y since the step's beginning in

    C u + q(y + u) − q(y) + δ [G (y + u) + i(y + u) − s] = r,

and for X = X₀ + δ X'. In changes, because a storage capacitor's charge would round a diode's
current away.
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
# The iterations end at a relative Newton step below these; the next step would be about its square.
# The first applies to the velocity out of contact, where the force is smooth, relative to the
# greatest so far. The second applies to other unknowns, and in contact.
SMOOTH_STEP, RELATIVE_STEP = 1e-2, 1e-5
# A float64 holds the states of this many switches exactly, as the bits of an integer.
SWITCHES_PER_KEY = 52
# Relative change of displacement and velocity by which slopes of the force are computed.
DIFFERENCE = 1e-6


class Rates(enum.IntEnum):
    """Whether the rates of change at a step's beginning are known."""

    TURNED = -1  # A switch turned: nothing, and the first step is backward Euler's.
    UNKNOWN = 0
    KNOWN = 1


# The scalars of a state, in addition to its vectors.
SCALARS = np.dtype(
    [
        ("displacement", np.float64),  # X, scaled
        ("held_speed", np.float64),  # impact speed of the contact under way, scaled
        ("zone", np.int64),  # between which contacts X is
        ("phase", np.float64),  # time since the last knot of the noise (s)
        ("proposed", np.float64),  # length of the next step (s)
        ("rates", np.int64),  # a member of `Rates`
        ("last_step", np.float64),  # s
        ("energy", np.float64),  # running mean of the square terminal voltage (V²)
        ("switchings", np.int64),  # within the present step of the grid
        ("time", np.float64),  # s
        ("mean_power", np.float64),  # given to the transducer in the step, scaled
        ("strictness", np.float64),  # by how much less error is asked for than by default
        ("line", np.float64),  # frequency at which the motion is to be exact (rad/s), or 0
        ("timed_for", np.float64),  # length of step (s) for which the next two hold
        ("pace", np.float64),  # see `circuits.kernel.prewarping`
        ("cancelled", np.float64),  # damping that the method adds by itself (1/s)
        ("crossing_time", np.float64),  # time constant of switches that turn by themselves (s)
        ("steps_taken", np.int64),  # since chatter was last looked for
        ("counted_from", np.float64),  # when that was (s)
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
    slots, stride : index in it of the stored factors, and number of values of each.
    keys : (SLOTS + 2, 1 + words) the step's δ and the switches' states that the factors of each
        slot are for; then the next slot and the last; then the δ and states that are looked for.
    motion : index of the velocity in `solution`; `core` (c,) the unknowns there.
    y … capacity, conductance : views of the memory, see `circuits.kernel.memory.Layout`.
    latest : (n + 1,) y + u of the last iteration, ground last.
    closed : (k,) int64, of the switches.
    values, shares : (k,) of the expression graph.
    jumps : (k, 3) of each behavioural source: its value, its greatest size, how often it jumped.
    passing : (k,) quantities that pass 0 when a source jumps, at the step's beginning.
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
    """Whether a slot's factors are for the δ and the switches in the last row of the keys."""
    equal = True
    for k in range(keys.shape[1]):
        equal &= keys[slot, k] == keys[SLOTS + 1, k]
    return equal


@merged
def slot_of(tables: Tables, state: State, delta: float) -> int:
    """Memory index of the factors for a step's δ, computed if need be."""
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
        # The slots form a ring, so that the latest steps are found first.
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
    """Spring, damper and the contacts that act, against the motion."""
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
    """δ s of the sources that change onto a right-hand side."""
    for k in range(sources.shape[0]):
        right[sources[k, 0]] += delta * waveform.value(sources[k, 1], waves[k], corners, time)


@compiled
def _linearise(rows, behavioural, inputs, values, shares, latest, y, slopes, sizes, time):
    """Behavioural sources at the latest iterate, in terms of the change u."""
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
    """Whether the core's unknowns moved by little; the latest iterate becomes theirs."""
    settled = True
    for position in range(state.motion if only_motion else 0, state.core.size):
        unknown = state.core[position]
        moving = position == state.motion
        new = state.y[unknown] + state.solution[position]
        moved = abs(new - state.latest[unknown])
        # NaN counts as not near, so that the iteration continues or fails.
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
    """Newton's iterations of a stage that has begun; True if they converged.

    Parameters
    ----------
    device : circuits.kernel.mechanics.Device
    tables : circuits.kernel.tables.Tables
    state : State
        `latest` holds a guess of y + u, of the velocity at least where no behavioural source asks
        for more, `iterated` one of the junctions'.
    slot : int
        Slot of the factors, from `slot_of`.
    delta, time : float
    x_base : float
        X less the part of δ X' in the stage.
    zone : (bool, float, float, float)
        Whether contacts act, between which displacements, and the held speed.
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
