"""Parts of a load that may deliver energy are named; R·C of its output is known by any names."""

import re

import pytest

from circuits.netlist.load_notes import reading_notes
from circuits.netlist.part_values import capacitance, conductance
from circuits.netlist.subcircuits import read_load
from harvester.base.errors import SimulatorAborted
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene


def read(tmp_path, text, **parameters):
    path = tmp_path / "load.lib"
    path.write_text(text)
    return read_load(path, parameters=parameters)


def test_sources_and_values_below_zero(tmp_path):
    text = (
        ".subckt load p n bias=0\nR1 p n 1k\nV1 p a {bias}\nR2 a b {1-bias}\nX1 b n cell r=-2k\n"
        "I1 a n dc 0\nC1 a n 1n\nR3 b n {v(p)*1k}\n"
        ".subckt cell a b r=1\nRc a b {r}\nV2 a c sin(0 1 50)\nR4 c b 1k\n.ends\n.ends\n"
    )
    load = read(tmp_path, text)
    assert load.sources == ("v2",)
    assert load.negative_parts == ("x1.rc (load.lib:10)",)
    load = read(tmp_path, text, bias=5.0)
    assert load.sources == ("v1", "v2")
    assert load.negative_parts == ("r2 (load.lib:4)", "x1.rc (load.lib:10)")


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["circuit", "monte-carlo"])
def test_a_value_below_zero_is_named_where_the_run_ends_early(tmp_path, pool, engine):
    scene = scene_with(tmp_path, "R1 p n -1k")
    with pytest.raises(SimulatorAborted, match=r"below 0 .* without bound: r1 \(load\.lib:2\)"):
        simulate(scene, method=engine, workers=1, runner=pool)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["circuit", "monte-carlo"])
def test_a_value_below_zero_is_noted_where_it_does_not(tmp_path, pool, engine):
    scene = scene_with(tmp_path, "R1 p a -1k\nR2 a n 100k")
    result = simulate(scene, method=engine, workers=1, runner=pool)
    (note,) = (note for note in result.notes if "counts as the piezo's" in note)
    assert re.match(r"the load has values below 0 \(r1 \(load\.lib:2\)\): any energy", note)


def scene_with(tmp_path, body):
    path = tmp_path / "load.lib"
    path.write_text(f".subckt load p n\n{body}\n.ends\n")
    short = ("run.duration=6", "run.settle=0.1", "run.realizations=1")
    return Scene.read("device", [f"load.netlist={path}", *short])


@pytest.mark.parametrize(("values", "seconds"), [({}, 8.0), ({"farads": "4u"}, 16.0)])
def test_what_lies_across_the_output_is_charged_in_r_c(tmp_path, values, seconds):
    """10 MΩ beside 6.67 MΩ in a sub-circuit, 2 uF within it; what does not lie there is no part."""
    text = (
        ".subckt load p n out ref ohms=10meg farads=2u\nR1 p out 1k\nR2 ref n 1k\nC1 p n 1n\n"
        "Rown out ref {ohms}\nX1 ref out rest r={2*ohms/3} c={farads}\n"
        ".subckt rest a b r=1 c=1\nRrest a b {r}\nCrest b a {c}\n.ends\n.ends\n"
    )
    across = read(tmp_path, text, **values).across_output
    assert capacitance(across) / conductance(across) == pytest.approx(seconds, rel=1e-12)
    assert capacitance(read(tmp_path, text.replace("Crest b a", "Crest b 0")).across_output) == 0.0


@pytest.mark.parametrize(
    ("body", "noted"),
    [
        ("B1 g ref V=tanh(v(out,ref)-3+v(h,ref))\nR1 g h 10k\nC1 h ref 1n", True),
        # A source that another one sets, and one that depends on the output alone.
        ("B1 g ref V=tanh(v(out,ref)-3+v(h,ref))\nR1 g a 10k\nC1 h ref 1n\nR2 h ref 1k", False),
        ("B1 g ref V=tanh(v(out,ref)-3)\nR1 g h 10k\nC1 h ref 1n", False),
    ],
)
def test_a_comparator_that_feeds_itself_is_noted(tmp_path, body, noted):
    """At default steps such a lockout delivered 12 % less by the circuit, 49 % by Monte Carlo."""
    load = read(tmp_path, f".subckt load p n out ref\nR0 p out 1k\n{body}\nRl out ref 1k\n.ends\n")
    notes = [each for each in reading_notes(load) if "its own output" in each]
    assert bool(notes) == noted
    assert all("b1 (load.lib:3)" in each and "the node h" in each for each in notes)
