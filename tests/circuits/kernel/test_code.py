"""The generated code against numpy, on the circuits of the project's own loads and one diode."""

import functools
from itertools import product

import numpy as np
import pytest

from circuits.kernel import code, emitter, junction, linear
from circuits.kernel.assembly import build
from circuits.kernel.emitter import call_once
from circuits.kernel.stage import fresh_state
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared

LOADS = ("bridge", "doubler", "sshi_parallel", "sshi_series", "sece", "bridge_buck")
# All of a diode's terms; its series resistance gets a node of its own.
DIODE = """* a diode
.subckt one p n out ref
.model dm d(is=2n n=1.4 rs=3 cjo=20p vj=0.7 m=0.4 fc=0.5 tt=5n bv=6 ibv=1m nbv=1.2)
D1 p out dm
R1 out ref 100k
C1 out ref 1n
R2 ref n 1
.ends
"""

# More diodes than stand side by side, of two sorts in turn.
MANY = """* diodes in parallel
.subckt many p n out ref
.model plain d(is=2n n=1.4 rs=3)
.model broken d(is=5n n=1.2 bv=6 ibv=1m nbv=1.2)
{diodes}
R1 out ref 100k
C1 out ref 1n
R2 ref n 1
.ends
""".format(diodes="\n".join(f"D{k} p out {('plain', 'broken')[k % 2]} {k}" for k in range(1, 20)))
CODE = code.Code._fields
FILES = {"diode": DIODE, "diodes": MANY}


def law(row, v):
    """Current, slope, charge and capacitance by the formulas of ngspice's manual.

    Beyond `LARGEST_CURRENT` an exponential goes on as its tangent.
    """
    swing, size = row[junction.SWING], row[junction.CAPACITANCE]

    def exponential(start, volts, width):
        end = width * np.log(junction.LARGEST_CURRENT / start)
        if volts <= end:
            return start * np.exp(volts / width), start * np.exp(volts / width) / width
        slope = junction.LARGEST_CURRENT / width
        return junction.LARGEST_CURRENT + slope * (volts - end), slope

    saturation = row[junction.SATURATION]
    rise, slope = exponential(saturation, v, swing)
    if v < -3.0 * swing:
        # A blocked junction has a law of its own there, until it lets nothing more through.
        cube = (3.0 * swing / (v * np.e)) ** 3 if v > junction.BLOCKED * swing else 0.0
        rise, slope = -saturation * cube, 3.0 * saturation * cube / v
    lost, steep = 0.0, 0.0
    if np.isfinite(row[junction.BREAKDOWN]):
        width = row[junction.BREAKDOWN_SWING]
        beyond = -(v + row[junction.BREAKDOWN])
        lost, steep = exponential(row[junction.BREAKDOWN_CURRENT], beyond, width)
    current = rise - saturation - lost + 1e-12 * v
    slope = slope + steep + 1e-12
    charge, capacitance = row[junction.TRANSIT] * current, row[junction.TRANSIT] * slope
    if size:
        potential, grading = row[junction.POTENTIAL], row[junction.GRADING]
        edge = row[junction.EDGE]

        def depletion(volts):
            return size * (1.0 - volts / potential) ** -grading

        below = np.linspace(0.0, min(v, edge), 20001)
        charge += np.trapezoid(depletion(below), below)
        capacitance += depletion(min(v, edge))
        if v > edge:
            bend = size * grading / potential * (1.0 - edge / potential) ** (-grading - 1.0)
            charge += (v - edge) * depletion(edge) + 0.5 * bend * (v - edge) ** 2
            capacitance += bend * (v - edge)
    return current, slope, charge, capacitance


def assembled(circuit, closed, delta):
    """C and δ G of all that is linear, ground last."""
    tables = circuit.tables
    n = tables.steady.size
    stored, conducted = np.zeros((2, n + 1, n + 1))
    np.add.at(stored, tuple(tables.entries.T), tables.capacity)
    np.add.at(conducted, tuple(tables.entries.T), delta * tables.conductance)
    for (a, z), values in zip(tables.switches[:, :2], tables.switch_values, strict=True):
        stamp(conducted, a, z, delta * values[closed])
    return stored, conducted


def stamp(matrix, a, z, value):
    matrix[[a, z], [a, z]] += value
    matrix[[a, z], [z, a]] -= value


