"""What a load's elements store and supply, against the netlist's own laws and plain ngspice."""

import re
import subprocess

import numpy as np
import pytest
from raw_files import ngspice_program

from circuits.netlist.kinds import BATTERY, SUPPLY
from circuits.netlist.measurement import energy_of
from circuits.netlist.subcircuits import read_load
from circuits.netlist.supplies import unbooked
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene

BRIDGE = ".model dm d(is=1e-9 n=1)\nD1 p rail dm\nD2 n rail dm\nD3 ref p dm\nD4 ref n dm\n"
MASS, DAMPING, STIFFNESS, COUPLING, CAPACITANCE = 0.01, 0.1, 100.0, 4e-4, 40e-9
AMPLITUDE, FREQUENCY, SECONDS = 2.0, 16.0, 1.0


def written(tmp_path, body):
    path = tmp_path / "own.lib"
    path.write_text(f".subckt own p n out ref\n{BRIDGE}{body}\nR1 out ref 1meg\n.ends\n")
    return path


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("B1 out ref V=min(1.8,v(rail,ref))", [(SUPPLY, "b1")]),
        ("G1 ref out rail ref 1u", [(SUPPLY, "g1")]),
        ("Rb rail b 50\nVb b ref 3\nRo rail out 1", [(BATTERY, "vb")]),
        ("Rb rail b 50\nVb b ref sin(3 1 5)\nRo rail out 1", [(SUPPLY, "vb")]),
        # An ideal transformer, and a converter whose input follows its output's current.
        ("E1 out ref rail ref 0.5\nF1 rail ref E1 0.5", [(SUPPLY, "e1_and_f1")]),
        ("B1 x ref V=1.8\nVs x out 0\nB2 rail ref I=i(Vs)", [(SUPPLY, "b1_and_b2")]),
        # A consumption of its own that does not depend on the output counts alone.
        (
            "B1 out ref V=min(1.8,v(rail,ref))\nB2 rail ref I=1u*v(rail,ref)",
            [(SUPPLY, "b1"), (SUPPLY, "b2")],
        ),
        # Logic that meets the rest in one node cannot exchange energy with it.
        (
            "Vone one ref 1\nS1 one up rail ref sw\nRup up ref 1meg\n"
            ".model sw sw(vt=2 vh=1)\nBd d ref v=v(up,ref)\nRo rail out 1",
            [],
        ),
        ("Vs rail out 0\nI1 ref out 0", []),
    ],
)
def test_sources_that_may_supply_are_booked_with_what_they_depend_on(tmp_path, body, expected):
    load = read_load(written(tmp_path, body))
    assert [(each.kind, each.name) for each in load.supplies] == expected


def test_a_battery_that_a_measure_counts_is_not_counted_twice(tmp_path):
    body = "* measure: output charge = v(b,ref)*i(Vb)\nVb b ref 3\nRb rail b 50"
    (battery,) = read_load(written(tmp_path, body)).supplies
    assert battery.kind == SUPPLY


def test_a_current_that_only_ngspice_evaluates_is_reported(tmp_path):
    load = read_load(written(tmp_path, "B1 rail ref I=1u*ddt(v(rail,ref))"))
    assert load.supplies == ()
    assert unbooked(load.elements) == ("b1",)


def test_the_stored_energy_is_that_of_capacitors_and_coupled_coils(tmp_path):
    body = "C1 rail a 3u\nRa a ref 9\nL1 rail b 2m\nL2 b out 8m\nK1 L1 L2 0.5"
    load = read_load(written(tmp_path, body))
    volts = dict.fromkeys(load.levels, 0.0) | {"rail": 5.0, "a": 1.0, "i(l1)": 2.0, "i(l2)": -3.0}
    values = np.array([volts[name] for name in load.levels])
    expected = 0.5 * 3e-6 * 4.0**2 + 0.5 * 2e-3 * 4.0 + 0.5 * 8e-3 * 9.0 - 0.5 * 4e-3 * 6.0
    assert values @ energy_of(load) @ values == pytest.approx(expected, rel=1e-12)


def test_logic_stores_no_energy_of_the_load_and_a_converter_feeds_its_own_side(tmp_path):
    logic = (
        "Bt ref t I=1u*(1-v(t,ref))\nCt t ref 1n\nS1 out x t ref sw\nRx x ref 1k\n"
        ".model sw sw(vt=2 vh=1)"
    )
    load = read_load(written(tmp_path, logic))
    assert not energy_of(load).any()
    converter = (
        "B1 rail ref I=v(s,ref)*i(Vs)/v(rail,ref)\nVs s y 0\nB2 ref s I=1u*v(rail,ref)\n"
        "Cy y ref 1u\nB3 y ref I=v(out,ref)*i(Vo)\nB4 w ref V=min(1.8,v(y,ref))\nVo w out 0"
    )
    load = read_load(written(tmp_path, converter))
    assert {"y", "s"} <= load.coupled
    assert [each.name for each in load.supplies] == ["b1_and_b2_and_b3_and_b4"]


