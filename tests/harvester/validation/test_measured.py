"""Rows of measured devices: their numbers, their limits, misses that stay, and the page."""

import dataclasses
import math
import os
from pathlib import Path

import numpy as np
import pytest

from harvester.engines.runner import Runner
from harvester.validation import entries
from harvester.validation.known_results import downloaded, linear_scatter, measured, points_of
from harvester.validation.public import verify
from harvester.validation.verify import (
    HOLDS,
    MISSES,
    NOT_HERE,
    TruthRow,
    Verification,
    measured_page,
)

DEVICES = entries("known_results")["device"]
BARE, TIPPED, BRIDGE = DEVICES


def closed_form(device, frequency, resistance):
    """Mean power of a linear device: (K − M ω² + iω C) x + θ V = −μ M a, Y V = iω θ x."""
    scene = device["scene"]
    mass, damping, stiffness, base_factor = scene["oscillator"].values()
    coupling, capacitance = scene["piezo"].values()
    rate = 2j * math.pi * float(frequency)
    volts = rate * coupling / (1.0 / resistance + rate * capacitance)
    mechanical = stiffness + mass * rate**2 + damping * rate
    force = base_factor * mass * scene["excitation"]["amplitude"]
    return abs(volts * force / (mechanical + coupling * volts)) ** 2 / (2.0 * resistance)


def test_the_scatter_is_that_of_the_measurement_alone():
    resistances = np.geomspace(1.0, 1000.0, 12)
    exact = resistances / (3.0 + 0.2 * resistances + 0.01 * resistances**2)
    assert linear_scatter(resistances, exact) < 1e-7
    rng = np.random.default_rng(1)
    found = [
        linear_scatter(resistances, exact * (1.0 + 0.03 * rng.standard_normal(12)))
        for _ in range(40)
    ]
    # An rms of 9 free residuals scatters by a quarter, that of 40 of them by a twentieth.
    assert math.sqrt(np.mean(np.square(found))) == pytest.approx(0.03, rel=0.15)
    # Whatever its numbers, a linear device lies on such a curve.
    kilo = TIPPED["series"]["45.6"][0]
    ours = [closed_form(TIPPED, 45.6, 1e3 * each) for each in kilo]
    assert linear_scatter(kilo, ours) < 1e-6


def test_limits_come_from_the_measurement():
    for device in DEVICES:
        for frequency, (resistances, powers) in device["series"].items():
            name = f"{device['name']}, {frequency} Hz"
            own = [each for each in points_of(device) if each.title.startswith(name)]
            exact = [device["scale"] * power for power in powers]
            assert [each.exact for each in own] == exact
            scatter = device.get("scatter") or linear_scatter(resistances, exact)
            share = device["reading"] + 3.0 * scatter
            shares = [each.allowance / each.exact for each in own]
            assert shares == pytest.approx([share] * len(own))
    # As the papers' coupling says.
    piezo, stiffness = BRIDGE["scene"]["piezo"], BRIDGE["scene"]["oscillator"]["linear_stiffness"]
    square = piezo["coupling"] ** 2 / piezo["capacitance"] / stiffness
    assert square == pytest.approx(0.0289, rel=2e-3)


@pytest.mark.slow
def test_a_row_is_what_the_closed_form_gives_and_a_miss_is_no_failure(pool):
    truths = list(points_of(BARE))
    chosen = [truths[5], dataclasses.replace(truths[17], exact=2.0 * truths[17].exact)]
    told = verify(chosen=chosen, runner=Runner(pool))
    for row, place in zip(told.rows, (5, 17), strict=True):
        frequency = ("502.5", "524.7")[place // 12]
        resistance = 1e3 * BARE["series"][frequency][0][place % 12]
        exact = closed_form(BARE, frequency, resistance)
        assert row.value == pytest.approx(exact, rel=2e-3)
    assert [row.verdict for row in told.rows] == [HOLDS, MISSES]
    assert told.failed == []
    page = told.texts()["-measured.md"]
    assert "1 of 2 miss" in page
    assert "misses" in told.markdown() + page


def test_a_set_that_was_not_downloaded_is_said_so(pool, monkeypatch, tmp_path):
    for variable in ("SILVERBOX", "BISTABLEX"):
        monkeypatch.delenv(variable, raising=False)
    runner = Runner(pool)
    told = verify(chosen=downloaded(), runner=runner)
    assert [row.verdict for row in told.rows] == [NOT_HERE, NOT_HERE]
    silverbox, beam = told.sentences()[-2:]
    assert silverbox.startswith(
        "Silverbox, a Duffing oscillator of electronics: not downloaded: take"
    )
    assert silverbox.endswith("set SILVERBOX=SNLS80mV.csv")
    assert beam.endswith("set BISTABLEX=BistableX/DataExperimental")
    # No task was begun for them, of which the runner could say that it ended early.
    assert runner.computed == 0
    assert runner.warnings == []
    monkeypatch.setenv("SILVERBOX", str(tmp_path))
    assert (
        downloaded()[0].asked["identify"].args[0].startswith(f"SILVERBOX = {tmp_path}: other data")
    )


@pytest.mark.exhaustive
@pytest.mark.skipif("BISTABLEX" not in os.environ, reason="BISTABLEX names no folder")
def test_what_is_claimed_of_a_measured_bistable_beam_lies_within_its_interval(pool):
    told = verify(chosen=downloaded()[1:], runner=Runner(pool))
    assert [row.verdict for row in told.rows] == [HOLDS]


def test_the_page_of_the_site_has_every_point():
    page = (Path(__file__).parents[3] / "docs" / "explanation" / "measured.md").read_text("utf-8")
    rows = [TruthRow(truth, method, truth.exact) for truth in measured() for method in truth.asked]
    fresh = measured_page(rows, "today")
    # But for what was computed: points, measured values, what is said, and headings.
    for line in fresh.splitlines():
        cells = line.split(" | ")
        if line.startswith("| ") and len(cells) >= 5 and cells[0] != "| set":
            assert " | ".join(cells[:2]) in page
        elif line.startswith(("#", "- ")) and "Predicted" not in line:
            assert line in page
    assert Verification(rows, 1.0, "today").failed == []


@pytest.mark.exhaustive
@pytest.mark.parametrize("device", DEVICES[:2], ids=lambda each: each["name"])
def test_every_resistor_lies_within_its_limit(device):
    told = verify(chosen=list(points_of(device)))
    assert [row.verdict for row in told.rows] == [HOLDS] * len(told.rows)
