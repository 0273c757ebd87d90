"""Identification against records whose truth is known."""

import json
import tomllib

import numpy as np
import pytest
from measured_records import band_noise, measured, off, scene_of

from harvester.base.errors import HarvesterError, IdentificationError, SceneError
from harvester.identification.identify import identify
from harvester.identification.measurement import Measurement, read_measurement
from harvester.scene.model import Scene
from harvester.scene.numbers import numbers

PIEZO = {"piezo": {"coupling": 1e-3, "capacitance": 5e-8}}
COIL = {"coil": {"coupling": 8.0, "resistance": 300.0}}
# 10 g at 20 Hz, hardening within 2 mm.
STIFFNESS = 0.01 * (2.0 * np.pi * 20.0) ** 2
RATE = 1000.0
# Standard errors of the truth that a value may lie off: one false alarm in 16 000 for each value.
SURE = 4.0


def device(force, transducer=None, damping=0.03, stoppers=None, resistance=2e5):
    return scene_of(0.01, damping, force, transducer or PIEZO, resistance, stoppers)


def asymmetric():
    return device([0.0, STIFFNESS, 0.25 * STIFFNESS / 2e-3, 0.6 * STIFFNESS / 2e-3**2])


def bistable():
    return device([0.0, -0.5 * STIFFNESS, 0.0, 0.5 * STIFFNESS / 2e-3**2])


def record(scene, seed, samples=4000, rms=12.0, **more):
    rng = np.random.default_rng(seed)
    return measured(scene, band_noise(rng, samples, RATE, 4.0, 60.0, rms), RATE, rng, **more)


def agree(found, truth):
    known = numbers(truth)
    off_by = {
        key: (value - known[key][0]) / found.standard_errors[key]
        for key, value in found.values.items()
    }
    assert all(abs(each) < SURE for each in off_by.values()), off_by


@pytest.fixture(scope="module")
def found():
    """An asymmetric device, identified."""
    truth = asymmetric()
    start = off(truth, ["oscillator.damping", "piezo.coupling", "piezo.capacitance"], rng(1))
    return identify(start, record(truth, 11))


def rng(seed):
    return np.random.default_rng(seed)


@pytest.mark.slow
def test_an_asymmetric_device_is_found_with_narrow_intervals_and_good_prediction(found):
    agree(found, asymmetric())
    half = {key: (high - low) / 2 for key, (low, high) in found.intervals.items()}
    for key, value in found.values.items():
        assert half[key] < (0.15 if "damping" in key else 0.05) * abs(value)
    assert found.verdict.good
    assert found.fitted.nrmse < 0.03
    measured_power, predicted, difference = found.fitted.records[0].powers()
    assert abs(difference.estimate) < 0.03
    assert predicted.estimate == pytest.approx(measured_power.estimate, rel=0.03)
    assert found.proposed.name == "as given"


@pytest.mark.slow
def test_a_fit_says_how_far_it_is_and_its_share_never_falls():
    truth, heard = asymmetric(), []
    identify(
        truth,
        record(truth, 11, samples=1500),
        compare=False,
        progress=lambda share, words: heard.append((share, words)),
    )
    shares = [share for share, _ in heard]
    assert shares == sorted(shares)
    # Each start of the search and each length of the windows is one report.
    assert len({share for share, words in heard if words == "fit"}) > 5


@pytest.mark.exhaustive
def test_a_symmetric_model_of_asymmetric_data_is_called_wrong():
    truth = asymmetric()
    start = Scene.from_tables(
        truth.to_tables()
        | {
            "oscillator": {
                "mass": 0.01,
                "damping": 0.03,
                "linear_stiffness": STIFFNESS,
                "cubic_stiffness": 0.6 * STIFFNESS / 2e-3**2,
            }
        },
        name="symmetric",
    )
    found = identify(start, record(truth, 11, samples=2000))
    assert found.verdict.word == "wrong"
    assert found.proposed.name == "asymmetric spring"
    assert not found.records[0].whiteness().white
    assert found.proposed.fitted.nrmse < 0.5 * found.fitted.nrmse


