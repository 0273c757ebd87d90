"""Frequency and quality factor in place of stiffness and damping; suffixes; another kind."""

import math

import pytest
from scipy.optimize import brentq

from harvester.base.errors import SceneError
from harvester.base.formatting import quantity
from harvester.base.numbers import NotANumber
from harvester.base.signatures import grid_of, pair_of, range_of
from harvester.excitation.sine import Sine
from harvester.scene.described import device_line, scene_rows
from harvester.scene.model import Scene
from harvester.scene.numbers import numbers
from harvester.scene.units import rest_stiffness


def test_frequency_and_quality_factor_are_kept_and_the_others_follow():
    """Closed forms: K = M (2πf)², C = M 2πf/Q; at a well of ±x the stiffness is −2 K1."""
    scene = Scene.read("cantilever", ["oscillator.quality_factor=20"])
    for mass in (14.04e-3, 0.03):
        scene = scene.replace({"oscillator.mass": mass})
        rate = 2.0 * math.pi * 45.7
        assert scene.oscillator.linear_stiffness == pytest.approx(mass * rate**2, rel=1e-14)
        assert scene.oscillator.damping == pytest.approx(mass * rate / 20.0, rel=1e-14)
    assert scene.to_tables()["oscillator"] == {
        "mass": 0.03, "frequency": 45.7, "quality_factor": 20.0, "cubic_stiffness": 0.0,
        "base_factor": 1.0854,
    }  # fmt: skip
    assert {"oscillator.frequency", "oscillator.quality_factor"} <= {*numbers(scene)}
    assert Scene.from_dict(scene.to_dict()) == scene
    plain = scene.replace({"oscillator.damping": 0.3, "oscillator.linear_stiffness": 900.0})
    assert plain.oscillator.frequency is plain.oscillator.quality_factor is None
    bistable = Scene.read("device", ["oscillator.damping_ratio=0.01"])
    rest = math.sqrt(2.0 * 63.451 * 0.022)
    assert bistable.oscillator.damping == pytest.approx(2.0 * 0.01 * rest, rel=1e-9)


def test_a_page_shows_values_without_rounding_errors():
    scene = Scene.read("device").replace({"load.netlist": "bridge", "load.resistance": None})
    varied = [
        scene.replace({"load.parameters": {"resistance": value, "storage": 9.999999999999999e-6}})
        for value in (10000.0, 20000.000000000004)
    ]
    rows = dict(scene_rows(varied))
    assert rows["load.parameters.resistance"] == "10 kΩ, 20 kΩ"
    assert rows["load.parameters.storage"] == "10u"
    assert (rows["run.seed"], rows["load.netlist"]) == ("1", "bridge")


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (
            ["oscillator.damping=none"],
            r"missing; it takes a number ≥ 0 \(N s/m\), or give",
        ),
        (["oscillator={mass=1,frequency=2,linear_stiffness=3,damping=1}"], "exclude each other"),
        (["oscillator={mass=1,frequency=2,damping=1,quality_factor=3}"], "exclude each other"),
        (["oscillator.restoring_force=[0,0,0,5]", "oscillator.quality_factor=9"], "no stiffness"),
        (["load.resistance=2M"], "M is 1e6 in SI and 1e-3 in SPICE: write 2meg or 2m"),
        (["load.resistance=2q"], "unknown suffix q"),
        (["load.resistance='2'"], "must be a number > 0"),
    ],
)
def test_refusals(overrides, words):
    with pytest.raises(SceneError, match=words):
        Scene.read("device", overrides)


def test_scaled_scenes_have_no_hertz():
    with pytest.raises(SceneError, match='units = "SI"'):
        Scene.read("paper", ["oscillator.frequency=1"])