@pytest.mark.parametrize("measured", [False, True])
def test_a_current_across_the_output_says_that_it_counts_as_a_loss(tmp_path, pool, measured):
    sink = "Cb rail ref 1u ic=3\nRo rail out 1\nB1 out ref I=20u*v(out,ref)\n"
    measure = "* measure: output node = 20u*v(out,ref)^2" * measured
    path = written(tmp_path, sink + measure)
    scene = Scene.read("device", [f'load.netlist="{path}"', "run.duration=1", "run.realizations=1"])
    result = simulate(scene, method="monte-carlo", runner=pool)
    notes = [note for note in result.notes if "which counts as converter loss" in note]
    assert len(notes) == (not measured)
    if notes:
        assert notes[0].startswith("b1 takes ")
    resistor = result["output_voltage"].estimate ** 2 / 1e6
    assert (result["mean_output_power"].estimate > 15.0 * resistor) is measured


LOADS = {
    # A supercapacitor of two branches, all of it behind series resistances.
    "supercapacitor": (
        "Rs rail a 9\nC0 a ref 5u\nR2 a b 50k\nC2 b ref 2u\nRo rail out 1",
        "2.5e-6*v(a,ref)^2+1e-6*v(b,ref)^2",
        "0",
    ),
    "battery": ("Rb rail b 50\nVb b ref 3\nRo rail out 1\nCb rail ref 1u ic=3",
                "0.5e-6*v(rail,ref)^2", "0"),
    "regulator": ("Cb rail ref 1u\nB1 out ref V=min(1.8,v(rail,ref))",
                  "0.5e-6*v(rail,ref)^2", "-v(out,ref)*i(b.xload.b1)"),
    "RC in series": ("Ra rail a 47k\nCa a ref 2u\nCb rail ref 200n\nRo rail out 1",
                     "1e-6*v(a,ref)^2+1e-7*v(rail,ref)^2", "0"),
    "RLC in series": (
        "L1 rail a 10\nRa a b 1k\nCa b ref 1u\nCb rail ref 100n\nRo rail out 1",
        "5*i(l.xload.l1)^2+0.5e-6*v(b,ref)^2+0.5e-7*v(rail,ref)^2",
        "0",
    ),
    "supercapacitor that leaks": (
        "Rs rail a 30\nC0 a ref 4u\nRl a ref 2meg\nR2 a b 20k\nC2 b ref 3u\nR3 a c 300k\n"
        "C3 c ref 1u\nRo rail out 1",
        "2e-6*v(a,ref)^2+1.5e-6*v(b,ref)^2+0.5e-6*v(c,ref)^2",
        "0",
    ),
}  # fmt: skip
# Behavioural and pass regulators behind a buffer: what each supplies.
REGULATORS = {
    "tanh": ("B1 out ref V=1.8*tanh(v(rail,ref)/1.8)", "-v(out,ref)*i(b.xload.b1)"),
    "amplifier": ("E1 out ref rail ref 0.5", "-v(out,ref)*i(e.xload.e1)"),
    "transconductor": ("G1 ref out rail ref 0.5u", "0.5e-6*v(out,ref)*v(rail,ref)"),
    "linear pair": (
        "B1 vo ref V=max(0,min(1.8,v(rail,ref)-0.1))\nVs vo out 0\nB2 rail ref I=i(Vs)", "0"
    ),
    "averaged buck": (
        "B1 vo ref V=min(1.8,0.9*v(rail,ref))\nVs vo out 0\n"
        "B2 rail ref I=v(vo,ref)*i(Vs)/0.85/max(v(rail,ref),0.1)", "0"
    ),
    "tanh pass": (
        "B1 rail vo I=50u*(1+tanh((1.8-v(vo,ref))/1m))*tanh(v(rail,vo)/0.1)\nRo vo out 1", "0"
    ),
    "conductance pass": (
        "B1 rail vo I=v(rail,vo)*(1e-7+5m*(1+tanh((1.8-v(vo,ref))/1u)))\nRo vo out 1", "0"
    ),
    "shunt": (
        "Rs rail vo 470k\nB1 vo ref I=5m*(1+tanh((v(vo,ref)-1.8)/0.2m))\nRo vo out 1", "0"
    ),
    "emitter follower": (
        "Rz rail b 2.2meg\nDz ref b z\nQ1 rail b vo q\nRo vo out 1\n"
        ".model q npn(is=1e-14 bf=200)\n.model z d(is=1e-14 bv=2.4 ibv=10n)", "0"
    ),
    "PMOS pass": (
        "Bea g ref V=0.5*v(rail,ref)*(1+tanh(1000*(v(fb,ref)-1.2)))\nM1 vo g rail rail pm w=1m\n"
        "Rf vo fb 600k\nRg fb ref 1.2meg\nRo vo out 1\n.model pm pmos(vto=-0.7 kp=200u)", "0"
    ),
}  # fmt: skip
LOADS |= {
    name: (f"Cb rail ref 1u\n{body}", "0.5e-6*v(rail,ref)^2", supplied)
    for name, (body, supplied) in REGULATORS.items()
}


