import numpy as np
import pytest

from circuits.netlist.kinds import LEVEL, LOSS, OUTPUT, STATE, SUPPLY
from circuits.netlist.measures import Measure
from harvester.device.record import Record
from harvester.scene.model import Scene
from harvester.statistics.estimate import (
    NO_OUTPUT,
    NOT_STARTED,
    ROUNDED_OFF,
    STARTS_CHARGED,
    UNRESOLVED,
    Estimate,
)
from harvester.statistics.moments import Moments
from harvester.statistics.output_moments import OutputMoments
from harvester.statistics.output_side import estimate_output, step_sizes
from harvester.statistics.run_estimates import with_steps

# A piecewise linear passage over levels 2.2 % apart, of t = −ln(1 − v) at v = 0.9: h²/8 · 1/(1−v)².
PASSAGE = 5e-3


def charging(chunk, settle=0.0, course=lambda time: 1.0 - np.exp(-time)):
    """v = 1 − exp(−t) to t = 16, in chunks, with a piezo giving power 1 and an input of 2."""
    moments = Moments.empty(settle, 16.0, (-np.inf, np.inf), (), False, 32, 1, 0.1)
    moments.output = OutputMoments.beside(moments, ((LEVEL, "out"),))
    moments.output.conductance = 0.5
    energy = np.array([[1.5]])
    time = np.linspace(1e-3, 16.0, 16_000)
    voltage = course(time)
    one = np.ones_like(time)
    record = np.array([time, one, one, one, one, 2.0 * one, one, 0.0 * one, voltage])
    for start in range(0, time.size, chunk):
        moments.add(Record(*record[:, start : start + chunk]))
        part = slice(start, start + chunk)
        moments.output.add(time[part], voltage[part], None, [voltage[part]], energy)
    return moments


@pytest.mark.parametrize("chunk", [1, 77, 4096])
def test_an_exponential_start_up_has_the_closed_forms(chunk):
    estimates = estimate_output([charging(chunk)])
    assert estimates["start_up_time"].estimate == pytest.approx(np.log(10.0), abs=PASSAGE)
    mean = 1.0 - (1.0 - np.exp(-16.0)) / 16.0
    square = 1.0 - 2.0 * (1.0 - np.exp(-16.0)) / 16.0 + (1.0 - np.exp(-32.0)) / 32.0
    assert estimates["output_voltage"].estimate == pytest.approx(mean, rel=1e-4)
    assert estimates["mean_output_power"].estimate == pytest.approx(0.5 * square, rel=1e-4)
    assert estimates["mean_storage_power"].estimate == pytest.approx(1.5 / 16.0, rel=1e-3)
    assert estimates["stored_energy"].estimate == pytest.approx(1.5 * square, rel=1e-4)
    assert estimates["final_stored_energy"].estimate == pytest.approx(1.5, rel=1e-6)
    ripple = np.sqrt(square - mean**2)
    assert estimates["output_ripple"].estimate == pytest.approx(ripple, rel=1e-3)
    assert estimates["output_peak_to_peak"].estimate == pytest.approx(1.0, abs=2e-3)
    efficiency = 0.5 * square + 1.5 / 16.0
    assert estimates["converter_efficiency"].estimate == pytest.approx(efficiency, rel=1e-3)
    assert estimates["end_to_end_efficiency"].estimate == pytest.approx(efficiency / 2, rel=1e-3)
    assert estimates["mean_converter_loss"].estimate == pytest.approx(1 - efficiency, rel=1e-3)


def test_start_up_counts_from_the_beginning_and_means_from_the_settled_time():
    estimates = estimate_output([charging(500, settle=8.0)])
    assert estimates["start_up_time"].estimate == pytest.approx(np.log(10.0), abs=PASSAGE)
    assert estimates["output_voltage"].estimate == pytest.approx(1.0, abs=1e-3)


def test_a_start_up_time_says_that_the_output_still_ramps():
    ramp = estimate_output([charging(500, course=lambda time: 0.1 * time)])["start_up_time"]
    assert "still ramps" in ramp.note
    assert ramp.estimate == pytest.approx(0.9 * 12.0, rel=1e-2)
    started = estimate_output([charging(500)])["start_up_time"]
    assert "ramps" not in started.note


