"""Machine code for a circuit's shape: elimination, junctions, matrix products.

Code that depends on the positions of the circuit's elements is generated here, number by number,
and compiled once per shape, in a fraction of a second; values are in memory. Each function has the
arguments of `circuits.kernel.emitter`:

- ``factor``: the slot's matrix C + δ G, its linear unknowns eliminated.
- ``predict``: guesses of the junctions' voltages: a given share of their last change is added.
- ``begin``: `ordered` of the first stage: `right`, less δ (G y − s) with the constant sources s,
  plus the rates times a weight; the last argument is added to the velocity's row.
- ``again``: `ordered` of the second stage: the first stage's `stored` replaces the rates.
- ``iterate``: one Newton iteration; returns 1 if the junctions' voltages changed little.
- ``finish``: `change` and `stored` from the last iteration, and guesses of the junctions' voltages,
  extrapolated by a share of their change.
- ``conclude``: `new_rates` and `error` of a step, from δ, the weight of the first stage in the
  second stage, and the step's length.
- ``error``: `filtered` from `error`; returns the energy of the error.
- ``accept``: the step's end becomes the state.
"""

from __future__ import annotations

import functools
import itertools
from collections import namedtuple
from typing import Any, NamedTuple

from llvmlite import ir

from circuits.kernel import junction
from circuits.kernel.elimination import Matrix, add, backward, eliminate, forward
from circuits.kernel.emitter import Emitter, beside, compile_module
from circuits.kernel.linear import Order
from circuits.kernel.memory import Layout, layout_of
from circuits.kernel.tables import Tables

# Weights of the error estimate for the rates at the step's beginning, first stage and end: the
# difference of a third-order formula and TR-BDF2's second-order formula.
ERROR = ((1.0 - 2.0**0.5) / 3.0, 1.0 / 3.0, (2.0**0.5 - 2.0) / 3.0)

# Largest number of equal junctions in one vector: the widest registers hold eight numbers.
MOST_BESIDE = 8


class Shape(NamedTuple):
    """Structure of a circuit that determines its code; equal shapes share their code.

    Attributes
    ----------
    entries, switches, junctions : (row, column) of every entry, (plus, minus) nodes of every switch
        and junction; ground is n.
    traits : features of each junction, see `junction.traits`.
    behavioural, inputs : (to, from) of each source, (source, unknown) of each input.
    rows, columns : row and unknown at each position of the elimination.
    linear : number of unknowns before the core.
    places : ((row, column) by position, memory index) of each number of the matrix.
    layout : circuits.kernel.memory.Layout
    """

    entries: tuple
    switches: tuple
    junctions: tuple
    traits: tuple
    behavioural: tuple
    inputs: tuple
    rows: tuple
    columns: tuple
    linear: int
    places: tuple
    layout: Layout


class Code(namedtuple("Code", "factor predict begin again iterate finish conclude error accept")):
    """Addresses of a circuit's compiled functions, which the module's docstring describes."""


def code_of(tables: Tables, order: Order) -> Code:
    """The code of a circuit, compiled once per shape."""
    return _compiled(
        Shape(
            _tuples(tables.entries),
            _tuples(tables.switches[:, :2]),
            _tuples(tables.junctions),
            tuple(junction.traits(row) for row in tables.junction_values),
            _tuples(tables.behavioural[:, :2]),
            _tuples(tables.inputs[:, ::2]),
            tuple(order.rows.tolist()),
            tuple(order.columns.tolist()),
            order.linear,
            tuple(order.places.items()),
            layout_of(tables, order),
        )
    )[1]


def _tuples(array):
    return tuple(map(tuple, array.tolist()))


@functools.lru_cache(maxsize=256)
def _compiled(shape: Shape) -> tuple[Any, Code]:
    """The engine that owns the code, and its addresses."""
    module = ir.Module()
    writers = (
        _factor, _predict, _begin, _again, _iterate, _finish, _conclude, _error, _accept,
    )  # fmt: skip
    for name, write in zip(Code._fields, writers, strict=True):
        write(Emitter(module, name), shape)
    engine, addresses = compile_module(module)
    return engine, Code(**addresses)


