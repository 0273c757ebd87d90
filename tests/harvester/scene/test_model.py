import math
from dataclasses import FrozenInstanceError

import pytest
from truths import flat, well

from harvester.averaging.of_scene import average
from harvester.base.errors import SceneError
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing


def test_every_built_in_scene_loads_and_has_finite_parameters():
    old = {"device", "duffing", "linear", "paper", "paper_si"}
    added = {"asymmetric", "bimorph", "cantilever", "electromagnetic", "one_sided", "tristable"}
    added |= {"bimorph_bare", "geophone"}
    assert set(Scene.names()) == old | added
    for name in Scene.names():
        ready = prepared(Scene.read(name))
        system, scales = ready.system, ready.scales
        assert all(math.isfinite(value) for value in numbers(system))
        assert scales.voltage > 0


def numbers(part):
    """All numbers of a part and of the parts in it."""
    return [n for each in part for n in numbers(each)] if isinstance(part, tuple) else [part]


def test_si_and_scaled_forms_of_the_paper_give_the_same_parameters():
    scaled = prepared(Scene.read("paper")).system
    ready = prepared(Scene.read("paper_si"))
    si, scales = ready.system, ready.scales
    assert numbers(si) == pytest.approx(numbers(scaled), rel=1e-12)
    # "One scaled volt is 6.05 mV".
    assert scales.voltage == pytest.approx(6.05e-3)
    assert scales.of("voltage^2") == pytest.approx(6.05e-3**2)
    assert scales.of("velocity^2") == pytest.approx(1e-6)


def test_the_length_scale_is_the_wells_distance_where_none_is_given():
    scene = Scene.read("device", ["length_scale=none"])
    scales = prepared(scene).scales
    assert scales.displacement == pytest.approx(math.sqrt(63.451 / 634509.0))
    assert flat(scene).rest == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("oscilator.damping=1", ["oscilator", "oscillator"]),
        ("oscillator.dampng=1", ["oscillator.dampng", "damping"]),
        ("oscillator.Q=20", ["oscillator.Q; there are damping, quadratic_damping"]),
        ("excitation.intensity=0.5g", ["4.90332 (m/s²) for 0.5 g of acceleration"]),
        ("excitation.intensity=-20 g", ["-196.133 (m/s²)", "-0.02 (kg)"]),
        ("oscillator.damping=-1", ["oscillator.damping", "≥ 0"]),
        ("oscillator.damping=true", ["oscillator.damping", "number"]),
        ("oscillator.damping=soft", ["oscillator.damping", "'soft'"]),
        ("oscillator.mass=1", ["oscillator.mass", "SI"]),
        ("stoppers.restitution=1.01", ["stoppers.restitution", "[0, 1]"]),
        ("stoppers.gap=0", ["stoppers.gap", "> 0"]),
        ("stoppers.gap=nan", ["stoppers.gap", "> 0"]),
        ("stoppers.gap=inf", ["stoppers.gap"]),
        ("stoppers.impact_velocity=events", ["impact_velocity", "event"]),
        ("excitation.correlation_time=0", ["excitation.correlation_time", "> 0"]),
        ("excitation.kind=whit", ["excitation.kind", "did you mean white"]),
        ("run.seed=1.5", ["run.seed", "whole number"]),
        ("run.seed=-1", ["run.seed"]),
        ("run.realizations=0", ["run.realizations", "[1, "]),
        ("run.duration=none", ["run.duration", "missing"]),
        ("run=none", ["run.duration", "missing"]),
        ("units=imperial", ["units", "scaled", "SI"]),
        ("oscillator.cubic_stiffness=-1", ["cubic_stiffness", "≥ 0"]),
        ("load.kind=resitor", ["load.kind", "did you mean resistor"]),
        ("stoppers=1", ["stoppers", "table"]),
        ("oscillator.damping", ["table.key=value"]),
        ("a.b.c=1", ["a.b.c"]),
    ],
)
def test_a_mistake_is_refused_in_one_line_that_names_it(override, words):
    with pytest.raises(SceneError) as caught:
        Scene.read("paper", [override])
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


def test_motions_without_bound_or_stationary_state_are_refused():
    with pytest.raises(SceneError, match="unbounded"):
        Scene.read("duffing", ["oscillator.cubic_stiffness=0"])
    with pytest.raises(SceneError, match="stationary"):
        Scene.read("linear", ["oscillator.damping=0", "piezo.coupling=0"])


