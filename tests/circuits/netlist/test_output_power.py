"""What ngspice makes of an output resistor is what counts, and a load that delivers is named."""

import numpy as np
import pytest

from circuits.netlist.subcircuits import read_load
from harvester.base.errors import NetlistError
from harvester.engines.methods import Circuit
from harvester.engines.realization import run as realization_run
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared

SHORT = ["run.duration=0.5", "run.settle=0.1", "run.realizations=1", "load.subcircuit=load"]
# The piezo's terminals are the output: all that leaves the piezo is used there.
DIRECT = "{before}\n.subckt load p n out ref\nVp p out 0\nVn ref n 0\n{body}\n.ends\n"
NOT_PASSIVE = "the load is not passive: it delivers"


def run(tmp_path, pool, text):
    path = tmp_path / "load.lib"
    path.write_text(text)
    scene = Scene.read("device", [*SHORT, f"load.netlist={path}"])
    return simulate(scene, method="circuit", workers=1, runner=pool)


def estimate(result, name):
    return result.quantity(name).estimate


@pytest.mark.parametrize(
    ("body", "before"),
    [
        ("R1 out ref 300k", ""),
        ("R1 out ref 600k m=2", ""),
        ("R1 out ref 600k scale=0.5", ""),
        ("R1 out ref 150k tc1=0.01 temp=127", ""),
        ("R1 out ref 150k tc1=0.01 dtemp=100", ""),
        ("R1 out ref 75k tc1=0.01 tc2=2e-4 dtemp=100", ""),
        ("R1 out ref 100k r=300k", ""),
        ("R1 out ref rm l=300u w=1u", ".model rm r(rsh=1000 defw=1u)"),
        ("R1 out ref rm temp=127 m=2", ".model rm r(r=300k tc1=0.01)"),
        ("R1 out ref {q*2}", ".param q=150k"),
        ("R1 out ref 600k\nR2 ref out 600k", ""),
        ("R1 out ref 300k\nR2 out ref 1k m=0", ""),
        ("X1 out ref rr\nR2 out ref 400k", ".subckt rr a b\nR1 a b 1.2meg\n.ends"),
        (
            "X1 ref x out outer\nR9 x n 1",
            ".subckt rr a b\nR1 a b 600k m=2\n.ends\n.subckt outer a b c\nX1 c a rr\n.ends",
        ),
    ],
)
def test_the_output_power_is_what_ngspice_lets_flow(tmp_path, pool, body, before):
    """300 kΩ in each spelling: as much used as leaves the piezo, and as much as the plain one."""
    if "X1" in body:
        body += "\nC1 out ref 1f"
    result = run(tmp_path, pool, DIRECT.format(before=before, body=body))
    used = estimate(result, "mean_output_power")
    assert used == pytest.approx(estimate(result, "mean_power"), rel=1e-4)
    square = estimate(result, "mean_square_voltage")
    assert used == pytest.approx(square / 300e3, rel=1e-4)


@pytest.mark.parametrize(
    ("body", "before"),
    [
        ("C1 out ref 3u ic=1", ""),
        ("C1 out ref 1u m=3 ic=1", ""),
        ("C1 out ref 1u scale=3 ic=1", ""),
        ("C1 out ref 1.5u tc1=0.01 dtemp=100 ic=1", ""),
        ("C1 out ref cm m=3 ic=1", ".model cm c(cap=1u)"),
        ("C1 out ref 1u ic=1\nC2 ref out 2u ic=-1", ""),
        ("X1 ref out cc", ".subckt cc a b\nC1 b a 3u ic=1\n.ends"),
    ],
)
def test_the_stored_energy_is_that_of_all_storage(tmp_path, pool, body, before):
    """Diodes out of the piezo's way: 3 µF keep their charge at 1 V, but for a large resistor."""
    text = "{}\n.subckt load p n out ref\nRp p n 300k\nRr ref n 1k\nR1 out ref 1g\n{}\n.ends\n"
    result = run(tmp_path, pool, text.format(before, body))
    assert estimate(result, "final_stored_energy") == pytest.approx(0.5 * 3e-6, rel=2e-3)


@pytest.mark.parametrize(
    ("body", "before"),
    [
        ("R1 out ref {300k*(1+time*0.2)}", ""),
        ("R1 out ref {300k*(1+temper)}", ""),
        ("R1 out ref {300k*(1+v(p)*v(p))}", ""),
        ("R1 out ref {f(300k)}", ".func f(x) {g(x)}\n.func g(x) {x*(1+i(vp))}"),
        ("R1 out ref 1k\nC1 out ref {1u*(1+time)}", ""),
        ("R1 out ref 1k\nX1 ref out cc", ".subckt cc a b\nR1 b a {1k*(1+time)}\n.ends"),
    ],
)
def test_what_varies_across_the_output_is_refused(tmp_path, body, before):
    path = tmp_path / "load.lib"
    path.write_text(DIRECT.format(before=before, body=body))
    with pytest.raises(NetlistError, match=r"load\.lib:\d+: [\w.]+ is across out and ref"):
        read_load(path, "load")


