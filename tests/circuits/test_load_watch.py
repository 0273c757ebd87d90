"""What of a load decides the steps, read from its elements."""

import math

import pytest

from circuits.netlist.load_watch import NOTHING, may_jump, watch_of
from circuits.netlist.subcircuits import find_netlist, read_load

PINS = {"p": "terminal", "n": "0", "out": "output", "ref": "reference"}


def written(tmp_path, body, pins="p n"):
    path = tmp_path / "load.lib"
    path.write_text(f".subckt load {pins}\n{body}\n.ends load\n")
    return read_load(path)


def test_of_a_switched_coil_its_controls_and_what_it_keeps_are_watched():
    watch = watch_of(read_load(find_netlist("sshi_series")), PINS)
    assert watch.switches == ((30.0, -30.0, False), (30.0, -30.0, False))
    assert watch.unknowns[:4] == ("0", "comparator", "comparator", "0")
    kept = dict(zip(watch.unknowns[4::2], watch.stores, strict=True))
    inductance, coil = kept["i(linversion)"]
    assert coil
    # Half a damped period with the piezo takes 0.2 ms at a quality of 5.
    damped = (math.pi / 0.2e-3) ** 2 / (1.0 - 1.0 / 101.0)
    assert 1.0 / (inductance * 43e-9) == pytest.approx(damped, rel=1e-9)
    assert kept["output"] == (pytest.approx(10e-6), False)


def test_multiples_count_as_the_circuit_has_them(tmp_path):
    watch = watch_of(written(tmp_path, "L1 p x 2m m=4\nC1 x n 1u m=3\nR1 x n 1k"), PINS)
    assert watch.stores == ((0.5e-3, True), (pytest.approx(3e-6), False))


def test_a_switch_by_current_is_watched_with_its_first_state(tmp_path):
    body = "V1 p x 0\nW1 x y V1 closing on\nC1 y n 1u\n.model closing csw(it=1m ih=0.25m)"
    watch = watch_of(written(tmp_path, body), PINS)
    assert watch.switches == ((pytest.approx(1.25e-3), pytest.approx(0.75e-3), True),)
    assert watch.unknowns == ("i(v1)", "0", "y", "0")


@pytest.mark.parametrize("shape", ["pulse(0 1 0 1u 1u 1m 5m)", "pwl(0 0 1m 1)", "sin(0 1 50)"])
def test_a_waveform_is_left_to_ngspice(tmp_path, shape):
    """It alone knows where a source bends."""
    watch = watch_of(written(tmp_path, f"V1 x n {shape}\nR1 x p 1k"), PINS)
    assert watch.jumps
    assert watch.unknowns == ()


def test_what_follows_the_motion_is_not_watched():
    assert watch_of(read_load(find_netlist("bridge")), PINS) == NOTHING


@pytest.mark.parametrize(
    "body",
    [
        "B1 p n i=v(p,n)>1 ? 1m : 0",
        "G1 p n value={v(p,n)^3}",
        "Q1 p p n part\n.model part npn",
        "S1 p n p n inverted\n.model inverted sw(vt=1 vh=-0.5)",
        "C2 p n -1n\nL1 p n 1",
    ],
)
def test_what_may_jump_is_left_to_the_local_error(tmp_path, body):
    load = written(tmp_path, f"{body}\nC1 p n 1n")
    assert watch_of(load, PINS).stores == ()
    assert may_jump(load)


def test_of_what_may_jump_the_switches_are_watched():
    watch = watch_of(read_load(find_netlist("node_buck")), PINS)
    assert watch.jumps
    assert watch.unknowns == ("in", "reference", "supply", "reference", "xnode.due", "reference")
    assert watch.switches[0] == (pytest.approx(5.05), pytest.approx(3.67), False)