def test_the_refusal_of_an_assignment_names_replace():
    scene = Scene.read("paper", ["stoppers.side=left"])
    tables = {
        "oscillator.": scene.oscillator,
        "excitation.": scene.excitation,
        "stoppers.": scene.stoppers[0],
        "run.": scene.run,
        "piezo.": scene.transducer,
        "": scene,
    }
    for name, table in tables.items():
        with pytest.raises(FrozenInstanceError, match=rf'scene\.replace\(\{{"{name}mass": 3'):
            table.mass = 3
    with pytest.raises(FrozenInstanceError, match=r'scene\.replace\(\{"run\.seed": 3'):
        scene["run.seed"] = 3


def test_unknown_scene_and_broken_file_are_refused(tmp_path):
    with pytest.raises(SceneError, match="did you mean paper"):
        Scene.read("papr")
    broken = tmp_path / "broken.toml"
    broken.write_text("units = \n")
    with pytest.raises(SceneError, match=r"broken\.toml: not a TOML file"):
        Scene.read(broken)
    with pytest.raises(SceneError, match="no such scene file"):
        Scene.read(tmp_path / "missing.toml")
    for word in ("brken.toml", "broken.tml"):
        with pytest.raises(SceneError, match=r"did you mean .*broken\.toml"):
            Scene.read(tmp_path / word)


def test_a_suffix_that_is_no_number_is_answered_in_the_unit_of_the_key():
    for key, text, answer in (
        ("oscillator.mass", "8.6g", r"write 0\.0086 \(kg\) for 8\.6 grams$"),
        ("excitation.rms", "0.5 g", r"write 4\.90332 \(m/s²\) for 0\.5 g of acceleration$"),
        ("oscillator.damping_ratio", "0.5g", "write 0.5, without the unit g$"),
        ("oscillator.damping_ratio", "2.5 %", "write 0.025 for 2.5 %$"),
    ):
        with pytest.raises(SceneError, match=answer):
            Scene.read("device", [f"{key}={text}"])


def test_replace_refuses_keys_that_exclude_each_other():
    scene = Scene.read("device")
    for changes in (
        {"load.resistance": 5e4, "load.netlist": "bridge"},
        {"load.netlist": "bridge", "load.resistance": 5e4},
    ):
        with pytest.raises(SceneError, match=r"replace load\..* exclude each other"):
            scene.replace(changes)
    with pytest.raises(SceneError, match="exclude each other"):
        scene.replace(load={"resistance": 5e4, "netlist": "bridge"})


def test_replace_checks_and_leaves_the_original_alone():
    scene = Scene.read("paper")
    changed = scene.replace({"stoppers.gap": 1.2}, excitation={"intensity": 0.1}, run={"seed": 9})
    assert (changed.stoppers[0].gap, changed.excitation.intensity, changed.run.seed) == (
        1.2,
        0.1,
        9,
    )
    assert scene.stoppers[0].gap == 1.1
    assert scene.replace(stoppers=None).stoppers == ()
    with pytest.raises(SceneError, match=r"stoppers\.gap"):
        scene.replace({"stoppers.gap": -1.0})


def test_a_copy_may_have_another_name():
    scene = Scene.read("linear")
    for copy in (scene.replace(name="mine"), scene.replace({"name": "mine", "run.seed": 1})):
        assert (copy.name, copy.oscillator) == ("mine", scene.oscillator)
    assert scene.replace(name="mine").digest() == scene.digest()
    assert Scene.from_dict({"name": "mine", **scene.to_tables()}).name == "mine"
    with pytest.raises(SceneError, match="name = 3: must be a text"):
        scene.replace(name=3)
    with pytest.raises(SceneError, match=r"unknown key seed .did you mean run\.seed"):
        scene.replace(seed=3)


def test_a_scene_survives_its_tables_and_its_digest_tells_scenes_apart():
    scene = Scene.read("paper_si")
    again = Scene.from_tables(scene.to_tables(), name=scene.name)
    assert again == scene
    assert again.digest() == scene.digest()
    assert scene.replace({"run.seed": 2}).digest() != scene.digest()


@pytest.mark.parametrize("name", ["paper", "paper_si", "duffing"])
def test_the_knot_spacing_left_out_follows_the_fastest_time(name):
    scene = Scene.read(name)
    assert scene.excitation.knot_spacing is None
    assert knot_spacing(prepared(scene)) == 0.05
    fast = Scene.read(name, ["excitation.correlation_time=0.02"])
    assert knot_spacing(prepared(fast)) == 0.0025
    stiff = scene.replace({"oscillator.linear_stiffness": 400 * scene.oscillator.linear_stiffness})
    assert knot_spacing(prepared(stiff)) < 0.006


