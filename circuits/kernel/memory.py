"""Layout of a circuit's numbers in one block of memory, and views of it."""

from __future__ import annotations

from collections import namedtuple

import numpy as np

from circuits.kernel import junction
from circuits.kernel.linear import Order
from circuits.kernel.tables import Tables

# Number of stored factorisations, one per step length and switch state. Steps are the grid's
# divided by powers of 2 (`stepping._length`), so that few lengths occur.
SLOTS = 24


class Layout(
    namedtuple(
        "Layout",
        "y rates largest change stored first new_rates right ordered error filtered steady "
        "solution core iterated voltages before charges new_charges capacity conductance "
        "switches junctions slopes sizes slots end",
    )
):
    """Indices in the memory of a circuit with n unknowns, m junctions and a core of c unknowns.

    Attributes
    ----------
    y, rates : n, unknowns, and rates d/dt [C y + q].
    largest : n, largest magnitude of each unknown so far.
    change : n, change of the unknowns in the stage.
    stored, first : n, change of C y + q in the present stage, and in the first stage.
    new_rates : n, rates at the step's end.
    right, ordered : n, right-hand side; the same in the order of pivots, after elimination of the
        linear unknowns.
    error, filtered : n, the step's error of C y + q, and of y.
    steady : n, constant sources.
    solution : c + 1, changes of the core's unknowns, and 0 for ground.
    core : factors of the core in the latest iteration, indexed by `Order.places`.
    iterated, voltages, before : m, junction voltages in the stage, now and one step ago.
    charges, new_charges : m, junction charges at the step's beginning and in the stage.
    capacity, conductance : values of the tables' entries.
    switches : present conductance of each switch.
    junctions : `junction.COLUMNS` rows of m values.
    slopes, sizes : derivatives of behavioural sources by their inputs; linearised values at y.
    slots : `SLOTS` times the factors of the linear unknowns, and the core without junctions.
    end : size of the memory.
    """


def layout_of(tables: Tables, order: Order) -> Layout:
    """The layout of a circuit's memory."""
    n, m, core = tables.steady.size, len(tables.junctions), len(order.rows) - order.linear
    entries, factors = len(tables.entries), len(order.places)
    sizes = [
        *[n] * 12, core + 1, factors, *[m] * 5, entries, entries, len(tables.switches),
        m * junction.COLUMNS, len(tables.inputs), len(tables.behavioural), SLOTS * factors,
    ]  # fmt: skip
    return Layout(0, *(int(offset) for offset in np.cumsum(sizes)))


def fresh_memory(tables: Tables, layout: Layout) -> np.ndarray:
    """A new block of memory (float64), filled with the tables' numbers."""
    memory = np.zeros(layout.end)
    for offset, numbers in (
        (layout.largest, np.full(tables.steady.size, 1e-9)),
        (layout.steady, tables.steady),
        (layout.capacity, tables.capacity),
        (layout.conductance, tables.conductance),
        (layout.junctions, tables.junction_values.T.ravel()),
    ):
        memory[offset : offset + numbers.size] = numbers
    return memory