def _factor(e: Emitter, shape: Shape) -> None:
    """Write `factor`: the matrix C + δ G of the elements, eliminated up to the core."""
    delta, at = e.numbers[0], shape.layout
    matrix: Matrix = {}
    position = _positions(shape)
    for k, (row, column) in enumerate(shape.entries):
        change = e.load(at.capacity + k) + delta * e.load(at.conductance + k)
        add(matrix, position(row, column), change)
    for k, (plus, minus) in enumerate(shape.switches):
        _stamp(matrix, position, plus, minus, delta * e.load(at.switches + k), shape)
    eliminate(matrix, 0, shape.linear)
    for where, address in shape.places:
        if where in matrix:
            e.store(address, matrix[where], in_slot=True)
    e.give(e.constant(0.0))


def _predict(e: Emitter, shape: Shape) -> None:
    """Write `predict`: first guesses of Newton's iterations, by linear extrapolation."""
    at = shape.layout
    for group in _groups(shape):
        v = e.load(at.voltages + group.first, count=group.width)
        change = (v - e.load(at.before + group.first, count=group.width)) * e.numbers[0]
        e.store(at.iterated + group.first, _ahead(e, shape, group, v, change))
    e.give(e.constant(0.0))


def _ahead(e, shape, group, v, change):
    """Guesses of the junctions' voltages after a change.

    A guess rises at most to the junction's swing above 0 V, or above the present voltage, since its
    current grows exponentially.
    """
    address = shape.layout.junctions + junction.SWING * len(shape.junctions) + group.first
    return v + change.lesser((-v).greater(0.0) + e.load(address, count=group.width))


def _begin(e: Emitter, shape: Shape) -> None:
    """Write `begin`: the first stage's right-hand side, from the rates at the step's beginning."""
    rates = [e.load(shape.layout.rates + i) for i in range(len(shape.rows))]
    _begin_with(e, shape, rates)


def _again(e: Emitter, shape: Shape) -> None:
    """Write `again`: the second stage's right-hand side, from the first stage's results."""
    at, n = shape.layout, len(shape.rows)
    stored = [e.load(at.stored + i) for i in range(n)]
    for i in range(n):
        e.store(at.first + i, stored[i])
    _begin_with(e, shape, stored)


def _begin_with(e, shape, known):
    """Write a stage's right-hand side with `known` times its weight, and forward elimination."""
    delta, weight, push = e.numbers
    at, n = shape.layout, len(shape.rows)
    y = [e.load(at.y + i) for i in range(n)]
    right = [
        e.load(at.right + i) + weight * known[i] + delta * e.load(at.steady + i) for i in range(n)
    ]
    right[n - 1] = right[n - 1] + push
    for k, (row, column) in enumerate(shape.entries):
        right[row] = right[row] - delta * e.load(at.conductance + k) * y[column]
    for k, (plus, minus) in enumerate(shape.switches):
        across = _across(e, y, plus, minus)
        _through(right, plus, minus, delta * e.load(at.switches + k) * across)
    ordered = [right[row] for row in shape.rows]
    forward(_loaded(e, shape), ordered, 0, shape.linear)
    for i, value in enumerate(ordered):
        e.store(at.ordered + i, value)
    e.give(e.constant(0.0))


def _iterate(e: Emitter, shape: Shape) -> None:
    """Write `iterate`: solve the core's equations, linearised at the junctions' latest voltages."""
    _, push, slope = e.numbers
    at, n, first = shape.layout, len(shape.rows), shape.linear
    matrix = {key: v for key, v in _loaded(e, shape).items() if min(key) >= first}
    right = [e.load(at.ordered + i) if i >= first else e.constant(0.0) for i in range(n)]
    _onto(shape, right, n - 1, push)
    add(matrix, _positions(shape)(n - 1, n - 1), slope)
    laws = _add_junctions(e, shape, matrix, right)
    _add_behavioural(e, shape, matrix, right)
    eliminate(matrix, first, n)
    forward(matrix, right, first, n)
    backward(matrix, right, first, n)
    for i in range(first, n):
        e.store(at.solution + i - first, right[i])
    for where, address in shape.places:
        if min(where) >= first:
            e.store(at.core + address, matrix[where])
    settled = e.constant(1.0)
    change = [right[shape.columns.index(u)] for u in range(n)]
    for group, law, old, begin in laws:
        across = begin + beside([_across(e, change, a, z) for a, z in group.ends(shape)])
        chosen, near = law.moved(old, across)
        e.store(at.iterated + group.first, chosen)
        settled = settled * e.truth(near)
    e.give(settled)


