"""Values of one of several tables, and what a study may vary of them."""

import pytest

from harvester.base.errors import SceneError
from harvester.scene.model import Scene
from harvester.scene.numbers import numbers
from harvester.scene.overrides import parsed

ONE = '{{side = "{}", gap = {}, stiffness = 10.0, restitution = 0.7}}'
TWO = f"stoppers=[{ONE.format('right', 1.1)}, {ONE.format('left', 0.7)}]"
SUM = (
    'excitation={kind = "sum", parts = [{kind = "white", intensity = 0.1}, '
    '{kind = "sine", amplitude = 1.0, frequency = 3.0}]}'
)


def test_a_place_names_one_of_several_tables():
    scene = Scene.read("duffing", [TWO, "stoppers[1].gap=0.9", "stoppers[0].exponent=2"])
    assert [each.gap for each in scene.stoppers] == [1.1, 0.9]
    assert [each.exponent for each in scene.stoppers] == [2.0, 1.5]
    assert scene.replace({"stoppers[0].side": "left"}).stoppers[0].side == "left"
    assert scene.replace({"stoppers[0]": None}).stoppers == scene.stoppers[1:]
    excited = Scene.read("device", [SUM, "excitation.parts[0].intensity=0.5"])
    assert excited.excitation.parts[0].intensity == 0.5


def test_the_last_value_of_a_key_counts():
    assert Scene.read("linear", ["run.seed=2", "run.seed=3"]).run.seed == 3


def test_one_table_is_the_first_of_its_kind_too():
    assert Scene.read("paper", ["stoppers[0].gap=1.2"]).stoppers[0].gap == 1.2
    assert Scene.read("one_sided", ["stoppers.gap=0.002"]).stoppers[0].gap == 0.002
    assert Scene.read("one_sided", ["stoppers[0]=none"]).stoppers == ()


def test_a_number_may_begin_or_end_with_its_point_in_a_list_and_in_a_table():
    tables = "stoppers=[{gap = .5, stiffness = 10., restitution = -.0, side = 'left'}]"
    (stopper,) = Scene.read("duffing", [tables]).stoppers
    assert (stopper.gap, stopper.stiffness, stopper.restitution) == (0.5, 10.0, 0.0)
    force = Scene.read("duffing", ["oscillator.restoring_force=[-.25, 1.,.5, 2]"])
    assert force.oscillator.restoring_force == (-0.25, 1.0, 0.5, 2.0)
    # What stands in quotes is a text.
    assert parsed("load.parameters={value = '.5', more = .5}")[1] == {"value": ".5", "more": 0.5}
    assert parsed("load.netlist=../.5/1.cir")[1] == "../.5/1.cir"
    assert [parsed(f"a.b={text}")[1] for text in (".1", "1.", "-.1", "1.e3")] == [0.1, 1, -0.1, 1e3]


@pytest.mark.parametrize(
    ("scene", "overrides", "words"),
    [
        ("duffing", [TWO, "stoppers[2].gap=1"], "there are 2 .* stoppers.1."),
        ("duffing", [TWO, "stoppers.gap=1"], "several tables, stoppers.0. and stoppers.1."),
        ("duffing", [TWO, "stoppers[1].gpa=1"], r"stoppers\[1\].gpa \(did you mean gap\?\)"),
        ("duffing", [TWO, "stopers[1].gap=1"], "did you mean stoppers"),
        ("duffing", ["stoppers[0].gap=1"], "no stoppers here"),
        ("paper", ["stoppers[1].gap=1"], "one table"),
        ("paper", ["oscillator[0].damping=1"], "write oscillator.key"),
        ("device", [SUM, "excitation.parts[7].intensity=1"], "there are 2 of parts"),
        ("device", [SUM, "excitation.parts[0].intnsity=1"], "did you mean intensity"),
    ],
)
def test_a_wrong_place_is_refused_by_name(scene, overrides, words):
    with pytest.raises(SceneError, match=words):
        Scene.read(scene, overrides)


def test_a_study_may_vary_the_numbers_of_each_table():
    found = numbers(Scene.read("duffing", [TWO]))
    assert found["stoppers[1].gap"][0] == 0.7
    assert "run.duration" not in found
    found = numbers(Scene.read("device", [SUM]))
    assert found["excitation.parts[1].frequency"][0] == 3.0
    assert found["piezo.coupling"][0] == 3.69e-4
    coil = numbers(Scene.read("electromagnetic"))
    assert {"coil.coupling", "coil.resistance", "load.resistance"} <= set(coil)
    assert not [key for key in coil if key.startswith("piezo")]


def test_a_slip_within_a_table_is_named():
    with pytest.raises(SceneError, match=r'--set excitation: \{kind="sine" a=1\} is no TOML: Uncl'):
        parsed('excitation={kind="sine" a=1}')
    # A file's name may begin with a bracket.
    assert parsed("excitation.file=[1] road.csv") == ("excitation.file", "[1] road.csv")
