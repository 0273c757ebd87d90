"""Sliders over a scene: where they reach, that the picture follows, and what is said of errors."""

import importlib.util

import numpy as np
import pytest
from truths import assert_near, flat, interpolated_linear_means

import harvester
from harvester.interop.explorer import FEWEST_REALIZATIONS, STEPS_SHOWN, cut_short
from harvester.scene.prepared import prepared

PNG = b"\x89PNG"


@pytest.fixture(scope="module")
def linear():
    pytest.importorskip("ipywidgets", reason="needs the extra `notebooks`")
    return harvester.explore(
        "linear", {"excitation.intensity": (0.01, 0.04), "piezo.coupling": (-1.0, 3.0)}
    )


def parts(explorer):
    """Sliders by key, line and picture of the widget."""
    box, line, picture = explorer.widget.children
    return {each.description: each for each in box.children}, line, picture


@pytest.mark.slow
def test_numbers_and_densities_are_those_of_the_place(linear):
    view = linear.at({"excitation.intensity": 0.03})
    means = interpolated_linear_means(flat(view.scene), 0.025)
    # 3 standard errors of three means: false alarm one in 120.
    assert_near(view.result, means, 0.1)
    for name in ("displacement", "velocity", "voltage"):
        centre, density = view.outline[name].centre, view.outline[name].density
        mass = np.trapezoid(density, centre)
        assert mass == pytest.approx(1.0, abs=0.02)
        square = np.trapezoid(density * centre**2, centre)
        assert square == pytest.approx(means[f"mean_square_{name}"], rel=0.1)
    assert linear.scene == harvester.Scene.read("linear").replace({"excitation.intensity": 0.03})
    with_error = harvester.results.result.with_error(view.result["mean_power"])
    assert f"mean power {with_error} scaled power" in view.sentence()


def test_the_picture_follows_a_slider(linear):
    sliders, line, picture = parts(linear)
    sliders["excitation.intensity"].value = 0.02
    before, said = bytes(picture.value), line.value
    assert before.startswith(PNG)
    sliders["excitation.intensity"].value = 0.035
    assert linear.view.scene.excitation.intensity == pytest.approx(0.035, rel=0.02)
    assert bytes(picture.value).startswith(PNG)
    assert bytes(picture.value) != before
    assert line.value != said
    assert "power conversion efficiency" in line.value


def test_a_value_that_cannot_be_is_said_in_one_line(linear):
    sliders, line, picture = parts(linear)
    kept = bytes(picture.value)
    sliders["piezo.coupling"].value = -0.5
    assert "piezo.coupling = -0.5: must be a number ≥ 0" in line.value.replace("&gt;", ">")
    assert "\n" not in line.value
    assert bytes(picture.value) == kept
    assert picture.layout.opacity != "1"
    sliders["piezo.coupling"].value = 1.0
    assert "must be" not in line.value
    assert picture.layout.opacity == "1"


def test_a_notebook_gets_sliders_and_a_picture(linear):
    bundle = linear._repr_mimebundle_()
    assert "application/vnd.jupyter.widget-view+json" in bundle
    assert bundle["image/png"] == linear.picture


@pytest.mark.slow
def test_without_widgets_there_is_a_picture(monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "ipywidgets" else find(name)
    )
    scene = harvester.Scene.read("device").replace({"load.netlist": "bridge"})
    explorer = harvester.explore(scene.replace({"run.duration": 5.0, "run.settle": 1.0}), ())
    bundle = explorer._repr_mimebundle_()
    assert set(bundle) == {"text/plain", "image/png"}
    assert bundle["image/png"].startswith(PNG)
    # A netlist: Monte Carlo alone, and the output side's power.
    assert not explorer.view.outline
    assert "a resistor as load" in explorer.view.refusal
    assert "mean output power" in repr(explorer)


def test_ranges_are_about_the_scenes_own_values():
    from harvester.interop.explorer import USUAL_KEYS, _range

    scene = harvester.Scene.read("paper")
    assert "gap" in USUAL_KEYS
    assert "duration" not in USUAL_KEYS
    assert _range(scene, "stoppers.gap", None) == pytest.approx((1.1 / 3.0, 3.3))
    # No restitution is above 1, and a negative stiffness has its greater end near 0.
    assert _range(scene, "stoppers.restitution", None) == pytest.approx((0.7 / 3.0, 1.0))
    assert _range(scene, "oscillator.linear_stiffness", None) == pytest.approx((-12.0, -4.0 / 3.0))
    with pytest.raises(harvester.HarvesterError, match=r"stoppers\.gap: no range from 2 to 1"):
        _range(scene, "stoppers.gap", (2.0, 1.0))
    with pytest.raises(harvester.HarvesterError, match=r"stoppers\.gap: .* is not a range"):
        _range(scene, "stoppers.gap", "wide")
    with pytest.raises(harvester.HarvesterError, match=r"stopper\.gap.*did you mean stoppers\.gap"):
        _range(scene, "stopper.gap", None)


@pytest.mark.parametrize("duration", [10.0, 2e3, 1e7])
def test_a_run_is_cut_to_what_a_picture_has_time_for(duration):
    scene = harvester.Scene.read("paper").replace({"run.duration": duration})
    short = cut_short(prepared(scene)).scene
    run = short.run
    # Two of its steps to a knot of 0.05 s or fewer.
    steps = run.realizations * (run.settle + run.duration) / 0.05
    assert steps <= STEPS_SHOWN
    assert run.realizations == 64 or steps > 0.5 * STEPS_SHOWN / 2
    assert run.realizations >= FEWEST_REALIZATIONS
