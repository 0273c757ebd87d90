"""Relaxation of a load's stores: its small-signal network about the mean node voltages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from circuits.kernel import junction
from circuits.kernel.assembly import collect
from circuits.kernel.builder import tables_of
from circuits.netlist.expression_graph import evaluate, slopes
from circuits.netlist.part_values import capacitance, conductance
from circuits.netlist.stores import times_of, weights
from harvester.device.terminals import GROUND

if TYPE_CHECKING:
    from circuits.kernel.tables import Tables
    from harvester.scene.prepared import Prepared

# Conductance from every node to ground, in siemens, which gives isolated nodes a voltage. It is a
# hundredth of ngspice's conductance in parallel with a junction.
LEAK = 1e-2 * junction.LEAST_CONDUCTANCE
# A time constant above this share of the leakage's time constant is caused by the leakage.
LEAKS_SHARE = 0.1
_ACTIVE = "swqjmb"


def relaxation(ready: Prepared, levels: Mapping[str, float], blocking: bool = True) -> np.ndarray:
    """Matrix G⁻¹ C, which converts rates of change of levels to distances from steady state.

    Parameters
    ----------
    ready : Prepared
        A scene whose load is a netlist.
    levels : mapping of str to float
        Mean voltages (V) and currents (A), by names in the load.
    blocking : bool
        Whether diodes, open switches and expressions are included, with their slopes at the mean
        levels; otherwise they do not conduct.

    Returns
    -------
    ndarray, shape (len(levels), len(levels))
        Levels by rates (s): the inverse of the conductances times the capacitances. A level without
        a discharge path keeps its charge. The eigenvalues are the relaxation times.

    Elements that the compiled engine does not support do not conduct.
    """
    b, measurement, _, velocity = collect(ready, whole=False)
    # Velocity and ground are last and do not belong to the load.
    ground = velocity + 1
    places = np.array([_place(tree, b, ground) for tree in measurement.trees[-len(levels) :]])
    y = np.zeros(ground + 1)
    y[places] = list(levels.values())
    y[velocity:] = 0.0
    capacity, conductance = _network(tables_of(b, velocity), y, blocking)
    nodes = np.array([not name.startswith("i(") for name in b.unknowns])
    answer = np.zeros((ground + 1, ground + 1))
    inside = slice(0, velocity)
    answer[inside, inside] = _solved(capacity[inside, inside], conductance[inside, inside], nodes)
    return answer[np.ix_(places, places)]


def slowest_time(ready: Prepared) -> float:
    """The longest time constant (s) of a load's stores with its resistors; 0 if none.

    A store connected only through a diode has no such time. In loads with switches, transistors or
    expressions, which transfer charge at other rates, only parts across the output count.
    """
    load = ready.scene.load.circuit
    if any(
        element.letter in _ACTIVE or element.expression is not None for element in load.elements
    ):
        siemens = conductance(load.across_output)
        return capacitance(load.across_output) / siemens if siemens else 0.0
    levels = dict.fromkeys(load.levels, 0.0)
    if not levels:
        return 0.0
    matrix = relaxation(ready, levels, blocking=False)
    sizes = {
        element.name: element.size or 0.0 for element in load.elements if element.letter in "cl"
    }
    held = np.array([weights(store, levels) for store in load.stores])
    return max(
        time
        for store, times in zip(load.stores, times_of(matrix, held), strict=True)
        for time in (0.0, *times)
        if time < LEAKS_SHARE * sizes[store.name] / LEAK
    )


def _place(tree, b, ground):
    """Index of a level's unknown; the index of ground if the circuit has no such unknown."""
    if tree[0] == "i":
        return b.unknowns.get(f"i({tree[1]})", ground)
    return ground if tree[1] == GROUND else b.unknowns.get(tree[1], ground)


def _solved(c, g, nodes):
    """G⁻¹ C; at nodes with only capacitors the sum of their charges is conserved."""
    alone = ~np.any(g != 0.0, axis=1)
    held = np.where(alone[:, None], 0.0, c)
    g = np.where(alone[:, None], c, g + np.diag(np.where(nodes, LEAK, 0.0)))
    sizes = np.abs(g).max(axis=1, keepdims=True)
    sizes[sizes == 0.0] = 1.0
    return np.linalg.lstsq(g / sizes, held / sizes, rcond=None)[0]


def _network(tables: Tables, y: np.ndarray, blocking: bool) -> tuple[np.ndarray, np.ndarray]:
    """Capacitances and conductances among the unknowns and ground, about their means."""
    size = y.size
    capacity, conductance = np.zeros((size, size)), np.zeros((size, size))
    rows, columns = tables.entries.T
    np.add.at(capacity, (rows, columns), tables.capacity)
    np.add.at(conductance, (rows, columns), tables.conductance)
    # Terms of the velocity belong to the device.
    for matrix in (capacity, conductance):
        matrix[size - 2], matrix[:, size - 2] = 0.0, 0.0
    if blocking:
        for ends, row in zip(tables.junctions, tables.junction_values, strict=True):
            _stamp(conductance, ends, junction.slope(row, y[ends[0]] - y[ends[1]]))
    for ends, values in zip(tables.switches, tables.switch_values, strict=True):
        control = y[ends[2]] - y[ends[3]]
        closed = control > values[3] or (control >= values[2] and ends[4] == 1)
        if closed or blocking:
            _stamp(conductance, ends[:2], values[int(closed)])
    if blocking:
        _add_behavioural(tables, y, conductance)
    return capacity, conductance


def _stamp(conductance, ends, value):
    for row, sign in zip(ends, (1.0, -1.0), strict=True):
        for column, other in zip(ends, (1.0, -1.0), strict=True):
            conductance[row, column] += sign * other * value


def _add_behavioural(tables, y, conductance):
    """Add the behavioural sources' slopes to the conductances."""
    values, shares = tables.graph_values.copy(), np.zeros(len(tables.graph))
    evaluate(tables.graph, values, y, 0.0)
    for number, (to, source, first, last) in enumerate(tables.behavioural):
        slopes(tables.graph, values, shares, first, last)
        for which, operation, unknown in tables.inputs:
            if which == number and np.isfinite(shares[operation]):
                conductance[to, unknown] += shares[operation]
                conductance[source, unknown] -= shares[operation]
