"""Records kept aside: what is found in them alone, and which values are likely."""

from types import SimpleNamespace

import numpy as np
import pytest
from measured_records import RATE, linear_device, linear_record, scene_of, states

from harvester.base.errors import IdentificationError, SceneError
from harvester.identification.identify import identify
from harvester.identification.kept_aside import Visited, _likely, band
from harvester.identification.measured_response import MeasuredResponse
from harvester.identification.measurement import Measurement, read_measurement
from harvester.scene.model import Scene

FREQUENCIES = np.linspace(5.0, 20.0, 30)
RESPONSE = MeasuredResponse(FREQUENCIES, 1.0 / (1.0 + 1j * FREQUENCIES), name="sweep.csv")
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
        with_own.powers()[0].estimate, rel=0.02
    )
    assert without.predicted_power.estimate > 1.3 * without.powers()[0].estimate
    assert with_own.left < 0.01
    assert not without.claimed
    assert "even in short windows" in without.outside
    assert linear.verdict.word == "incomplete"
    assert "of record3.csv even in short windows" in linear.verdict.sentence
    assert "fitted to this record" not in str(without)


@pytest.mark.slow
def test_likely_values_scatter_as_their_errors_say(linear):
    """Of eight draws of some four values the mean square is 0.4 to 2: a false alarm in 500."""
    base = linear.fitted
    best, *others = _likely(base, 1)
    assert (best == base.values).all()
    assert len(others) == 8
    assert 0.4 < np.mean(((np.array(others) - best) / base.standard_errors) ** 2) < 2.0


def test_only_a_record_kept_aside_has_values_of_its_own(tmp_path):
    truth, one = linear_device(0.03), linear_record(0.03, 1, 4.0, samples=400)
    with pytest.raises(IdentificationError, match=r"only a validation record \(keep_aside\)"):
        identify(truth, linear_record(0.03, 1, 4.0, samples=400, own=(ORIGIN,)))
    wrong = linear_record(0.03, 1, 4.0, samples=400, own=("oscillator.dampin",))
    with pytest.raises(IdentificationError, match=r"did you mean oscillator\.damping"):
        identify(truth, one, keep_aside=wrong)
    with pytest.raises(IdentificationError, match="cannot be a validation record"):
        identify(truth, one, keep_aside=RESPONSE)
    table = np.column_stack([np.arange(400) / RATE, one.acceleration, one.voltage])
    file = tmp_path / "tilted.csv"
    np.savetxt(file, table, delimiter=",", header="time [s],acceleration [m/s^2],voltage [V]")
    assert read_measurement(file, {ORIGIN: "free"}).own == (ORIGIN,)
    assert read_measurement(file, {ORIGIN: "0.1"}).own == ()
    with pytest.raises(SceneError, match=r"sensor\.voltage_offset = 'free': must be a number"):
        read_measurement(file, {"sensor.voltage_offset": "free"})


def test_a_load_is_given_and_responses_alone_predict_no_record():
    truth, one = linear_device(0.03), linear_record(0.03, 1, 4.0, samples=400)
    loaded = linear_record(0.03, 2, 4.0, samples=400, own=("load.resistance",))
    with pytest.raises(IdentificationError, match=r"load\.resistance = free: not a number"):
        identify(truth, one, keep_aside=loaded)
    with pytest.raises(IdentificationError, match="responses alone cannot predict a record"):
        identify(truth, RESPONSE, keep_aside=one)


@pytest.mark.parametrize(
    ("load", "why"), [(1.0, ""), (2.0, "its load is outside the covered range")]
)
def test_the_load_of_a_scaled_scene_is_its_decay_rate(load, why):
    tables = {
        "units": "scaled",
        "oscillator": {"damping": 0.05, "restoring_force": [0.0, 1.0]},
        "piezo": {"coupling": 0.1},
        "load": {"decay_rate": 1.0},
        "excitation": {"kind": "white", "intensity": 0.01},
        "run": {"duration": 100.0},
    }
    base = np.random.default_rng(1).standard_normal(400)
    record = Measurement(base, 2.0, displacement=base)
    one = SimpleNamespace(scene=Scene.from_tables(tables, name="scaled"), measurement=record)
    ranges = Visited(((-1.0, 1.0),), ((-1.0, 1.0),), band([record]), (load,), (), (), si=False)
    assert ranges.excludes(SimpleNamespace(length=1.0, experiments=[one]), np.zeros(9)) == why


@pytest.mark.exhaustive
def test_a_record_in_the_other_well_is_predicted_there():
    """A cubic device; sines within one well, solved by scipy."""
    force = [0.0, -33.94, 0.0, 33.94 / 0.0165**2]
    piezo = {"piezo": {"coupling": 2.6e-6, "capacitance": 1.4e-7}}
    truth = scene_of(0.02, 0.025, force, piezo, 1e6)
    rate, samples = 64.0, 2000
    times = np.arange(samples) / rate

    def sine(frequency, amplitude, side):
        base = amplitude * np.sin(2.0 * np.pi * frequency * times)
        voltage = states(truth, base, rate, (side * 0.0165, 0.0, 0.0))[2]
        noise = 0.004 * np.std(voltage) * np.random.default_rng(1).standard_normal(samples)
        return Measurement(base, rate, voltage=voltage + noise, name=f"{frequency}_{side}.csv")

    fitted = [sine(9.1, 1.7, -1.0), sine(6.3, 1.4, -1.0)]
    found = identify(truth, fitted, keep_aside=sine(9.1, 1.2, 1.0), compare=False)
    [kept] = found.kept_aside
    assert kept.measured_orbit == kept.predicted_orbit == "in the well on the right"
    assert kept.follows
    assert kept.holds
    assert kept.name not in found.verdict.sentence
