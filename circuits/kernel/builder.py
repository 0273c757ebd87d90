"""Collects the elements of a circuit and converts them to tables."""

from __future__ import annotations

from typing import Any

import numpy as np

from circuits.kernel import junction, waveform
from circuits.kernel.tables import Tables
from circuits.netlist.expression_graph import ExpressionGraph
from harvester.device.terminals import GROUND


class Builder:
    """Collects elements; every method adds one kind."""

    def __init__(self) -> None:
        self.unknowns: dict[str, int] = {}
        self.entries: dict[tuple[int, int], list[float]] = {}
        self.steady: dict[int, float] = {}
        self.waves: list[tuple] = []
        self.corners: list[tuple[float, float]] = []
        self.driven: list[tuple[int, float]] = []
        self.junctions: list[tuple] = []
        self.switches: list[tuple] = []
        self.switch_names: list[tuple[str, str]] = []
        self.graph = ExpressionGraph()
        self.behavioural: list[tuple[int, int, int, int]] = []
        self.inputs: list[tuple[int, int, int]] = []
        # Indices in the graph of values that cross 0 when a source jumps.
        self.zero_crossings: list[int] = []
        self.waiting: list[tuple] = []
        self.nonlinear: set[tuple[str, int]] = set()
        self.initial: list[tuple[int, int, float, float]] = []
        self.inductances: dict[str, float] = {}
        # (row, column) of the matrix entries that `circuits.kernel.prewarping` rescales: the mass,
        # then the currents that its velocity drives.
        self.retimed: list[tuple[int, int]] = []

    def node(self, name: str) -> int:
        """Index of a node's voltage among the unknowns; −1 for ground."""
        return -1 if name == GROUND else self.unknowns.setdefault(name, len(self.unknowns))

    def branch(self, name: str) -> int:
        """Index of a branch's current among the unknowns."""
        return self.unknowns.setdefault(f"i({name})", len(self.unknowns))

    def enter(self, row: int, column: int, capacity: float = 0.0, conductance: float = 0.0) -> None:
        """Add to one entry of C (capacity) or G (conductance)."""
        if row >= 0 and column >= 0:
            entry = self.entries.setdefault((row, column), [0.0, 0.0])
            entry[0] += capacity
            entry[1] += conductance

    def between(
        self,
        a: int,
        b: int,
        capacity: float = 0.0,
        conductance: float = 0.0,
        controls: list[int] | None = None,
    ) -> None:
        """Add an admittance between two nodes, or one controlled by other nodes."""
        for row, sign in ((a, 1.0), (b, -1.0)):
            for column, other in zip(controls or (a, b), (1.0, -1.0), strict=True):
                self.enter(row, column, sign * other * capacity, sign * other * conductance)

    def capacitor(self, a: int, b: int, value: float, start: Any) -> None:
        """Add a capacitor with an initial voltage, or with the transducer's "state"."""
        self.between(a, b, capacity=value)
        self.initial.append((a, b, start, abs(value)))

    def through(self, name: str, a: int, b: int) -> int:
        """Add a branch whose current is an unknown and whose equation states its voltage."""
        row = self.branch(name)
        for node, sign in ((a, 1.0), (b, -1.0)):
            self.enter(node, row, conductance=sign)
            self.enter(row, node, conductance=-sign)
        return row

    def inductor(self, name: str, a: int, b: int, value: float, start: Any) -> None:
        """Add an inductor with an initial current, or with the transducer's "state"."""
        row = self.through(name, a, b)
        self.enter(row, row, capacity=value)
        self.inductances[name] = value
        self.initial.append((row, -1, start, value))

    def coupling(self, names: list[str], share: float) -> None:
        """Couple all pairs of the named inductors."""
        for k, first in enumerate(names):
            for second in names[k + 1 :]:
                mutual = share * (self.inductances[first] * self.inductances[second]) ** 0.5
                one, other = self.branch(first), self.branch(second)
                self.enter(one, other, capacity=mutual)
                self.enter(other, one, capacity=mutual)

    def source(self, row: int, sign: float, shape: Any) -> None:
        """Add a constant or time-varying source to the right-hand side of a row."""
        if row < 0:
            return
        if isinstance(shape, float):
            self.steady[row] = self.steady.get(row, 0.0) + sign * shape
        else:
            kind, numbers, corners = shape
            first = len(self.corners)
            self.corners += corners
            self.waves.append((row, kind, sign, first, len(self.corners), *numbers))

    def mark(self, rows: list[int], columns: list[int]) -> None:
        """Record the rows and columns of the matrix that a nonlinear element changes."""
        self.nonlinear |= {("row", row) for row in rows}
        self.nonlinear |= {("column", column) for column in columns}


