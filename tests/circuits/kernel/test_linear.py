"""The listed elimination against numpy's, on the circuits of the project's own loads."""

import numpy as np
import pytest

from circuits.kernel.assembly import build
from circuits.kernel.linear import SLOTS, backward, eliminate, forward
from harvester.scene.model import Scene

LOADS = ("bridge", "doubler", "sshi_parallel", "sshi_series", "sece", "bridge_buck")


@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("conductance", [1e-12, 1e-4, 10.0])
def test_solutions_are_numpys(load, conductance):
    """All switches open and all closed, junctions from blocked to conducting, three steps."""
    circuit = build(Scene.load("device", [f"load.netlist={load}"]))
    tables, order = circuit.tables, circuit.order
    n = tables.steady.size
    right = np.random.default_rng(3).normal(size=n)
    for closed in (0, 1):
        for delta in (2e-4, 1e-6, 1e-9):
            full = np.zeros((n + 1, n + 1))
            listed = np.zeros((SLOTS + 1, order.linear[2] + 1))

            def add(row, column, value, place, full=full, listed=listed):
                full[row, column] += value
                listed[0, place] += value

            for (row, column), place, c, g in zip(
                tables.entries, order.entry_places, tables.capacity, tables.conductance, strict=True
            ):
                add(row, column, c + delta * g, place)
            stamps = [
                (each[:2], values[closed], places)
                for each, values, places in zip(
                    tables.switches, tables.switch_values, order.switch_places, strict=True
                )
            ]
            stamps += [
                (each, conductance, places)
                for each, places in zip(tables.junctions, order.junction_places, strict=True)
            ]
            for (a, z), value, places in stamps:
                for row, column, sign, place in zip(
                    (a, z, a, z), (a, z, z, a), (1, 1, -1, -1), places, strict=True
                ):
                    add(row, column, sign * delta * value, place)
            # A behavioural source's slopes and a spring stiffer than inertia.
            for k, (number, _, unknown) in enumerate(tables.inputs):
                for side, sign in ((0, 1.0), (1, -1.0)):
                    row = tables.behavioural[number, side]
                    add(row, unknown, sign * delta * 1e-5, order.input_places[k, side])
            solution = np.zeros(n + 1)
            solution[:n] = right[order.rows]
            work = (order.pivots, order.lower, order.upper, order.updates)
            eliminate(*work, 0, n, listed, 0)
            forward(order.pivots, order.lower, 0, n, listed, 0, solution)
            backward(order.pivots, order.upper, 0, n, listed, 0, solution)
            ours = np.zeros(n)
            ours[order.columns] = solution[:n]
            matrix = full[:n, :n]
            # Row by row: their units differ by many orders of magnitude.
            size = np.abs(matrix) @ np.abs(ours) + np.abs(right)
            assert np.max(np.abs(matrix @ ours - right) / size) < 1e-8
