"""Each rival model is found where the records are of that model."""

from dataclasses import replace

import numpy as np
import pytest
from measured_records import band_noise, scene_of, states
from scipy import signal

from harvester.identification.identify import identify
from harvester.identification.measurement import Measurement
from harvester.identification.sensors import integrals

# 10 g at 20 Hz, hardening within 2 mm, under an rms acceleration of 9 m/s².
RATE, SAMPLES, REACH, RMS = 600.0, 2400, 2e-3, 9.0
STIFFNESS = 0.01 * (2.0 * np.pi * 20.0) ** 2
PIEZO = {"piezo": {"coupling": 1e-3, "capacitance": 5e-8}}
LOADS, NOISE = (2e5, 6e4), 0.01
HARDENING = 0.4 * STIFFNESS / REACH**2


def scene(force, **oscillator):
    values = {"restoring_force": force, **oscillator}
    linear = scene_of(0.01, 0.03, force[:2], PIEZO, LOADS[0])
    return linear.replace({f"oscillator.{key}": value for key, value in values.items()})


def records(truth, alter=None, outputs=("voltage",)):
    """Two records of a device, at two loads; `alter` is applied to both."""
    result = []
    for seed, load in enumerate(LOADS):
        rng = np.random.default_rng(seed)
        base = band_noise(rng, SAMPLES, RATE, 4.0, 60.0, RMS)
        loaded = truth.replace({"load.resistance": load})
        names = ("displacement", "velocity", "voltage")
        true = dict(zip(names, states(loaded, base, RATE), strict=True))
        record = Measurement(
            base, RATE, **{name: true[name] for name in outputs},
            changes={"load.resistance": load}, name=f"record{seed}.csv",
        )  # fmt: skip
        record = alter(record) if alter else record
        noisy = {
            name: values + NOISE * values.std() * rng.standard_normal(values.size)
            for name, values in record.sensed.items()
        }
        result.append(replace(record, **noisy))
    return result


def filtered(name, gain):
    """A record with one channel behind a filter, by its gain at each frequency (Hz)."""

    def altered(record):
        spectrum = np.fft.rfft(getattr(record, name)) * gain(np.fft.rfftfreq(SAMPLES, 1.0 / RATE))
        return replace(record, **{name: np.fft.irfft(spectrum, SAMPLES)})

    return altered


def first_order(corner, kind):
    return lambda f: signal.freqs(*signal.butter(1, corner, kind, analog=True), f)[1]


def delay(f):
    return np.exp(-2j * np.pi * f * 1e-3)


def scaled(name, factor):
    return lambda record: replace(record, **{name: factor * getattr(record, name)})


def raised(record):
    return replace(record, voltage=record.voltage + 0.3 * record.voltage.std())


def of_the_room(record):
    """The velocity that a laser beside the shaker shows."""
    base = integrals(record.acceleration, RATE, np.arange(SAMPLES))[0]
    return replace(record, velocity=record.velocity + base)


def misstated(record):
    """The second record's load is stated as half of what it is."""
    load = record.changes["load.resistance"]
    return replace(record, changes={"load.resistance": 0.5 * load if load == LOADS[1] else load})