@pytest.mark.parametrize(
    "body",
    [
        "R1 out ref -50k",
        "R1 ref out 50k m=-1",
        "R2 out ref 10k\nR1 out ref -50k",
        "X1 out ref rr\n.subckt rr a b r=-50k\nR1 a b {r}\n.ends",
    ],
)
def test_a_negative_output_resistance_is_refused(tmp_path, body):
    path = tmp_path / "load.lib"
    path.write_text(DIRECT.format(before="", body=body))
    with pytest.raises(
        NetlistError, match=r"^load\.lib:\d+: [\w.]*r1 is .* -50000 Ω, must be above 0"
    ):
        read_load(path, "load")


@pytest.mark.parametrize(
    ("body", "efficiency"),
    [
        ("R1 out ref 300k\nRs out b 1\nR2 b ref -600k", 1.9),
        ("R1 out ref 300k\nRs out b 1\nR2 b ref 600k m=-1", 1.9),
    ],
)
def test_a_load_that_delivers_energy_is_named_with_how_much(tmp_path, pool, body, efficiency):
    result = run(tmp_path, pool, DIRECT.format(before="", body=body))
    note = next(note for note in result.notes if note.startswith(NOT_PASSIVE))
    delivered = float(note.removeprefix(NOT_PASSIVE).split()[0])
    used, left = estimate(result, "mean_output_power"), estimate(result, "mean_power")
    assert delivered == pytest.approx(used - left, rel=1e-2)
    assert used / abs(left) > efficiency


@pytest.mark.parametrize(
    "body",
    ["I1 ref out 1m", "I1 ref out sin(0 1m 20)", "B1 ref out i=1m*sin(time)", "G1 ref out p n 2u"],
)
def test_what_a_source_supplies_is_no_output(tmp_path, pool, body):
    """The resistor takes all of it and what leaves the piezo, which alone is harvested."""
    result = run(tmp_path, pool, DIRECT.format(before="", body=f"{body}\nR1 out ref 300k"))
    name = body[:2].lower()
    supplied, left = estimate(result, f"supplied_by_{name}"), estimate(result, "mean_power")
    assert supplied > 0.5 * abs(left)
    assert any(note.startswith(f"supplied by {name}: ") for note in result.notes)
    assert estimate(result, "mean_output_power") == pytest.approx(left, abs=2e-3 * supplied)
    used = estimate(result, "mean_power_used_at_output")
    assert used == pytest.approx(left + supplied, abs=2e-3 * supplied)
    assert abs(estimate(result, "mean_converter_loss")) < 2e-3 * supplied


def test_a_load_without_output_that_drives_the_piezo_is_named(tmp_path, pool):
    text = ".subckt load p n\nI1 n p sin(0 0.1m 6)\nR1 p n 1meg\n.ends\n"
    result = run(tmp_path, pool, text)
    left = estimate(result, "mean_power")
    assert left < 0.0
    note = next(note for note in result.notes if note.startswith(NOT_PASSIVE))
    assert float(note.removeprefix(NOT_PASSIVE).split()[0]) == pytest.approx(-left, rel=1e-2)


def test_sources_of_the_load_are_named_where_their_energy_is_hidden(tmp_path, pool):
    """What they deliver is lost in R2: less comes out than goes in, and some of it is theirs."""
    body = "X1 ref out cell\nR2 p n 100k\nR1 out ref 300k"
    before = ".subckt cell a b\nI1 a b 30u\nV1 b c 0\nR1 c a 1g\n.ends"
    result = run(tmp_path, pool, DIRECT.format(before=before, body=body))
    assert 0.0 < estimate(result, "converter_efficiency") < 1.0
    assert estimate(result, "supplied_by_x1_i1") > 0.0
    assert any(note.startswith("supplied by x1_i1: ") for note in result.notes)


def test_a_load_that_takes_what_it_uses_is_not(tmp_path, pool):
    result = run(tmp_path, pool, DIRECT.format(before="", body="R1 out ref 300k\nC1 out ref 10n"))
    assert not any("passive" in note or "sources" in note for note in result.notes)
    assert 0.99 < estimate(result, "converter_efficiency") < 1.01


def test_a_resistor_that_takes_nothing_is_none_that_monte_carlo_knows(tmp_path):
    path = tmp_path / "load.lib"
    path.write_text(".subckt load p n\nR1 p n -5k\n.ends\n")
    assert read_load(path).resistance is None


def test_every_copy_of_the_device_has_its_own_output(pool, tmp_path):
    path = tmp_path / "load.lib"
    path.write_text(DIRECT.format(before="", body="R1 out ref 300k\nC1 out ref 10n"))
    scene = Scene.read("device", [*SHORT[:2], "run.realizations=2", f"load.netlist={path}"])
    call = {
        "prepared_scene": prepared(scene),
        "engine": Circuit(),
        "indices": [0, 1],
        "window": None,
    }
    both = pool.map(realization_run, [call])[0]
    assert np.isfinite([each.moments.output.conductance for each in both]).all()
    first, second = (each.moments.output.conductance for each in both)
    assert first == pytest.approx(second, rel=1e-12)
