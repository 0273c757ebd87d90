"""Values that a sub-circuit says it is not made for, wherever they come from."""

import pytest

from circuits.netlist.subcircuits import find_netlist, read_load
from harvester.base.errors import NetlistError, SceneError
from harvester.scene.model import Scene

# Two calls of one part, the second's values worked out from the load's own.
OWN = """* a load of one's own
.param wide=3
.subckt own p n low=1 high=2
.param middle={(low+high)/2}
Xfirst p a part least={low} most={middle}
Xsecond a n part least={middle} most={wide*high}
.ends
* a part
.subckt part a b least=1 most=2
* Needs: 0 < least && least < most
.param mean={(least+most)/2}
R1 a b {1k*mean}
.ends
"""


def read(tmp_path, text=OWN, **values):
    path = tmp_path / "own.lib"
    path.write_text(text)
    return read_load(path, parameters=values)


@pytest.mark.parametrize(
    ("values", "seen"),
    [
        ({"low": 3}, "least = 3, most = 2.5"),
        ({"low": "3k", "high": "-1k"}, "least = 3000, most = 1000"),
        ({"wide": 0.1}, "least = 1.5, most = 0.2"),
        ({"middle": -1}, "least = 1, most = -1"),
    ],
)
def test_values_that_a_part_is_not_made_for_are_refused_with_its_line(tmp_path, values, seen):
    with pytest.raises(NetlistError) as told:
        read(tmp_path, **values)
    assert str(told.value) == f"own.lib:10: part needs 0 < least && least < most here, with {seen}"


def test_values_that_it_is_made_for_are_taken(tmp_path):
    assert read(tmp_path).parameters == ()
    assert read(tmp_path, high=10).parameters == (("high", 10.0),)


@pytest.mark.parametrize(
    ("condition", "fault"),
    [
        ("leest < most", "unknown name leest"),
        ("least <", "missing operand at the end"),
        ("", "missing operand"),
        ("v(a) < most", "cannot be checked: must be constant"),
        ("time < most", "cannot be checked: time changes"),
        ("sqrt(-least) < most", "cannot be checked: sqrt"),
    ],
)
def test_a_condition_that_means_nothing_is_refused(tmp_path, condition, fault):
    with pytest.raises(NetlistError, match=rf"own\.lib:10: .*{fault}"):
        read(tmp_path, OWN.replace("0 < least && least < most", condition))


def test_it_stands_within_a_sub_circuit(tmp_path):
    with pytest.raises(NetlistError, match=r"own\.lib:2: needs: put it into the \.subckt"):
        read(tmp_path, OWN.replace(".param wide", "* needs: wide > 1\n.param wide"))


@pytest.mark.parametrize("comment", ["*needs a heat sink", "*measured at 20 C", "* needs, maybe"])
def test_other_comments_stay_comments(tmp_path, comment):
    read(tmp_path, OWN.replace("R1 a b", f"{comment}\nR1 a b"))


@pytest.mark.parametrize(
    ("load", "values", "where"),
    [
        ("node_buck", {"period": "1m"}, "sensor_nodes.lib"),
        ("node_buck", {"stop": "3.1"}, "sensor_nodes.lib"),
        ("node_buck", {"efficiency": 1.5}, "buck_converters.lib"),
        ("node_buck", {"clamp": 0}, "buck_converters.lib"),
        ("node_boost", {"fraction": 1.2}, "boost_chargers.lib"),
        ("node_boost", {"capacitance": 0}, "supercapacitors.lib"),
        ("bridge_buck", {"falling": 3}, "buck_converters.lib"),
        ("bridge", {"diode": 7}, "diodes.lib"),
        ("bridge_ideal", {"drop": 0}, "bridge_ideal.lib"),
        ("bridge_ideal", {"resistance": "100k"}, "bridge_ideal.lib"),
        ("sece", {"residual": 0}, "sece.lib"),
        ("sshi_series", {"quality": -5}, "sshi_series.lib"),
    ],
)
def test_loads_of_the_library_say_what_they_are_made_for(load, values, where):
    with pytest.raises(NetlistError, match=rf"^{where}:\d+: \w+ needs .* = "):
        read_load(find_netlist(load), parameters=values)


def test_values_for_scaled_scenes_are_refused_in_si():
    """Its leakage is 100 kΩ a diode where the conductance is left at 1e4 S."""
    with pytest.raises(SceneError, match="give conductance, resistance, storage"):
        Scene.read("cantilever").replace({"load.netlist": "bridge_ideal"})
    values = {"resistance": "100k", "storage": "10u", "conductance": 10}
    scene = Scene.read("cantilever").replace(
        load={"netlist": "bridge_ideal", "kind": None, "resistance": None, "parameters": values}
    )
    assert scene.load.circuit.name == "bridge_ideal"
    assert Scene.read("paper").replace({"load.netlist": "bridge_ideal"}).load.circuit