@pytest.mark.slow
@pytest.mark.parametrize("load", LOADS)
def test_energies_are_those_of_a_plain_deck(tmp_path, pool, load):
    """Steps of both cost some 0.2 %; the tolerance is 1 % of what goes into the load."""
    body, stored, supplied = LOADS[load]
    path = written(tmp_path, body)
    tables = {
        "units": "SI",
        "oscillator": {"mass": MASS, "damping": DAMPING, "linear_stiffness": STIFFNESS,
                       "cubic_stiffness": 0.0},
        "piezo": {"coupling": COUPLING, "capacitance": CAPACITANCE},
        "load": {"netlist": str(path)},
        "excitation": {"kind": "sine", "amplitude": AMPLITUDE, "frequency": FREQUENCY},
        "run": {"duration": SECONDS, "settle": 0.0, "realizations": 1},
    }  # fmt: skip
    method = "circuit" if " pm " in body or "npn" in body else "monte-carlo"
    result = simulate(Scene.from_tables(tables), method=method, runner=pool)
    found = {name: result[name].estimate for name in result.quantities}
    deck = _deck(tmp_path, path, body, stored, supplied)
    store = deck["last"] / SECONDS
    final = deck["last"] + (0.5e-6 * 9.0 if "ic=3" in body else 0.0)
    if load == "battery":
        store += deck["battery"] / SECONDS
        final += deck["battery"]
    put_in = deck["taken"] / SECONDS
    assert found["mean_power"] == pytest.approx(put_in, rel=0.01)
    assert found["mean_storage_power"] == pytest.approx(store, abs=0.01 * put_in)
    assert found["final_stored_energy"] == pytest.approx(final, abs=0.01 * put_in * SECONDS)
    hourly = 3600.0 * found["mean_storage_power"] if load == "battery" else np.nan
    assert found["stored_energy_per_hour"] == pytest.approx(hourly, nan_ok=True)
    given, used = deck["supplied"] / SECONDS, deck["used"] / SECONDS
    supplied = sum(found[name] for name in found if name.startswith("supplied_by"))
    assert supplied == pytest.approx(given, rel=0.01)
    assert found["mean_output_power"] == pytest.approx(used - given, abs=0.01 * put_in)
    at_output = found.get("mean_power_used_at_output", found["mean_output_power"])
    assert at_output == pytest.approx(used, abs=0.01 * put_in)
    lost = put_in + given - used - store
    assert found["mean_converter_loss"] == pytest.approx(lost, abs=0.01 * put_in)
    assert any("supplied by" in note for note in result.notes) == (given > 0.0)
    harvested = (used - given + store) / put_in
    assert found["converter_efficiency"] == pytest.approx(harvested, abs=0.01)


def _deck(tmp_path, path, body, stored, supplied):
    """Energies (J) of one run of the same device by ngspice alone."""
    battery = "v(b,ref)*i(v.xload.vb)" if "Vb" in body else "0"
    start = "0.5e-6*9" if "ic=3" in body else "0"
    expressions = {"taken": "v(p)*i(vload)", "used": "v(out,ref)^2/1e6", "supplied": supplied,
                   "battery": battery, "held": f"{stored}-{start}"}  # fmt: skip
    lets = "".join(f"let {name}={_plain(text)}+0*time\n" for name, text in expressions.items())
    integrals = "".join(
        f"meas tran m_{name} integ {name} from=0 to={SECONDS}\n" for name in expressions
    )
    text = (
        f"* device\n.include {path}\nCm vel 0 {MASS} ic=0\nRm vel 0 {1 / DAMPING}\n"
        f"Cx x 0 1 ic=0\nGx 0 x vel 0 1\nGk vel 0 x 0 {STIFFNESS}\nGt vel 0 t 0 {COUPLING}\n"
        f"Bf 0 vel I={MASS * AMPLITUDE}*sin({2 * np.pi * FREQUENCY}*time)\n"
        f"Gc 0 t vel 0 {COUPLING}\nCp t 0 {CAPACITANCE} ic=0\nVload t p 0\nXload p 0 out ref own\n"
        "Co out 0 4p ic=0\nCr ref 0 4p ic=0\n.options reltol=1e-5 abstol=1e-13\n"
        f".tran 50u {SECONDS} 0 50u uic\n.control\nrun\n{lets}{integrals}"
        f"meas tran last find held at={SECONDS * (1 - 1e-9)}\n.endc\n.end\n"
    )
    (tmp_path / "deck.cir").write_text(text)
    command = [ngspice_program(), "-b", "deck.cir"]
    answer = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    values = re.findall(r"^(?:m_)?(\w+) += +(\S+)", answer.stdout, re.M)
    return {name: float(value) for name, value in values}


def _plain(text):
    """An expression with the deck's names of nodes, each voltage against ground."""
    inside = {"p": "p", "out": "out", "ref": "ref"}

    def voltage(match):
        first, second = (inside.get(node, f"xload.{node}") for node in match.groups())
        return f"(v({first})-v({second}))"

    return re.sub(r"v\((\w+),(\w+)\)", voltage, text)