@pytest.mark.parametrize(("ripple", "resolved"), [(2e-9, False), (2e-3, True)])
def test_a_ripple_on_a_steady_voltage_is_no_rounding(ripple, resolved):
    """In the squares of 1.8 V rounding is 1e-8 V: more than the whole range of the smaller one."""
    course = lambda time: 1.8 + np.sqrt(2.0) * ripple * np.sin(20.0 * time)  # noqa: E731
    found = estimate_output([charging(77, 4.0, course)])
    shown = ripple if resolved else 0.0
    assert found["output_ripple"].estimate == pytest.approx(shown, rel=0.01)
    assert found["output_peak_to_peak"].estimate == pytest.approx(np.sqrt(8.0) * shown, rel=0.01)
    for name in ("output_ripple", "output_peak_to_peak"):
        assert (found[name].note == UNRESOLVED) is not resolved
    assert found["output_voltage"].effective_sample_size is None or resolved


def test_an_output_that_a_source_feeds_harvests_nothing_and_not_its_rounding():
    """Output and supply are of 1 W, their difference is 3e-9 W: 0, and no rate for an hour."""
    moments = charging(77, 4.0, lambda time: np.sqrt(2.0) * np.ones_like(time))
    moments.output.rows = ((SUPPLY, "bout"), *moments.output.rows)
    fed = np.zeros_like(moments.output.measured)
    fed[:, 0, 0] = -moments.output.integrals[:, 0] * (1.0 + 3e-9)
    moments.output.measured = np.concatenate([fed, moments.output.measured], axis=1)
    found = estimate_output([moments])
    assert found["supplied_by_bout"].estimate == pytest.approx(1.0)
    for name in ("mean_output_power", "mean_storage_power", "converter_efficiency"):
        assert found[name].estimate == 0.0, name
        assert found[name].note == ROUNDED_OFF, name
    assert found["stored_energy_per_hour"].estimate == 0.0
    assert found["mean_converter_loss"].estimate == pytest.approx(1.0)


@pytest.mark.parametrize(("share", "shown"), [(1e-7, 1e-7), (1e-10, 0.0)])
def test_a_small_output_that_is_no_difference_is_no_rounding(share, shown):
    """1e-7 of the load's power is measured directly; of 1e-10 nothing arrives."""
    found = estimate_output(
        [charging(77, 4.0, lambda time: np.full_like(time, (2 * share) ** 0.5))]
    )
    assert found["mean_output_power"].estimate == pytest.approx(shown)
    assert found["converter_efficiency"].estimate == pytest.approx(shown)


def test_the_error_of_steps_of_a_difference_is_that_of_its_terms():
    """A loss of 0.4 of 1 W given, 0.5 W used and 0.1 W stored; with a bar of 0 of its own."""
    found = {
        f"mean_{name}": Estimate(value, 0.0, None, "power")
        for name, value in (
            ("power", 1.0), ("input_power", 2.0), ("output_power", 0.5), ("storage_power", 0.1),
            ("converter_loss", 0.4),
        )
    }  # fmt: skip
    loss = [
        Measure(LOSS, name, "", "", "", ((op, 1, 2), None))
        for name, op in (("bridge", "-"), ("wire", "*"))
    ]
    sizes = step_sizes(found, loss)
    terms = np.hypot(1.0, np.hypot(0.5, 0.1))
    assert sizes["mean_converter_loss"] == pytest.approx(terms)
    assert (sizes["bridge_loss"], "wire_loss" in sizes) == (1.0, False)
    assert sizes["end_to_end_efficiency"] == pytest.approx(np.hypot(0.5, 0.1) / 2.0)
    found["supplied_by_b1"] = Estimate(3.0, 0.0, None, "power")
    assert step_sizes(found)["mean_output_power"] == pytest.approx(np.hypot(0.5, 3.0))
    scene = Scene.read("device", ['excitation={kind="sine", amplitude=6.0, frequency=8.0}'])
    whole = with_steps(scene, found["mean_converter_loss"], 0.01, size=terms)
    assert whole.standard_error == pytest.approx(0.01 * terms)