@pytest.mark.slow
@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["excitation.knot_spacing=0.5"], ["knot_spacing", "0.4"]),
        (["excitation.knot_spacing=0.05", "excitation.correlation_time=0.02"], ["0.05", "0.02"]),
        (["excitation.knot_spacing=0.3", "run.duration=0.2"], ["run.duration", "0.3"]),
    ],
)
def test_knots_that_do_not_fit_are_refused_by_what_needs_them_and_not_by_averaging(
    overrides, words
):
    scene = Scene.read("paper", overrides)
    with pytest.raises(SceneError) as caught:
        simulate(scene, method="monte-carlo")
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)
    plain = scene.replace({"excitation.knot_spacing": None})
    one, other = (average(each, method="consistent").scaled_quantities for each in (scene, plain))
    assert one == other


@pytest.mark.parametrize(
    ("text", "value"),
    [
        (".1", 0.1),
        ("-.5", -0.5),
        ("+.5", 0.5),
        ("+3", 3),
        ("1.", 1.0),
        ("1e3", 1000.0),
        ("5.e-1", 0.5),
        ("007", 7),
    ],
)
def test_a_number_on_the_command_line_may_be_written_as_in_python(text, value):
    scene = Scene.read("paper", [f"oscillator.linear_stiffness={text}"])
    assert scene.oscillator.linear_stiffness == value


@pytest.mark.parametrize("word", ["nan", "inf", "-inf", "NaN", "Infinity", "1.e999"])
def test_a_word_that_python_takes_for_a_number_is_none(word):
    with pytest.raises(SceneError, match=r"oscillator\.linear_stiffness = .*: must be a number"):
        Scene.read("paper", [f"oscillator.linear_stiffness={word}"])


def test_a_preloaded_mass_rests_between_gap_and_well():
    parameters = flat(Scene.read("paper", ["stoppers.gap=0.95"]))
    x = parameters.rest
    assert 0.95 < x < well(parameters)
    force = -4.0 * x + parameters.cubic_stiffness * x**3 + 10.0 * (x - 0.95) ** 1.5
    assert force == pytest.approx(0.0, abs=1e-12)


def test_an_impact_speed_is_held_for_one_stopper_on_a_side():
    stopper = {"gap": 1.1, "stiffness": 10.0, "restitution": 0.7, "impact_velocity": "event"}
    tables = Scene.read("paper").to_tables()
    left = {**stopper, "side": "left"}
    Scene.from_tables({**tables, "stoppers": [{**stopper, "side": "right"}, left]})
    with pytest.raises(SceneError, match='"event" with 2 stoppers on the left'):
        Scene.from_tables({**tables, "stoppers": [stopper, {**left, "impact_velocity": "energy"}]})


@pytest.mark.parametrize(
    "build", [lambda tables: Scene(), Scene, lambda tables: Scene(**tables), lambda _: Scene.load]
)
def test_a_scene_is_read_or_built_from_tables(build):
    with pytest.raises((SceneError, AttributeError), match=r"Scene\.read\(.*Scene\.from_tables"):
        build(Scene.read("linear").to_tables())


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"noise": {}}, "unknown key noise.*; there are .*oscillator, .*excitation, run"),
        ({"transducer": {}}, "unknown key transducer.*; there are .*piezo, coil"),
        ({"load": 2e5}, r'load = 200000.0: must be a table such as \{"resistance": …\}'),
        ({"load": None}, r"table \[load\] is missing; it takes kind, resistance, .*netlist"),
    ],
)
def test_tables_that_make_no_scene_are_named(tables, words):
    content = {**Scene.read("linear").to_tables(), **tables}
    content = {name: table for name, table in content.items() if table is not None}
    with pytest.raises(SceneError, match=words):
        Scene.from_tables(content)


def test_overrides_may_be_a_dictionary():
    changes = {"load.resistance": 2e5, "stoppers": None}
    scene = Scene.read("device", changes)
    assert scene == Scene.read("device").replace(changes)
    with pytest.raises(SceneError, match=r"load\.resistance = '2e5'.*without quotes"):
        Scene.read("device", {"load.resistance": "2e5"})
