"""How tolerances are written, and what is refused."""

import numpy as np
import pytest
from scipy.stats import norm, truncnorm

from harvester.base.errors import HarvesterError
from harvester.scene.model import Scene
from harvester.studies.sensitivity.tolerances import tolerance

PAPER = Scene.read("paper")
SHARES = np.array([0.01, 0.3, 0.5, 0.9])


@pytest.mark.parametrize(
    ("text", "low", "high"),
    [
        ("±10%", 0.99, 1.21),
        ("+-10%", 0.99, 1.21),
        ("+/-10%", 0.99, 1.21),
        ("±0.1", 1.0, 1.2),
        ("uniform:0.9:2", 0.9, 2.0),
    ],
)
def test_uniform_forms(text, low, high):
    made = tolerance(PAPER, "stoppers.gap", text)
    np.testing.assert_allclose(made.values(SHARES), low + (high - low) * SHARES)


def test_a_share_of_a_negative_value():
    made = tolerance(PAPER, "oscillator.linear_stiffness", "±10%")
    value = PAPER.oscillator.linear_stiffness
    np.testing.assert_allclose(made.values(np.array([0.0, 1.0])), [1.1 * value, 0.9 * value])


@pytest.mark.parametrize(
    ("text", "mean", "deviation"), [("normal:5%", 1.1, 0.055), ("normal:1.2:0.1", 1.2, 0.1)]
)
def test_normal_forms(text, mean, deviation):
    made = tolerance(PAPER, "stoppers.gap", text)
    np.testing.assert_allclose(made.values(SHARES), norm(mean, deviation).ppf(SHARES))


def test_a_normal_distribution_is_cut_off_at_what_the_key_allows():
    made = tolerance(PAPER, "stoppers.restitution", "normal:0.9:0.2")
    theirs = truncnorm(-4.5, 0.5, loc=0.9, scale=0.2)
    np.testing.assert_allclose(made.values(SHARES), theirs.ppf(SHARES), rtol=1e-9)
    assert "truncated" in str(made)
    ends = made.values(np.array([0.0, 1.0]))
    assert np.all((ends >= 0.0) & (ends <= 1.0))


@pytest.mark.parametrize(
    ("key", "text", "message"),
    [
        ("stoppers.gapp", "±10%", r"--vary stoppers\.gapp: no number.*did you mean stoppers\.gap"),
        ("run.duration", "±10%", "not a number of this scene"),
        ("stoppers.gap", "10%", r"no such distribution; write ±10%"),
        ("stoppers.gap", "gaussian:1:2", "no such distribution"),
        ("stoppers.gap", "normal:1", "no such distribution"),
        ("stoppers.gap", "uniform:2:1", "needs LOW below HIGH"),
        ("stoppers.gap", "normal:1:0", "needs SD above 0"),
        ("stoppers.gap", "±x%", "x is no number"),
        ("stoppers.gap", "±-3%", "must be above 0"),
        ("stoppers.gap", "uniform:1:nan", "nan is no number"),
        ("stoppers.gap", "±200%", r"stoppers\.gap = -1\.1: must be a number > 0"),
        ("stoppers.restitution", "normal:1.5:0.1", r"must be a number in \[0, 1\]"),
    ],
)
def test_mistakes_are_named(key, text, message):
    with pytest.raises(HarvesterError, match=message) as caught:
        tolerance(PAPER, key, text)
    assert str(caught.value).startswith(f"--vary {key}")


def test_a_load_s_own_parameters_vary():
    device = Scene.read("device", ["load.netlist=bridge", "load.parameters.resistance=2e5"])
    assert tolerance(device, "load.parameters.resistance", "±50%").second == pytest.approx(3e5)
    made = tolerance(device, "load.parameters.storage", "±20%")
    changed = device.replace({made.key: made.second})
    assert dict(changed.load.circuit.parameters)["storage"] == made.second