def test_an_hour_is_extrapolated_from_even_charging_alone():
    def per_hour(rate):
        course = charging(77, course=lambda time: np.sqrt(1.0 + rate * time))
        return estimate_output([course])["stored_energy_per_hour"]

    for rate in (1e-4, -1e-4):
        assert per_hour(rate).estimate == pytest.approx(3600.0 * 1.5 * rate, rel=1e-3)
    # An hour would take or bring more than the store holds.
    for rate in (1e-3, -1e-3):
        assert np.isnan(per_hour(rate).estimate)
        assert "times the energy that the stores hold" in per_hour(rate).note
    uneven = estimate_output([charging(77)])["stored_energy_per_hour"]
    assert np.isnan(uneven.estimate)
    assert "in the halves of the measured 16 s differ by 100% of the larger one" in uneven.note


def test_nothing_across_the_output_is_the_reason_for_its_power_of_0():
    moments = charging(77)
    moments.output.conductance = 0.0
    power = estimate_output([moments])["mean_output_power"]
    assert (power.estimate, power.note) == (0.0, NO_OUTPUT)


def test_an_output_that_starts_charged_has_no_start_up_time():
    found = estimate_output([charging(77, course=lambda time: 2.0 + 0.1 * np.sin(time))])
    assert found["start_up_time"].estimate == 0.0
    assert found["start_up_time"].note == STARTS_CHARGED
    never = estimate_output([charging(77, course=lambda time: 0.0 * time)])["start_up_time"]
    assert np.isnan(never.estimate)
    assert never.note == NOT_STARTED


def test_error_bars_follow_the_batches():
    """Batch means that are independent: the error bar is theirs (32 batches, ±13 %)."""
    generator = np.random.default_rng(3)
    moments = charging(4096)
    time = moments.output.integrals[:, 0]
    moments.output.integrals[:, 1] = (1.0 + 0.1 * generator.standard_normal(32)) * time
    estimate = estimate_output([moments])["output_voltage"]
    # Six deviations of its own error: one false alarm in 1e8.
    assert estimate.standard_error == pytest.approx(0.1 / np.sqrt(32), rel=0.8)


def test_a_load_without_output_has_none_of_these():
    moments = charging(4096)
    moments.output = None
    assert estimate_output([moments]) == {}


def test_independent_samples_are_the_effective_ones():
    """Each point its own: as many as points, within six deviations of the error bar's own."""
    generator = np.random.default_rng(5)
    points, rows = 32_000, ((OUTPUT, "node"), (LOSS, "line"), (STATE, "up"), (LEVEL, "out"))
    moments = Moments.empty(0.0, 32.0, (-np.inf, np.inf), (), False, 32, 1, 0.1)
    moments.output = OutputMoments.beside(moments, rows)
    moments.output.conductance = 0.0
    time = np.linspace(1e-3, 32.0, points)
    voltage = 1.0 + generator.standard_normal(points)
    up = (voltage > 1.5).astype(float)
    one = np.ones_like(time)
    moments.add(Record(time, one, one, one, one, one, one, 0.0 * one, voltage))
    measures, energy = np.array([np.exp(voltage), voltage**2, up]), np.array([[1.5]])
    moments.output.add(time, voltage, measures, [voltage], energy)
    found = estimate_output([moments])
    for name in (
        "output_voltage", "stored_energy", "mean_output_power", "node_power", "line_loss",
        "up_time_share",
    ):  # fmt: skip
        assert found[name].effective_sample_size == pytest.approx(points, rel=0.8), name
    starts = found["up_starts_per_hour"]
    error = starts.standard_error
    assert starts.effective_sample_size == pytest.approx((starts.estimate / error) ** 2)
    # A sum of powers whose product is not kept has none.
    moments.output.conductance = 0.5
    assert estimate_output([moments])["mean_output_power"].effective_sample_size is None