def _onto(shape, right, row, value):
    """Add to a row of the right-hand side in the order of pivots; ignore ground."""
    if row < len(shape.rows):
        pivot = shape.rows.index(row)
        right[pivot] = right[pivot] + value


def _add_junctions(e, shape, matrix, right):
    """Add the junctions' slopes and currents; return groups, laws, old and first voltages."""
    at, position, laws = shape.layout, _positions(shape), []
    y = [e.load(at.y + i) for i in range(len(shape.rows))]
    for group in _groups(shape):
        law, ends = _law(e, shape, group), group.ends(shape)
        v = e.load(at.iterated + group.first, count=group.width)
        charges = e.load(at.charges + group.first, count=group.width)
        g, flow = law.linear(v, e.numbers[0], charges)
        begin = beside([_across(e, y, a, z) for a, z in ends])
        flow = flow + g * (begin - v)
        for (a, z), slope, current in zip(ends, g.parts(), flow.parts(), strict=True):
            _stamp(matrix, position, a, z, slope, shape)
            _onto(shape, right, a, -current)
            _onto(shape, right, z, current)
        laws.append((group, law, v, begin))
    return laws


def _add_behavioural(e, shape, matrix, right):
    """Add the behavioural sources' values and slopes to right-hand side and matrix."""
    delta, at, position = e.numbers[0], shape.layout, _positions(shape)
    for k, (to, source) in enumerate(shape.behavioural):
        size = delta * e.load(at.sizes + k)
        _onto(shape, right, to, -size)
        _onto(shape, right, source, size)
    for k, (number, unknown) in enumerate(shape.inputs):
        size = delta * e.load(at.slopes + k)
        for row, slope in zip(shape.behavioural[number], (size, -size), strict=True):
            if row < len(shape.rows):
                add(matrix, position(row, unknown), slope)


def _finish(e: Emitter, shape: Shape) -> None:
    """Write `finish`: all unknowns from the core's unknowns, and the transferred charges."""
    at, n, first = shape.layout, len(shape.rows), shape.linear
    values = [
        e.load(at.ordered + i) if i < first else e.load(at.solution + i - first) for i in range(n)
    ]
    backward(_loaded(e, shape), values, 0, first)
    change = [values[shape.columns.index(i)] for i in range(n)]
    stored = [e.constant(0.0)] * n
    for k, (row, column) in enumerate(shape.entries):
        stored[row] = stored[row] + e.load(at.capacity + k) * change[column]
    for group in _groups(shape):
        v = e.load(at.iterated + group.first, count=group.width)
        if group.traits.charge:
            charge = _law(e, shape, group).charge(v)
            e.store(at.new_charges + group.first, charge)
            lost = e.load(at.charges + group.first, count=group.width) - charge
            for (a, z), component in zip(group.ends(shape), lost.parts(), strict=True):
                _through(stored, a, z, component)
        moved = (v - e.load(at.voltages + group.first, count=group.width)) * e.numbers[0]
        e.store(at.iterated + group.first, _ahead(e, shape, group, v, moved))
    for i in range(n):
        e.store(at.change + i, change[i])
        e.store(at.stored + i, stored[i])
    e.give(e.constant(0.0))


def _conclude(e: Emitter, shape: Shape) -> None:
    """Write `conclude`: rates at the step's end, and the step's error, with weights `ERROR`."""
    delta, factor, h = e.numbers
    at, per_delta = shape.layout, 1.0 / delta
    for i in range(len(shape.rows)):
        rate, first = e.load(at.rates + i), e.load(at.first + i)
        new = (e.load(at.stored + i) - factor * first) * per_delta
        middle = first * per_delta - rate
        e.store(at.new_rates + i, new)
        e.store(at.error + i, h * (rate * ERROR[0] + middle * ERROR[1] + new * ERROR[2]))
    e.give(e.constant(0.0))


