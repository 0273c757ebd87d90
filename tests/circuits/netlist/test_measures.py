"""Measures declared in a user's own file: what is read, refused, and found by both engines."""

import math

import numpy as np
import pytest

from circuits.netlist.measurement import measurement_of
from circuits.netlist.subcircuits import read_load
from harvester.base.errors import NetlistError
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene

# A resistor behind a meter, and another across the output; nothing else.
OWN = """* a load of one's own
* measure: loss line = line*i(vmeter)^2
* measure: output rest = v(far)^2/rest
* measure: store far = 0.5*{far}*v(far)^2
* measure: state positive = v(far)>0 taking v(far)*i(vmeter)
.subckt own p n out ref line=20k rest=100k far=10n
Vmeter p near 0
Xline near far wire r={line}
Rfar far n {rest}
Cfar far n {far}
Rout out n 1meg
Rref ref n 1k
Cacross out ref 1p
.ends
.subckt wire a b r=1
R1 a b {r}
.ends
"""


def written(tmp_path, text=OWN):
    path = tmp_path / "own.lib"
    path.write_text(text)
    return path


def test_a_measure_is_read_with_its_place(tmp_path):
    load = read_load(written(tmp_path))
    assert [each.where for each in load.measures] == [f"own.lib:{line}" for line in (2, 3, 4, 5)]
    assert load.measured == (
        ("loss", "line"), ("output", "rest"), ("store", "far"), ("state", "positive"),
        ("taken", "positive"),
    )  # fmt: skip


def test_it_is_a_comment_between_a_statement_and_its_continuation(tmp_path):
    text = OWN.replace("Rfar far n {rest}", "Rfar far n\n* measure: loss q = v(far)^2\n+ {rest}")
    load = read_load(written(tmp_path, text))
    assert "rfar far n {rest}" in load.text
    assert ("loss", "q") in load.measured


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("lost line = 1", r"unknown kind lost.*loss.*output"),
        ("loss line 1", r"write it as"),
        ("loss 3x = 1", r"not a name"),
        ("output mean = 1", r"mean is the name of a built-in quantity"),
        ("loss mean_converter = 7", r"mean_converter is the name"),
        ("output far_storage = 1", r"defined twice"),
        ("loss x = v(fra)", r"no node fra .did you mean far\?.; there are .*\bp\b"),
        ("loss x = i(rfar)", r"no current i\(rfar\)"),
        ("loss x = lin*2", r"unknown name lin"),
        ("loss x = (1", r"parenthesis missing"),
        ("loss x = 1 taking 2", r"only a state can have"),
        ("loss x = ddt(v(far))", r"ddt"),
        ("loss line = 1", r"twice"),
        ("loss x =", r"missing operand"),
    ],
)
def test_a_wrong_one_is_refused_with_its_line(tmp_path, line, fault):
    with pytest.raises(NetlistError, match=rf"own\.lib:6: .*{fault}"):
        read_load(written(tmp_path, OWN.replace(".subckt own", f"* measure: {line}\n.subckt own")))


def test_it_belongs_to_a_load_with_an_output(tmp_path):
    text = OWN.replace("p n out ref line", "p n line").replace("Cacross out ref 1p", "")
    with pytest.raises(NetlistError, match=r"own\.lib:6: measures need a load with the pins out"):
        read_load(written(tmp_path, text))


def test_another_measure_is_another_scene(tmp_path):
    scenes = [
        Scene.read("device", [f"load.netlist={written(tmp_path, text)}"])
        for text in (OWN, OWN.replace("v(far)>0", "v(far)>1"))
    ]
    assert scenes[0].digest() != scenes[1].digest()


@pytest.mark.slow
@pytest.mark.parametrize("method", ["monte-carlo", "circuit"])
def test_both_engines_find_what_the_circuit_equations_say(pool, tmp_path, method):
    """Losses and output make up what leaves the piezo, half of the time the voltage is positive.

    Of the engines' own error bar four times (one false alarm in 16 000), of the rest 0.2 %.
    """
    sets = ["run.duration=20", "run.settle=1", "run.realizations=4"]
    scene = Scene.read("device", [*sets, f"load.netlist={written(tmp_path)}"])
    result = simulate(scene, method=method, runner=pool)
    found = {name: result[name].estimate for name in result.quantities}
    parts = found["line_loss"] + found["rest_power"] + found["far_storage_power"]
    assert parts == pytest.approx(found["mean_power"], rel=2e-3)
    share = result["positive_time_share"]
    assert abs(share.estimate - 0.5) < 4.0 * share.standard_error + 1e-3
    # What flows into the far side while it is positive, is used or stored there.
    each = found["positive_energy"] * found["positive_stops_per_hour"] / 3600.0
    assert each == pytest.approx(0.5 * found["rest_power"], rel=0.05)
    assert math.isclose(found["mean_output_power"], found["rest_power"], rel_tol=1e-3)


@pytest.mark.parametrize("count", [30, 41])
def test_a_power_that_jumps_is_integrated_within_the_steps(tmp_path, count):
    """Of floor(v) and v > 3 on a triangle of 10 V, sampled three times a volt or less."""
    path = tmp_path / "load.lib"
    path.write_text(
        ".subckt load p n out ref\n* measure: output q = floor(v(p,n))\n"
        "* measure: loss above = v(p,n)>3\nRo out ref 1k\nRp p n 1k\n.ends\n"
    )
    measurement = measurement_of(read_load(path), {})
    time = np.linspace(0.0, 1.0, count)
    triangle = 10.0 * (1.0 - np.abs(2.0 * time - 1.0))
    unknowns = np.array([triangle * (name == "p") for name in measurement.watched])
    values = measurement.values(time, unknowns, 1.0)
    exact = np.interp(np.linspace(0.0, 1.0, 100_001), time, triangle)
    for row, right in zip(values, (np.floor(exact).mean(), (exact > 3.0).mean()), strict=False):
        assert np.trapezoid(row, time) == pytest.approx(right, rel=2e-3)
