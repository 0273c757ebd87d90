"""A device's transducer and load as tables of numbers, the input of the compiled solver.

Unknowns are the voltages of all nodes, the currents of inductors and of elements that set a
voltage, and, last, the velocity X'. They obey d/dt [C y + q(y)] + G y + i(y) = s(t), in A and V;
the velocity's row is a power per velocity (W s per scaled length), so that every row times its
unknown is a power.
"""

from __future__ import annotations

from collections import namedtuple
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from circuits.netlist.load_circuit import LoadCircuit
    from circuits.netlist.measurement import Measurement
    from circuits.netlist.source_schedule import SourceSchedule


class Tables(
    namedtuple(
        "Tables",
        "entries capacity conductance steady sources waves corners driven drives junctions "
        "junction_values switches switch_values graph graph_values behavioural inputs "
        "zero_crossings retimed nonlinear_rows nonlinear_columns own start",
    )
):
    """Arrays of a circuit with n unknowns; indices of unknowns are int64, n is ground.

    Attributes
    ----------
    entries : (k, 2) rows and columns of `capacity` and `conductance`, both (k,).
    steady : (n,) constant sources, s of the equation.
    sources : (k, 2) row and shape of each changing source; `waves` (k, waveform.COLUMNS) its
        parameters.
    corners : (k, 2) points of all piecewise linear sources, one after another.
    driven : (k,) rows of sources proportional to η; `drives` (k,) their values at η = 1.
    junctions : (k, 2) anode and cathode; `junction_values` (k, junction.COLUMNS).
    switches : (k, 6) nodes, controlling nodes (or a current and ground), initial state, kind;
        `switch_values` (k, 4) conductance off and on, control below which it opens and above which
        it closes.
    graph : (k, 4) operations; `graph_values` (k,) their constants.
    behavioural : (k, 4) row that the source adds to, row it subtracts from, its first operation,
        index of its value; `inputs` (k, 3) index of the source, index in the graph, unknown;
        `zero_crossings` (k,) indices of values whose zero crossings make a source jump.
    retimed : (k,) entries that `circuits.kernel.prewarping` scales: the mass, and the currents
        proportional to its velocity.
    nonlinear_rows, nonlinear_columns : (n,) whether a nonlinear element has entries there.
    own : (k, 2) unknowns of a self-oscillating load, whose tolerance is relative to their
        magnitude, and 1 for a current.
    start : (2, n) initial y, and its change per volt or ampere of the transducer's state.
    """


class Probes(NamedTuple):
    """Indices of a record's quantities among the unknowns, and their units.

    Attributes
    ----------
    places : int64, shape (5 + watched,): terminal, load's current, transducer's state, output,
        reference, and the unknowns of the load's measures.
    units : float64, shape (5,): scaled values of 1 V, of 1 V or 1 A of the state, of 1 A and of
        1 W, and the energy (J) of one unit in the velocity's row.
    energy : capacitance (F) and voltage (V); a store with less energy is negligible.
    """

    places: np.ndarray
    units: np.ndarray
    energy: tuple[float, float]


class Circuit(NamedTuple):
    """A circuit, as returned by `build`.

    Attributes
    ----------
    tables, probes
    order : circuits.kernel.linear.Order
    layout : circuits.kernel.memory.Layout
    code : circuits.kernel.code.Code
    names : names of the unknowns, for messages.
    switches, sources : (name, "file:line") of each switch, and of each behavioural source.
    load : circuits.netlist.load_circuit.LoadCircuit
    measurement : the load's measures, from the watched unknowns.
    schedule : times at which the load's sources change.
    """

    tables: Tables
    probes: Probes
    order: Any
    layout: Any
    code: Any
    names: tuple[str, ...]
    switches: tuple[tuple[str, str], ...]
    sources: tuple[tuple[str, str], ...]
    load: LoadCircuit
    measurement: Measurement
    schedule: SourceSchedule