@pytest.mark.slow
@pytest.mark.parametrize(
    ("load", "voltage"),
    # The last two are beyond the largest current of one diode, either way.
    [
        *product([*LOADS, *FILES], [-5.9, -0.3, 0.3, 0.55]),
        ("diode", 1.2),
        ("diode", -9.0),
    ],
)
def test_an_iteration_is_numpys(tmp_path, load, voltage):
    """All switches open and all closed, junctions from breakdown to conducting, three steps."""
    path = tmp_path / "own.lib"
    path.write_text(FILES.get(load, ""))
    name = str(path) if load in FILES else load
    circuit = build(prepared(Scene.read("device", [f"load.netlist={name}"])))
    tables, code = circuit.tables, circuit.code
    n = tables.steady.size
    random = np.random.default_rng(3)
    for closed in (0, 1):
        for delta in (2e-4, 1e-6, 1e-9):
            state = fresh_state(circuit)
            state.switches[:] = tables.switch_values[:, closed]
            state.y[:], state.right[:] = random.normal(size=(2, n)) * 1e-3
            state.iterated[:], state.charges[:] = voltage, 1e-12
            state.slopes[:], state.sizes[:] = 1e-5, 2e-5
            stored, conducted = assembled(circuit, closed, delta)
            right = np.append(state.right + delta * tables.steady, 0.0)
            right -= conducted @ np.append(state.y, 0.0)
            # A push and a spring stiffer than inertia.
            push, spring = 1e-7, 1e-6
            right[n - 1] += push
            conducted[n - 1, n - 1] += spring
            y = np.append(state.y, 0.0)
            for (a, z), row in zip(tables.junctions, tables.junction_values, strict=True):
                i, slope, charge, capacitance = law(row, voltage)
                share = 1.0 / (1.0 + slope * row[junction.RESISTANCE])
                g = delta * slope * share
                flow = delta * i * share
                if row[junction.CAPACITANCE]:
                    g, flow = g + capacitance, flow + charge - 1e-12
                stamp(conducted, a, z, g)
                flow += g * (y[a] - y[z] - voltage)
                right[a] -= flow
                right[z] += flow
            for to, source in tables.behavioural[:, :2]:
                right[to] -= delta * 2e-5
                right[source] += delta * 2e-5
            for number, _, unknown in tables.inputs:
                to, source = tables.behavioural[number, :2]
                conducted[to, unknown] += delta * 1e-5
                conducted[source, unknown] -= delta * 1e-5
            matrix = (stored + conducted)[:n, :n]
            call_once(code.factor, state.address, state.slots, delta)
            call_once(code.begin, state.address, state.slots, delta)
            call_once(code.iterate, state.address, state.slots, delta, push, spring)
            call_once(code.finish, state.address, state.slots, delta)
            assert_solves(matrix, state.change, right[:n])
            state.error[:] = random.normal(size=n)
            energy = call_once(code.error, state.address, state.slots)
            assert_solves(matrix, state.filtered, state.error)
            assert energy == pytest.approx(np.abs(state.error * state.filtered)[:-1].sum())


def assert_solves(matrix, found, right):
    # Row by row: their units differ by many orders of magnitude.
    size = np.abs(matrix) @ np.abs(found) + np.abs(right)
    assert np.max(np.abs(matrix @ found - right) / size) < 1e-8


def test_newton_ends_on_the_junctions_law(tmp_path):
    """From either side, and what is stored is its charge."""
    (tmp_path / "one.lib").write_text(DIODE)
    circuit = build(prepared(Scene.read("device", [f"load.netlist={tmp_path / 'one.lib'}"])))
    tables, code = circuit.tables, circuit.code
    row, (a, z) = tables.junction_values[0], tables.junctions[0]
    for begin in (-20.0, -6.2, 0.0, 0.4, 2.0, 40.0):
        for drive in (-1e-3, 1e-7, 1e-3):
            state = fresh_state(circuit)
            call_once(code.factor, state.address, state.slots, 1e-6)
            state.right[a], state.right[z] = drive * 1e-6, -drive * 1e-6
            state.iterated[0] = begin
            call_once(code.begin, state.address, state.slots, 1e-6)
            for _ in range(40):
                if call_once(code.iterate, state.address, state.slots, 1e-6) > 0.0:
                    break
            else:
                raise AssertionError(f"no end from {begin} V")
            call_once(code.iterate, state.address, state.slots, 1e-6)
            call_once(code.finish, state.address, state.slots, 1e-6)
            v = state.change[a] - state.change[z]
            assert state.iterated[0] == pytest.approx(v, abs=1e-4)
            assert state.new_charges[0] == pytest.approx(law(row, v)[2], rel=1e-3)


def test_long_code_is_compiled_without_optimization(tmp_path, monkeypatch):
    """LLVM's time for optimized machine code grows with the square of its length."""
    levels, real = [], emitter.llvm.create_pipeline_tuning_options
    monkeypatch.setattr(
        emitter.llvm,
        "create_pipeline_tuning_options",
        lambda speed_level: levels.append(speed_level) or real(speed_level=speed_level),
    )
    monkeypatch.setattr(emitter, "MOST_OPTIMIZED", 1000)
    monkeypatch.setattr(code, "_compiled", functools.lru_cache()(code._compiled.__wrapped__))
    test_newton_ends_on_the_junctions_law(tmp_path)
    assert levels == [0]


def test_the_order_of_a_ladder_costs_a_few_columns_for_each_unknown(tmp_path, monkeypatch):
    count = 100
    cards = [f"R{k} a{k} a{k + 1} 100\nC{k} a{k + 1} n 1p" for k in range(count)]
    path = tmp_path / "ladder.lib"
    text = "\n".join(["* ladder", ".subckt ladder p n", "R p a0 100", *cards, ".ends"])
    path.write_text(f"{text}\n")
    touched, real = [], linear._sizes
    monkeypatch.setattr(
        linear,
        "_sizes",
        lambda columns, rows: touched.append(columns.shape[2]) or real(columns, rows),
    )
    monkeypatch.setattr(code, "compile_module", lambda module: (None, dict.fromkeys(CODE, 0)))
    monkeypatch.setattr(code, "_compiled", code._compiled.__wrapped__)
    circuit = build(prepared(Scene.read("device", [f"load.netlist={path}"])))
    unknowns = len(circuit.order.rows)
    assert unknowns > count
    # Each number and its fill-in: three for each section.
    assert len(circuit.order.places) < 4 * unknowns
    assert sum(touched) < 4 * unknowns