@pytest.mark.exhaustive
def test_stoppers_that_a_scene_lacks_are_proposed():
    stoppers = {"gap": 1.5e-3, "stiffness": 8e4, "restitution": 0.6}
    truth = device([0.0, STIFFNESS], stoppers=stoppers)
    found = identify(truth.replace(stoppers=None), record(truth, 7))
    assert found.verdict.word == "wrong"
    assert found.proposed.name == "stoppers"
    # Its restitution is a guess.
    assert found.proposed.fitted.nrmse < 0.1 * found.fitted.nrmse
    assert found.proposed.fitted.scene.stoppers[0].gap == pytest.approx(1.5e-3, rel=0.01)


@pytest.mark.slow
def test_motion_between_wells_gives_the_double_well_within_three_percent():
    truth = bistable()
    keys = ("oscillator.restoring_force[1]", "oscillator.restoring_force[3]")
    start = off(truth, keys, rng(2))
    made = record(truth, 5, samples=5000, rms=18.0)
    found = identify(start, made, compare=False)
    agree(found, truth)
    for key in (*keys, "oscillator.damping"):
        assert found.values[key] == pytest.approx(numbers(truth)[key][0], rel=0.03)
    # Several windows: no single path follows such a record.
    assert found.fitted.fit.edges[0].size > 2


@pytest.mark.parametrize(
    "way",
    [
        pytest.param("coil", marks=pytest.mark.exhaustive),
        pytest.param("stoppers", marks=pytest.mark.exhaustive),
    ],
)
def test_other_devices_are_found(way):
    if way == "coil":
        truth = device([0.0, STIFFNESS, 0.0, 0.6 * STIFFNESS / 2e-3**2], COIL, resistance=600.0)
        keys = ["coil.coupling", "oscillator.damping", "oscillator.restoring_force[3]"]
    else:
        stoppers = {"gap": 1.5e-3, "stiffness": 8e4, "restitution": 0.6}
        truth = device([0.0, STIFFNESS], stoppers=stoppers)
        keys = ["piezo.coupling", "stoppers.gap", "stoppers.stiffness"]
    found = identify(off(truth, keys, rng(3)), record(truth, 7), compare=False)
    agree(found, truth)
    assert set(keys) <= set(found.keys)
    assert found.fitted.nrmse < 0.04


@pytest.mark.exhaustive
def test_records_at_two_loads_tell_mass_and_leave_the_scene_alone():
    truth = asymmetric()
    near = record(truth, 21, samples=3000)
    far = record(
        truth.replace({"load.resistance": 4e4}), 22, samples=3000, changes={"load.resistance": 4e4}
    )
    start = off(truth, ["piezo.coupling", "piezo.capacitance"], rng(4))
    found = identify(start, [near, far], compare=False)
    agree(found, truth)
    assert len(found.fitted.records) == 2
    assert found.scene.load.resistance == truth.load.resistance


@pytest.mark.exhaustive
def test_a_displacement_with_free_sensor_gives_offset_delay_and_scale():
    truth = device([0.0, STIFFNESS, 0.0, 0.6 * STIFFNESS / 2e-3**2])
    made = record(truth, 31, outputs=("displacement",))
    moved = Measurement(
        2.0 * made.acceleration[1:] + 1.0, RATE, displacement=made.displacement[:-1] + 1e-4
    )
    free = [
        "oscillator.damping",
        "oscillator.restoring_force[1]",
        "oscillator.restoring_force[3]",
        "sensor.acceleration_scale",
        "sensor.acceleration_offset",
        "sensor.displacement_offset",
        "sensor.displacement_delay",
    ]
    found = identify(truth, moved, free=free, compare=False)
    wanted = dict(zip(free[3:], (2.0, 1.0, 1e-4, 1e-3), strict=True))
    for key, value in wanted.items():
        assert abs(found.values[key] - value) < SURE * found.standard_errors[key], key


