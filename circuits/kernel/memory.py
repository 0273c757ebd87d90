"""Layout of a circuit's numbers in one block of memory, and views of it."""

from __future__ import annotations

from collections import namedtuple

import numpy as np

from circuits.kernel import junction
from circuits.kernel.linear import Order
from circuits.kernel.tables import Tables

# Factored matrices that are kept, one for each length of step and each state of the switches.
# Steps are the grid's divided by powers of 2 (`stepping._length`), so that few lengths
# occur.
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
    y, rates : n unknowns and d/dt [C y + q].
    largest : n, greatest size of each unknown so far.
    change : n, of the unknowns in the stage.
    stored, first : n, change of C y + q in the stage, and in the step's first one.
    new_rates : n, rates at the step's end.
    right, ordered : n, right-hand side, and in the order of pivots the linear ones eliminated.
    error, filtered : n, a step's error of C y + q, and of y.
    steady : n, constant sources.
    solution : c, changes of the core's unknowns; ground's last, 0.
    core : factors of the core in the latest iteration, as `Order.places` counts.
    iterated, voltages, before : m, of the junctions in the stage, now and a step ago.
    charges, new_charges : m, at the step's beginning and in the stage.
    capacity, conductance : of the tables' entries.
    switches : conductance of each as it is.
    junctions : `junction.COLUMNS` rows of m.
    slopes, sizes : of behavioural sources, by input and by source.
    slots : `SLOTS` times the factors of the linear unknowns and the core without junctions.
    end : the size.
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
    """A block of memory with the tables' numbers in it; float64."""
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
