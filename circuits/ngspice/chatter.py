"""Detects behavioural sources of a load that toggle every few steps of ngspice."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from circuits.netlist.expression import renamed, unknowns_in
from circuits.netlist.expression_graph import Values
from circuits.netlist.part_values import jumping_sources
from circuits.ngspice import callbacks

if TYPE_CHECKING:
    from circuits.equivalent.assembly import Netlist
    from circuits.netlist.load_circuit import LoadCircuit

# A source chatters if it jumps by half its largest value at JUMPING_SHARE of the points, with steps
# shorter than SLIDING_STEP of the usual one, in each of LOOKS checks a second apart. A step load
# without hysteresis jumps at two of five points, with steps of 3e-4; pulse-width modulation with
# thirty steps per period at one of fifteen.
JUMPING_SHARE, SLIDING_STEP, LOOKS = 0.125, 1e-2, 6
# Fewest points of a check.
FEWEST_POINTS = 200


class Chattering:
    """Checks a run's points about once a second for a source that chatters."""

    def __init__(self, netlist: Netlist, load: LoadCircuit | None) -> None:
        measurement = netlist.measurement
        self._step, self._count = netlist.step, len(measurement.watched)
        self._seen: list[str] = []
        self._names: list[str] = []
        trees = []
        levels = load.levels if load else ()
        # Levels are the last measurements, each ("v", full name of the node, ground).
        level_trees = measurement.trees[len(measurement.trees) - len(levels) :]
        pins = {name: tree[1] for name, tree in zip(levels, level_trees, strict=True)}
        for source in jumping_sources(load.elements) if load else ():
            tree = renamed(source.expression, pins) if source.expression else None
            if tree and {*unknowns_in(tree)} <= {*measurement.watched}:
                trees.append(tree)
                self._names.append(f"the source {source.place}")
        self._values = Values(trees, measurement.watched) if trees else None

    def found(self, times: np.ndarray, points: np.ndarray) -> str:
        """Name of the source that chattered in each of the last `LOOKS` checks, or ""."""
        self._seen = [*self._seen, self._now(times.copy(), points.copy())][-LOOKS:]
        one = len(self._seen) == LOOKS and len(set(self._seen)) == 1
        return self._seen[0] if one else ""

    def _now(self, times, points):
        if self._values is None or times.size < FEWEST_POINTS:
            return self._seen[-1] if self._seen else ""
        if not 0.0 < times[-1] - times[0] < SLIDING_STEP * self._step * times.size:
            return ""
        watched = points[:, callbacks.COLUMNS :][:, : self._count]
        values = self._values(times, watched.T)
        jumps = np.abs(np.diff(values)) > 0.5 * np.abs(values).max(axis=1, keepdims=True)
        shares = jumps.mean(axis=1)
        return self._names[int(shares.argmax())] if shares.max() > JUMPING_SHARE else ""