def _accept(e: Emitter, shape: Shape) -> None:
    """Write `accept`: unknowns, rates, voltages and charges at the step's end become the state."""
    at = shape.layout
    for i in range(len(shape.rows)):
        y = e.load(at.y + i) + e.load(at.change + i)
        e.store(at.y + i, y)
        e.store(at.largest + i, e.load(at.largest + i).greater(y.size()))
        e.store(at.rates + i, e.load(at.new_rates + i))
    for group in _groups(shape):
        for old, new in ((at.before, at.voltages), (at.voltages, at.iterated)):
            e.store(old + group.first, e.load(new + group.first, count=group.width))
        if group.traits.charge:
            charges = e.load(at.new_charges + group.first, count=group.width)
            e.store(at.charges + group.first, charges)
    e.give(e.constant(0.0))


def _error(e: Emitter, shape: Shape) -> None:
    """Write `error`: the charges' error, divided by the matrix, and the energy of the error.

    The division bounds the estimate for stiff networks (Hosea and Shampine 1996).
    """
    at, n, first = shape.layout, len(shape.rows), shape.linear
    matrix = _loaded(e, shape)
    for where, address in shape.places:
        if min(where) >= first:
            matrix[where] = e.load(at.core + address)
    error = [e.load(at.error + i) for i in range(n)]
    values = [error[row] for row in shape.rows]
    forward(matrix, values, 0, n)
    backward(matrix, values, 0, n)
    total = e.constant(0.0)
    for i in range(n):
        filtered = values[shape.columns.index(i)]
        e.store(at.filtered + i, filtered)
        if i < n - 1:
            total = total + (error[i] * filtered).size()
    e.give(total)


class _Group(NamedTuple):
    """Consecutive junctions of the same traits, computed as one vector.

    Attributes
    ----------
    first, width : index of the first junction, and number of junctions.
    traits : common features of the junctions.
    """

    first: int
    width: int
    traits: junction.Traits

    def ends(self, shape):
        return shape.junctions[self.first : self.first + self.width]


def _groups(shape):
    """The circuit's junctions in groups of equal traits, at most `MOST_BESIDE` each."""
    first = 0
    for traits, alike in itertools.groupby(shape.traits):
        left = len(list(alike))
        while left > 0:
            group = _Group(first, min(left, MOST_BESIDE), traits)
            yield group
            first, left = first + group.width, left - group.width


def _law(e, shape, group):
    """The law of a group's junctions, with parameters read from the memory."""
    address = shape.layout.junctions + group.first
    return junction.Law(e, address, len(shape.junctions), group.width, group.traits)


def _positions(shape):
    """A function that gives the position of a matrix element in the order of elimination."""
    rows = {row: i for i, row in enumerate(shape.rows)}
    columns = {column: i for i, column in enumerate(shape.columns)}
    return lambda row, column: (rows[row], columns[column])


def _loaded(e, shape):
    """The factors stored by `factor` in the slot, by memory index."""
    return {where: e.load(address, in_slot=True) for where, address in shape.places}


def _stamp(matrix, position, plus, minus, value, shape):
    """Add a conductance between two nodes to the matrix."""
    n = len(shape.rows)
    ends = [(node, sign) for node, sign in ((plus, 1), (minus, -1)) if node < n]
    for row, sign in ends:
        for column, other in ends:
            add(matrix, position(row, column), value if sign == other else -value)


def _across(e, values, plus, minus):
    """Difference of two values; ground, the last index, is 0."""
    n = len(values)
    one = values[plus] if plus < n else e.constant(0.0)
    return one - values[minus] if minus < n else one


def _through(values, plus, minus, current):
    """Subtract a current from one value and add it to another."""
    if plus < len(values):
        values[plus] = values[plus] - current
    if minus < len(values):
        values[minus] = values[minus] + current
