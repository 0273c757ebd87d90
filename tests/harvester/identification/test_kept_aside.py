"""Records kept aside: what is found in them alone, and which values are likely."""

import numpy as np
import pytest
from measured_records import RATE, linear_device, linear_record

from harvester.errors import IdentificationError, SceneError
from harvester.identification.identify import identify
from harvester.identification.kept_aside import _fitted_runs, _likely, _model_error
from harvester.identification.measured_response import MeasuredResponse
from harvester.identification.measurement import read_measurement

DAMPING, ORIGIN = "oscillator.damping", "oscillator.restoring_force[0]"


@pytest.fixture(scope="module")
def linear():
    """Two fitted records of a linear device, and one with three times the damping kept aside."""
    return identify(
        linear_device(0.04),
        [linear_record(0.03, 1, 4.0), linear_record(0.03, 2, 6.0)],
        keep_aside=[linear_record(0.09, 3, 5.0, own=(DAMPING,)), linear_record(0.09, 3, 5.0)],
        compare=False,
    )


@pytest.mark.slow
def test_a_value_of_a_record_s_own_is_found_in_it(linear):
    with_own, without = linear.kept_aside
    assert with_own.own[DAMPING].estimate == pytest.approx(0.09, rel=0.03)
    assert with_own.claimed
    assert with_own.holds
    assert f"with {DAMPING} = " in str(with_own)
    # Without it the power is that of the fitted damping, and there is no word of an own value.
    assert with_own.predicted_power.estimate == pytest.approx(
        with_own.measured_power.estimate, rel=0.02
    )
    assert without.predicted_power.estimate > 1.3 * without.measured_power.estimate
    assert with_own.left < 0.01
    assert not without.claimed
    assert "of it is left even in windows" in without.why
    assert linear.verdict.word == "incomplete"
    assert "record3.csv, kept aside, is left even in windows" in linear.verdict.sentence
    assert "found in this record" not in str(without)


def off(fitted, values):
    """Greatest relative deviation of the fitted records' rms, in runs from one start."""
    return max(
        abs(rms.estimate / seen.estimate - 1.0) for _, rms, seen in _fitted_runs(fitted, values)
    )


@pytest.mark.slow
def test_values_that_the_fitted_records_refute_are_not_likely(linear):
    base = linear.fitted
    wide = base.with_covariance(1e8 * base.covariance)
    error = _model_error(wide, linear.misfits)
    likely = _likely(wide, 1, error)
    assert len(likely) == 9
    spread = np.std(np.array(likely[1:]) / base.values, axis=0)
    assert (spread > 0.0).all()
    # Drawn at the whole width, most are off by more than half.
    root = np.linalg.cholesky(wide.covariance)
    drawn = base.values + np.random.default_rng(3).standard_normal((20, base.values.size)) @ root.T
    far = [off(wide, np.clip(each, 1e-12, None)) for each in drawn]
    assert np.median(far) > 0.5
    assert max(off(wide, each) for each in likely) < 0.4


def test_only_a_record_kept_aside_has_values_of_its_own(tmp_path):
    truth, one = linear_device(0.03), linear_record(0.03, 1, 4.0, samples=400)
    with pytest.raises(IdentificationError, match=r"only a record kept aside \(--keep-aside\)"):
        identify(truth, linear_record(0.03, 1, 4.0, samples=400, own=(ORIGIN,)))
    wrong = linear_record(0.03, 1, 4.0, samples=400, own=("oscillator.dampin",))
    with pytest.raises(IdentificationError, match=r"did you mean oscillator\.damping"):
        identify(truth, one, keep_aside=wrong)
    places = np.linspace(5.0, 20.0, 30)
    response = MeasuredResponse(places, 1.0 / (1.0 + 1j * places), name="sweep.csv")
    with pytest.raises(IdentificationError, match="no record of a motion"):
        identify(truth, one, keep_aside=response)
    table = np.column_stack([np.arange(400) / RATE, one.acceleration, one.voltage])
    file = tmp_path / "tilted.csv"
    np.savetxt(file, table, delimiter=",", header="time [s],acceleration [m/s^2],voltage [V]")
    assert read_measurement(file, {ORIGIN: "free"}).own == (ORIGIN,)
    assert read_measurement(file, {ORIGIN: "0.1"}).own == ()
    with pytest.raises(SceneError, match=r"sensor\.voltage_offset = 'free': must be a number"):
        read_measurement(file, {"sensor.voltage_offset": "free"})