def tables_of(b: Builder, velocity: int) -> Tables:
    """The collected elements as tables; the velocity X' is the last unknown."""
    n = velocity + 1
    if len(b.unknowns) != velocity:
        raise ValueError("an unknown was added after the velocity")
    rows = sorted(b.entries)
    steady = np.zeros(n)
    for index, value in b.steady.items():
        steady[index] = value
    flags = np.zeros((2, n), dtype=np.bool_)
    for kind, index in b.nonlinear:
        if index >= 0:
            flags[int(kind == "column"), index] = True

    # Junctions of the same kind are consecutive.
    junctions = sorted(b.junctions, key=lambda each: junction.traits(each[2]))

    def places(found, width):
        table = np.array(found, dtype=np.int64).reshape(-1, width)
        return np.where(table < 0, n, table)

    def numbers(found, width):
        return np.array(found, dtype=float).reshape(-1, width)

    return Tables(
        entries=places(rows, 2),
        capacity=np.array([b.entries[row][0] for row in rows]),
        conductance=np.array([b.entries[row][1] for row in rows]),
        steady=steady,
        sources=np.array([wave[:2] for wave in b.waves], dtype=np.int64).reshape(-1, 2),
        waves=numbers([wave[2:] for wave in b.waves], waveform.COLUMNS),
        corners=numbers(b.corners, 2),
        driven=np.array([row for row, _ in b.driven], dtype=np.int64),
        drives=np.array([gain for _, gain in b.driven], dtype=float),
        junctions=places([row[:2] for row in junctions], 2),
        junction_values=numbers([row[2] for row in junctions], junction.COLUMNS),
        switches=places([row[0] for row in b.switches], 6),
        switch_values=numbers([row[1] for row in b.switches], 4),
        graph=np.array(b.graph.rows, dtype=np.int64).reshape(-1, 4),
        graph_values=np.array(b.graph.values, dtype=float),
        behavioural=places(b.behavioural, 4),
        inputs=places(b.inputs, 3),
        zero_crossings=np.array(b.zero_crossings, dtype=np.int64),
        retimed=np.array([rows.index(entry) for entry in b.retimed], dtype=np.int64),
        nonlinear_rows=flags[0],
        nonlinear_columns=flags[1],
        own=places([], 2),
        start=_starts(b, n),
    )


def _starts(b, n):
    """Initial unknowns y if the transducer's state is zero, and their change per unit of it.

    The shape is (2, n). Voltages set by sources are exact. Capacitor voltages and inductor currents
    are as given; if they contradict each other, larger elements have more weight. The first step
    determines the unknowns that have no initial value.
    """
    matrix = np.zeros((len(b.initial), n + 1))
    values = np.zeros((len(b.initial), 2))
    for k, (a, z, start, size) in enumerate(b.initial):
        # Ground is last.
        matrix[k, a] += np.sqrt(size)
        matrix[k, z] -= np.sqrt(size)
        values[k, 1 if start == "state" else 0] = np.sqrt(size) * (
            1.0 if start == "state" else start
        )
    heaviest = np.abs(matrix).max(initial=1.0)
    fixed, imposed = _set_voltages(b, n)
    matrix = np.concatenate([1e-3 / heaviest * matrix[:, :n], fixed])
    values = np.concatenate([1e-3 / heaviest * values, imposed])
    sizes = np.abs(matrix).max(axis=0, initial=0.0)
    sizes[sizes == 0.0] = 1.0
    solution = np.linalg.lstsq(matrix / sizes, values, rcond=1e-13)[0]
    return (solution / sizes[:, None]).T


def _set_voltages(b, n):
    """Rows of branches that set a voltage and have no flux, and their values at time 0."""
    chosen = []
    for name, row_of_branch in b.unknowns.items():
        entries = {column: e for (row, column), e in b.entries.items() if row == row_of_branch}
        holds = any(e[0] != 0.0 for e in entries.values()) or ("row", row_of_branch) in b.nonlinear
        if name.startswith("i(") and not holds:
            chosen.append((row_of_branch, entries))
    rows, values = np.zeros((len(chosen), n)), np.zeros((len(chosen), 2))
    for k, (row_of_branch, entries) in enumerate(chosen):
        for column, (_, conductance) in entries.items():
            rows[k, column] = conductance
        values[k, 0] = b.steady.get(row_of_branch, 0.0)
        size = np.abs(rows[k]).max()
        rows[k], values[k] = rows[k] / size, values[k] / size
    return rows, values