@pytest.mark.slow
def test_what_a_record_does_not_tell_is_named_with_what_it_does():
    # A linear device whose base did not move: only ratios of motion and voltage are known.
    truth = device([0.0, STIFFNESS])
    made = measured(truth, np.zeros(3000), RATE, rng(5), start=(1e-3, 0.0, 0.0))
    found = identify(truth, made, free=["oscillator.damping", "oscillator.mass"], compare=False)
    assert not found.undetermined
    # The whole mechanical side by a factor is the same motion.
    keys = [
        "oscillator.mass",
        "oscillator.damping",
        "oscillator.restoring_force[1]",
        "piezo.coupling",
    ]
    found = identify(truth, made, free=[*keys, "piezo.capacitance"], compare=False)
    assert found.undetermined >= set(keys[:3])
    printed = {row[0]: row[1] for row in found.table().rows}
    assert {printed[key] for key in found.undetermined} == {"undetermined"}
    assert any("·" in line and "not determined separately" in line for line in found.sentences())


@pytest.mark.slow
def test_the_scene_file_reads_back_with_intervals_in_comments(found, tmp_path):
    text = found.scene_text()
    assert text.count("identified, ±") == len(found.keys)
    path = tmp_path / "found.toml"
    path.write_text(text)
    assert Scene.read(path).to_tables() == found.scene.to_tables()
    assert tomllib.loads(text)["piezo"]["coupling"] == found.values["piezo.coupling"]


def test_the_result_is_shown_written_and_drawn(found):
    content = json.loads(json.dumps(found.to_dict()))
    covariance = np.array(content["covariance"])
    errors = [content["parameters"][key]["standard_error"] for key in content["keys"]]
    assert np.sqrt(np.diag(covariance)) == pytest.approx(errors)
    header, rows = found.table()
    assert len(rows) == len(found.keys)
    assert all(len(row) == len(header) for row in rows)
    page = found.texts()[".html"]
    assert "95 % interval" in page
    assert "data:image/svg+xml" in page
    figure = found.figure()
    assert len(figure.axes) == 4
    # In the house style, whose layout keeps labels and legend apart.
    assert figure.get_layout_engine() is not None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"free": ["piezo.couplin"]}, "did you mean piezo.coupling"),
        ({"free": ["sensor.voltage_ofset"]}, "did you mean sensor.voltage_offset"),
        ({"fre": []}, "no option fre"),
    ],
)
def test_a_wrong_name_is_refused_with_the_nearest(change, words):
    with pytest.raises(HarvesterError, match=words):
        identify(asymmetric(), record(asymmetric(), 1, samples=1500), **change)


def test_records_that_tell_nothing_are_refused():
    truth = asymmetric()
    made = record(truth, 1, samples=1500)
    with pytest.raises(IdentificationError, match=r"too short: .* periods"):
        identify(truth, Measurement(made.acceleration[:300], RATE, made.voltage[:300]))
    slow = np.sin(2.0 * np.pi * 0.7 * np.arange(1500) / RATE)
    with pytest.raises(IdentificationError, match="no excitation in the relevant band"):
        identify(truth, Measurement(slow, RATE, made.voltage))
    with pytest.raises(SceneError, match=r"voltage: .* are clipped"):
        Measurement(made.acceleration, RATE, np.clip(made.voltage, -1.0, 1.0))
    with pytest.raises(HarvesterError, match=r"load.netlist is 'bridge'"):
        identify(truth.replace({"load.netlist": "bridge"}), made)


@pytest.mark.parametrize("marker", [-9999.0, 65535.0, 400.0])
def test_markers_of_loggers_are_named(tmp_path, marker):
    """In the file's own numbers, -9999 g; a shock of unequal samples is none."""
    rng = np.random.default_rng(3)
    values = band_noise(rng, 2000, RATE, 4.0, 60.0, 12.0)
    table = np.column_stack([np.arange(2000) / RATE, values, np.roll(values, 3)])
    path = tmp_path / "m.csv"

    def remarks(changed):
        header = "time [s],acceleration [g],voltage [mV]"
        np.savetxt(path, changed, delimiter=",", header=header, comments="")
        return read_measurement(path).remarks

    assert remarks(table) == ()
    shocked = table.copy()
    shocked[500:508, 1] = marker * np.sin(np.arange(1, 9) / 3.0)
    assert remarks(shocked) == ()
    for column, quantity in ((1, "acceleration"), (2, "voltage")):
        marked = table.copy()
        marked[[300, 700, 701, 1500], column] = marker
        (remark,) = remarks(marked)
        assert remark.startswith(f"{quantity}: 4 of 2000 samples are {marker:g}, far outside")