CUBIC = [0.0, STIFFNESS, 0.0, HARDENING]
SOFT = [0.0, STIFFNESS, 0.0, -0.05 * STIFFNESS / REACH**2]
RANGE = {"restoring_force_range": [-4.0 * REACH, 4.0 * REACH]}
HIGH_PASS, LOW_PASS = first_order(1.0, "highpass"), first_order(120.0, "lowpass")
STOPPERS = {"gap": 1.2e-3, "stiffness": 8e4, "restitution": 0.7}
# Name → force of the truth, further values of it, force to begin with, and what is done to records.
CASES = {
    "drag": (CUBIC, {"quadratic_damping": 0.15}, CUBIC, None),
    "cubic spring": (CUBIC, {}, CUBIC[:2], None),
    "softening spring": (SOFT, RANGE, CUBIC[:2], None),
    "asymmetric spring": ([0.0, STIFFNESS, 0.2 * STIFFNESS / REACH, HARDENING], {}, CUBIC, None),
    "spring up to power 5": ([*CUBIC, 0.0, 0.2 * STIFFNESS / REACH**4], {}, CUBIC, None),
    "AC-coupled accelerometer": (CUBIC, {}, CUBIC, filtered("acceleration", HIGH_PASS)),
    "AC-coupled voltage": (CUBIC, {}, CUBIC, filtered("voltage", HIGH_PASS)),
    "low-pass of the voltage": (CUBIC, {}, CUBIC, filtered("voltage", LOW_PASS)),
    "delay between the channels": (CUBIC, {}, CUBIC, filtered("voltage", delay)),
    "gain of the voltage": (CUBIC, {}, CUBIC, scaled("voltage", 1.1)),
    "gain of the acceleration": (CUBIC, {}, CUBIC, scaled("acceleration", 1.1)),
    "load of record1.csv": (CUBIC, {}, CUBIC, misstated),
    "stoppers": (CUBIC[:2], {}, CUBIC[:2], None),
    "offset of the voltage": (CUBIC, {}, CUBIC, raised),
    "swapped polarity of the voltage": (CUBIC, {}, CUBIC, scaled("voltage", -1.0)),
    "velocity in the inertial frame": (CUBIC, {}, CUBIC, of_the_room),
}


def case(name):
    """The scene to begin with, and the records."""
    force, more, begun, alter = CASES[name]
    truth = scene(force, **more)
    if name == "stoppers":
        truth = truth.replace(stoppers=STOPPERS)
    outputs = ("voltage", "velocity") if name == "velocity in the inertial frame" else ("voltage",)
    return scene(begun, damping=0.035), records(truth, alter, outputs)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", CASES)
def test_a_rival_is_found_where_it_is_the_truth(name):
    found = identify(*case(name))
    assert found.verdict.word == "wrong", found.sentences()
    equal = [found.proposed, *found.undecided]
    assert any(rival.name.startswith(name) for rival in equal), found.sentences()


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["symmetric spring", "linear spring", "no drag", "no stoppers"])
def test_a_part_that_the_records_do_not_need_is_left_out(name):
    force = CUBIC[:2] if name == "linear spring" else CUBIC
    measurements = records(scene(force))
    begun = {
        "symmetric spring": scene([0.0, STIFFNESS, 0.1 * STIFFNESS / REACH, HARDENING]),
        "linear spring": scene(CUBIC),
        "no drag": scene(CUBIC, quadratic_damping=0.02),
        "no stoppers": scene(CUBIC).replace(stoppers={**STOPPERS, "gap": 10.0 * REACH}),
    }[name]
    free = None if name != "no stoppers" else ["oscillator.damping", "piezo.coupling"]
    found = identify(begun, measurements, free=free)
    assert found.verdict.word in ("predicts", "fits")
    assert next(rival for rival in found.rivals if rival.name == name).is_as_good


@pytest.mark.slow
def test_drag_is_found_and_what_explains_nothing_is_not_tried():
    measurements = records(scene(CUBIC, quadratic_damping=0.15))
    found = identify(scene(CUBIC, damping=0.035), measurements)
    assert found.verdict.word == "wrong"
    assert found.proposed.name == "drag"
    model = found.proposed.fitted
    drag = model.keys.index("oscillator.quadratic_damping")
    # Within 4 standard errors: one false alarm in 16 000.
    assert abs(model.values[drag] - 0.15) < 4.0 * model.standard_errors[drag]
    assert any(rival.remark.startswith("not tried") for rival in found.rivals)
    assert len(found.headline().split()) <= 25
    # The scene's file begins with the same text.
    head = found.scene_text().splitlines()
    assert head[0] == f"# {found.headline()}"
    for line in found.sentences():
        assert f"# {line}" in head