def test_suffixes_are_exact():
    for text, value in (
        ("200k", 200e3), ("4.7meg", 4.7e6), ("41.26n", 41.26e-9), ("3p", 3e-12), ("5u", 5e-6),
        ("1e2m", 0.1),
    ):  # fmt: skip
        assert Scene.read("device", [f"load.resistance={text}"]).load.resistance == value
    assert grid_of("10k:1meg:log:3") == pytest.approx([1e4, 1e5, 1e6])
    assert pair_of(range_of)("load.resistance=10k:1meg") == ("load.resistance", (1e4, 1e6))
    with pytest.raises(NotANumber, match="write 1meg or 1m"):
        grid_of("10k:1M:log:3")


def test_a_range_may_start_below_zero_and_a_unit_is_refused_with_the_number_to_write():
    steps = [-8e-3, -4e-3, 0.0, 4e-3, 8e-3]
    for text in ("-8m:8m:5", "-8m:8m:linear:5"):
        assert grid_of(text) == pytest.approx(steps, abs=1e-18)
    with pytest.raises(NotANumber, match="write -8m, without the unit m"):
        grid_of("-8mm:8mm:5")
    for text, written in (("100kΩ", "100k"), ("5 Hz", "5"), ("3uF", "3u")):
        with pytest.raises(SceneError, match=f"write {written}, without the unit"):
            Scene.read("device", [f"load.resistance={text}"])
    with pytest.raises(ValueError, match="above 0: -1 is not"):
        grid_of("-1:1:log:5")


def test_another_kind_leaves_the_keys_of_the_former_behind():
    scene = Scene.read("device")
    changes = {"excitation.amplitude": 4.0, "excitation.kind": "sine", "excitation.frequency": 12.0}
    assert scene.replace(changes).excitation == Sine(4.0, 12.0)
    with pytest.raises(SceneError, match="amplitude is missing"):
        scene.replace({"excitation.kind": "sine"})
    same = scene.replace({"excitation.kind": "ornstein-uhlenbeck"})
    assert same.excitation == scene.excitation


def test_the_line_on_the_device():
    """Published: 45.7 Hz, Q = 1/(2·0.027), 48.2 Hz open, matched 1/(ω Cp)."""
    (line,) = device_line(Scene.read("cantilever"))
    assert "45.7 Hz at rest, stiffness 1158 N/m" in line
    assert "Q = 18.5, damping ratio 0.027, k² = 0.113, matched load without coupling " in line
    assert line.endswith("1/(ω Cp) = 84.4 kΩ")
    assert math.sqrt(1.0 + 0.1133) * 45.7 == pytest.approx(48.22, abs=0.01)
    assert device_line(Scene.read("paper")) == ()


def test_the_line_on_the_device_has_wells_and_barriers():
    """Closed form: wells at ±√(−k1/k3), barrier k1²/(4 k3); `asymmetric` as on its page."""
    (line,) = device_line(Scene.read("device"))
    assert "wells at -10 mm, 10 mm, energy barriers 1.59 mJ, 1.59 mJ" in line
    (line,) = device_line(Scene.read("asymmetric"))
    assert "wells at -10.6 mm, 9.62 mm, energy barriers 1.07 mJ, 2.39 mJ" in line
    (line,) = device_line(Scene.read("tristable"))
    assert "wells at -12.8 mm, 0 m, 12.8 mm" in line


def test_the_line_on_a_mass_pressed_against_a_stopper_is_of_the_total_force():
    """Spring slope and 3/2 K √depth at the well, with its depth from the balance of forces."""
    stoppers = {"gap": 4e-3, "stiffness": 4e5, "restitution": 0.6}
    (line,) = device_line(Scene.read("device").replace(stoppers=stoppers))
    oscillator = Scene.read("device").oscillator
    linear, cubic = oscillator.linear_stiffness, oscillator.cubic_stiffness
    well = brentq(lambda x: linear * x + cubic * x**3 + 4e5 * (x - 4e-3) ** 1.5, 4e-3, 1e-2)
    stiffness = linear + 3.0 * cubic * well**2 + 1.5 * 4e5 * math.sqrt(well - 4e-3)
    rate = math.sqrt(stiffness / oscillator.mass)
    assert f"stiffness {stiffness:.4g} N/m" in line
    assert f"{quantity(rate / (2.0 * math.pi), 'Hz')} at rest" in line
    assert f"Q = {oscillator.mass * rate / oscillator.damping:.3g}" in line
    assert "(damper alone, without the pressed stopper)" in line


