import re

import pytest

from circuits.equivalent.assembly import assemble
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing, stop_time

MECHANICS = {"Cdisplacement", "Gvelocity", "Cmass", "Gspring", "Rdamper", "Inoise"}
ELECTRICS = {"Cpiezo", "Gcharge", "Xload"}
BACK = {"Gback_action"}
HOLD = {"Cheld_speed", "Bheld_speed", "Clagging_speed", "Blagging_speed"}
ASYMMETRIC = MECHANICS | ELECTRICS | BACK | {"Itilt", "Bnonlinear_spring"}
COIL = {"Einduced", "Rwinding", "Fback_action", "Vload", "Xload"}


def elements(netlist):
    """Names of the elements outside sub-circuits."""
    names, inside = set(), False
    for line in netlist.text.splitlines():
        inside = (inside or line.startswith(".subckt")) and not line.startswith(".ends")
        if line and line[0].isalpha() and not inside:
            names.add(line.split()[0])
    return names


@pytest.mark.parametrize(
    ("name", "overrides", "expected"),
    [
        ("linear", [], MECHANICS | ELECTRICS | BACK),
        ("linear", ["piezo.coupling=0"], MECHANICS | ELECTRICS),
        ("linear", ["oscillator.damping=0"], (MECHANICS - {"Rdamper"}) | ELECTRICS | BACK),
        ("duffing", [], MECHANICS | ELECTRICS | BACK | {"Bcubic"}),
        ("device", [], MECHANICS | ELECTRICS | BACK | {"Bcubic"}),
        ("paper", [], MECHANICS | ELECTRICS | BACK | {"Bcubic", "Bstoppers"}),
        ("paper", ["stoppers=none"], MECHANICS | ELECTRICS | BACK | {"Bcubic"}),
        ("paper", ["stoppers.stiffness=0"], MECHANICS | ELECTRICS | BACK | {"Bcubic"}),
        (
            "paper",
            ["oscillator.linear_stiffness=0"],
            (MECHANICS - {"Gspring"}) | ELECTRICS | BACK | {"Bcubic", "Bstoppers"},
        ),
        (
            "paper_si",
            ["stoppers.impact_velocity=event"],
            MECHANICS | ELECTRICS | BACK | {"Bcubic", "Bstoppers"} | HOLD,
        ),
        (
            "paper",
            ["stoppers.impact_velocity=event", "stoppers.restitution=1"],
            MECHANICS | ELECTRICS | BACK | {"Bcubic", "Bstoppers"},
        ),
        ("asymmetric", [], ASYMMETRIC),
        ("asymmetric", ["start.velocity=0.1"], ASYMMETRIC),
        ("tristable", [], MECHANICS | ELECTRICS | BACK | {"Bnonlinear_spring"}),
        ("one_sided", [], MECHANICS | ELECTRICS | BACK | {"Bstopper_right"}),
        ("electromagnetic", [], MECHANICS | COIL | {"Itilt", "Bnonlinear_spring"}),
        (
            "electromagnetic",
            ["coil.inductance=0.1"],
            MECHANICS | COIL | {"Itilt", "Bnonlinear_spring", "Lcoil"},
        ),
        (
            "device",
            ["piezo.leakage_resistance=1e6", "oscillator.quadratic_damping=0.1"],
            MECHANICS | ELECTRICS | BACK | {"Bcubic", "Rleak", "Bdrag"},
        ),
    ],
)
def test_a_scene_holds_only_what_it_needs(name, overrides, expected):
    assert elements(assemble(prepared(Scene.read(name, overrides)))) == expected


def test_elastic_stoppers_have_no_damping_term_and_preloaded_ones_a_bounded_one():
    elastic = assemble(prepared(Scene.read("paper", ["stoppers.restitution=1"]))).text
    damped = assemble(prepared(Scene.read("paper"))).text
    preloaded = assemble(prepared(Scene.read("paper", ["stoppers.gap=0.95"]))).text
    assert "v(velocity)" not in re.search(r"Bstoppers.*", elastic).group()
    assert re.search(r"Bstoppers.*", damped).group().count("?") == 1
    assert re.search(r"Bstoppers.*", preloaded).group().count("?") == 2


@pytest.mark.parametrize("name", Scene.names())
def test_mechanical_values_are_of_order_one_whatever_the_units(name):
    text = assemble(prepared(Scene.read(name))).text
    for element in ("Gspring", "Gvelocity"):
        value = float(re.search(rf"^{element} .* (\S+)$", text, re.MULTILINE).group(1))
        assert 0.1 < abs(value) < 10.0
    cubic = re.search(r"Bcubic.*i=\(([\d.e+-]+)\*", text)
    assert bool(cubic) == (name in ("paper", "paper_si", "duffing", "device"))
    if cubic:
        assert 0.1 < float(cubic.group(1)) < 10.0


def test_the_same_device_in_both_units_has_the_same_mechanical_elements():
    def mechanical(name):
        lines = assemble(prepared(Scene.read(name))).text.splitlines()
        return [
            [float(number) for number in re.findall(r"(?<![\w.])\d+\.\d+(?:e-?\d+)?", line)]
            for line in lines
            if line.startswith(("Cdisp", "Cmass", "Gspring", "Rdamper", "Bcubic", "Bstoppers"))
        ]

    for ours, theirs in zip(mechanical("paper"), mechanical("paper_si"), strict=True):
        assert ours == pytest.approx(theirs, rel=1e-12)


def test_nothing_is_kept_in_memory_that_streams_out():
    assert ".save none" in assemble(prepared(Scene.read("paper"))).text


def test_the_digest_tells_netlists_apart():
    one, other = assemble(prepared(Scene.read("paper"))), assemble(prepared(Scene.read("paper")))
    assert one.sha256 == other.sha256
    assert assemble(prepared(Scene.read("paper")), starts=((-1.0, 0.0, 0.0),)).sha256 != one.sha256


def test_the_end_time_is_a_whole_number_of_knots():
    scene = Scene.read("paper", ["run.realizations=2", "run.duration=10.01", "run.settle=0"])
    ready = prepared(scene)
    assert stop_time(ready) == pytest.approx(10.05)
    assert stop_time(ready) / knot_spacing(ready) == pytest.approx(201)