@pytest.mark.parametrize(
    ("name", "table", "storage", "stiffness"),
    [("cantilever", "piezo", "capacitance", None), ("electromagnetic", "coil", "inductance", 0.3)],
)
def test_k2_stands_for_the_coupling_and_is_kept(name, table, storage, stiffness):
    changes = {f"{table}.k2": 0.2} | ({f"{table}.{storage}": stiffness} if stiffness else {})
    scene = Scene.read(name).replace(changes)
    for copy in (scene, scene.replace({"oscillator.mass": 2.0 * scene.oscillator.mass})):
        product = rest_stiffness(copy.oscillator) * getattr(copy.transducer, storage)
        assert copy.transducer.coupling == pytest.approx(math.sqrt(0.2 * product), rel=1e-12)
        assert copy.to_tables()[table]["k2"] == 0.2
        assert "coupling" not in copy.to_tables()[table]
    assert Scene.from_dict(scene.to_dict()) == scene
    assert scene.replace({f"{table}.coupling": 1.0}).transducer.k2 is None


def test_rms_stands_for_the_intensity_and_is_kept():
    scene = Scene.read("device").replace({"excitation.rms": 6.0})
    assert scene.excitation.intensity == pytest.approx(0.36)
    longer = scene.replace({"excitation.correlation_time": 0.02})
    assert longer.excitation.intensity == pytest.approx(0.72)
    assert longer.to_tables()["excitation"]["rms"] == 6.0
    assert scene.replace({"excitation.intensity": 0.1}).excitation.rms is None


@pytest.mark.parametrize(
    ("name", "overrides", "words"),
    [
        ("electromagnetic", ["coil.inductance=none", "coil.k2=0.1"], "needs coil.inductance"),
        (
            "device",
            ["oscillator.restoring_force=[0,0,0,5]", "piezo.k2=0.1"],
            "no stiffness at rest",
        ),
        ("device", ["piezo={coupling=1,k2=1,capacitance=1e-9}"], "exclude each other"),
        ("paper", ["piezo.k2=0.1"], 'units = "SI"'),
    ],
)
def test_k2_is_refused_where_it_means_nothing(name, overrides, words):
    with pytest.raises(SceneError, match=words):
        Scene.read(name, overrides)


def test_overrides_that_take_each_other_out_are_refused():
    both = ["load.netlist=bridge", "load.resistance=10k"]
    for overrides in (both, both[::-1]):
        with pytest.raises(
            SceneError, match=r"overrides load\.\w+ and load\.\w+ exclude each other"
        ):
            Scene.read("device", overrides)
    assert Scene.read("device", [*both, "load.netlist=none"]).load.resistance == 1e4


def test_k2_of_a_coil_without_inductance_is_refused():
    overrides = ["coil.coupling=none", "coil.k2=0.1", "coil.inductance=0"]
    with pytest.raises(SceneError, match=r"coil\.k2 needs coil\.inductance > 0"):
        Scene.read("electromagnetic", overrides)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("oscillator.restoring_force[1]=2.0", "oscillator.linear_stiffness=1.0"),
        ("excitation.intensity=0.2", 'excitation={kind="white", density=0.1}'),
        ("stoppers.gap=0.5", "stoppers=none"),
    ],
)
def test_an_override_that_removes_an_earlier_one_is_refused_by_both_names(first, second):
    overrides = ["oscillator.damping=0.1", "oscillator.restoring_force=[0.0, 1.0, 0.0, 1.0]"]
    names = [text.partition("=")[0] for text in (first, second)]
    with pytest.raises(SceneError) as error:
        Scene.read("paper", [*overrides[: 1 + ("force" in first)], first, second])
    assert f"overrides {names[0]} and {names[1]} exclude each other" in str(error.value) or (
        f"overrides oscillator.restoring_force and {names[1]} exclude" in str(error.value)
    )
