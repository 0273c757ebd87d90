import math

import numpy as np
import pytest

from harvester import Scene
from harvester.engines.realization import empty_moments
from harvester.engines.simulate import simulate
from harvester.scene.lines import half_width, line_frequency, spread
from harvester.scene.prepared import prepared
from harvester.scene.steps import FINER_NEAR_LINES, step_error, steps_per_sample

# The built-in linear device: its resonance is 2 rad/s without the piezo.
OMEGA = 2.0


def driven(*frequencies, **changes):
    sines = [{"kind": "sine", "amplitude": 0.1, "frequency": f} for f in frequencies]
    excitation = sines[0] if len(sines) == 1 else {"kind": "sum", "parts": sines}
    return Scene.read("linear").replace({"excitation": excitation, **changes})


def test_noise_on_a_broad_resonance_has_no_line():
    scene = Scene.read("linear")
    ready = prepared(scene)
    assert line_frequency(ready) == spread(ready) == 0.0


def test_the_line_nearest_to_the_resonance_counts():
    near = OMEGA / (2.0 * math.pi)
    scene = driven(3.0 * near, 1.05 * near, 0.1 * near)
    assert line_frequency(prepared(scene)) == pytest.approx(1.05 * OMEGA)


def test_a_silent_sine_is_no_line():
    # The largest answer of none was asked for, and a run ended in a ValueError.
    silent = driven(OMEGA / (2.0 * math.pi)).replace({"excitation.amplitude": 0.0})
    assert spread(prepared(silent)) == 0.0
    assert line_frequency(prepared(silent)) == 0.0


def test_one_sine_on_a_linear_device_leaves_the_steps_and_two_close_ones_do_not():
    near, coil = OMEGA / (2.0 * math.pi), {"oscillator.damping": 1e-3, "load.decay_rate": 1e-3}
    one, two = driven(near, **coil), driven(near, 1.02 * near, **coil)
    ready = prepared(two)
    assert spread(prepared(one)) == 0.0
    assert spread(ready) == pytest.approx(1.02**2 - 1.0, rel=0.05)
    # As many steps a second as before for one.
    assert steps_per_sample(prepared(one)) == 2
    assert 2 < steps_per_sample(ready) <= 2 * FINER_NEAR_LINES


def test_finer_steps_cost_less_by_their_square():
    scene = driven(OMEGA / (2.0 * math.pi))
    ready = prepared(scene)
    ratio = step_error(ready, "default") / step_error(ready, "fine")
    assert ratio == pytest.approx(16.0)


def test_switches_and_contacts_add_to_what_steps_cost():
    """By the circuit, and where Monte Carlo's own error is far below a contact's."""
    values = {"resistance": 1e5, "storage": 1e-6}
    bridge, sshi = (
        step_error(
            prepared(
                Scene.read("device").replace({"load": {"netlist": name, "parameters": values}})
            )
        )
        for name in ("bridge", "sshi_parallel")
    )
    assert sshi > bridge
    assert 3e-4 < step_error(prepared(Scene.read("one_sided")), engine="monte-carlo") < 3e-3


def test_half_width_is_that_of_the_damping():
    scene = driven(OMEGA / (2.0 * math.pi), **{"piezo.coupling": 0.0, "oscillator.damping": 0.04})
    assert half_width(prepared(scene)) == pytest.approx(0.04 / (2.0 * OMEGA))


@pytest.mark.parametrize(
    ("ratios", "repeats"), [((1.0,), 1.0), ((1.0, 1.5), 2.0), ((1.0, 1.31), 100.0)]
)
def test_sines_repeat_together(ratios, repeats):
    scene = driven(*ratios)
    assert scene.excitation.period == pytest.approx(repeats)
    assert driven(1.0, math.sqrt(2.0)).excitation.period is None


def test_measured_time_is_whole_periods():
    scene = driven(0.3, **{"run.settle": 10.0, "run.duration": 50.0, "run.realizations": 1})
    moments = empty_moments(prepared(scene))
    periods = moments.batch_length * 0.3
    assert periods == pytest.approx(round(periods))
    # A billionth of a knot earlier, so that rounding drops no step.
    assert moments.start == pytest.approx(10.0, rel=1e-9) or moments.start > 10.0
    measured = len(moments.integrals) * moments.batch_length
    assert moments.start + measured == pytest.approx(60.0, abs=1.0 / 0.3 / 40.0)


@pytest.mark.parametrize(
    ("shape", "lines"),
    [("sine", True), ("swept", True), ("two", True), ("noise", False), ("narrow", False)],
)
def test_records_of_a_few_sines_at_a_time_are_lines(shape, lines, tmp_path):
    rate, times = 400.0, np.arange(20000) / 400.0
    generator = np.random.default_rng(1)
    # Noise behind a filter of Q = 10.
    ringing = np.exp(-0.05 * 377.0 * times) * np.sin(377.0 * times)
    samples = {
        "narrow": np.convolve(generator.normal(size=times.size), ringing)[: times.size],
        "sine": np.sin(2.0 * np.pi * 9.7 * times),
        "swept": np.sin(2.0 * np.pi * (5.0 * times + 0.1 * times**2)),
        "noise": generator.normal(size=times.size),
        "two": np.sin(2.0 * np.pi * 9.7 * times) + np.sin(2.0 * np.pi * 31.0 * times),
    }[shape]
    np.save(tmp_path / "record.npy", samples)
    record = {
        "kind": "record",
        "file": str(tmp_path / "record.npy"),
        "sampling_rate": rate,
        "unit": "m/s^2",
    }
    run = {"run.settle": 1.0, "run.duration": 20.0, "run.realizations": 1}
    found = Scene.read("device").replace({"excitation": record, **run}).excitation.lines
    assert bool(found) is lines
    if shape == "two":
        assert {round(frequency, -1) for frequency, _ in found} == {10.0, 30.0}
    if shape == "sine":
        frequency, amplitude = found[0]
        assert frequency == pytest.approx(9.7, abs=rate / 1024.0)
        assert amplitude == pytest.approx(1.0, rel=0.02)


def test_a_burst_in_a_silent_record_is_no_line_at_frequency_0(tmp_path):
    """Its silent stretches hold nothing but what rounding leaves of their mean."""
    times = np.arange(20000) / 400.0
    np.save(tmp_path / "record.npy", np.exp(-((times - 25.0) ** 2)) * np.sin(60.0 * times) + 1e-9)
    record = {
        "kind": "record",
        "file": str(tmp_path / "record.npy"),
        "sampling_rate": 400.0,
        "unit": "m/s^2",
    }
    run = {"run.settle": 1.0, "run.duration": 20.0, "run.realizations": 1}
    scene = Scene.read("device").replace({"excitation": record, **run})
    assert scene.excitation.lines == ()
    assert steps_per_sample(prepared(scene)) >= 1


def test_runge_kutta_in_a_well_stiffer_than_the_line_is_within_its_error():
    values = {"restoring_force": [0.0, 1.0, 0.0, -3.778, 0.0, 2.778], "damping": 0.04}
    scene = Scene.read("linear").replace(
        {
            **{f"oscillator.{name}": value for name, value in values.items()},
            "excitation": {"kind": "sine", "amplitude": 0.2, "frequency": 0.11},
            "start": {"displacement": 1.0},
            "run": {"seed": 1, "settle": 1000.0, "duration": 200.0, "realizations": 1},
        }
    )
    default, fine = (
        simulate(scene, method="monte-carlo", step=step, workers=1)["mean_power"]
        for step in ("default", "fine")
    )
    off = abs(default.estimate - fine.estimate)
    assert off < 2.0 * default.standard_error < 1e-3 * fine.estimate


@pytest.mark.usefixtures("shared_workers")
def test_overtones_of_a_load_that_meet_the_resonance_are_in_the_error_of_the_steps():
    """A bridge makes odd harmonics: at a third of the resonance default steps misplaced it."""
    omega, quality, mass, capacitance = 80.0, 120.0, 0.0125, 6e-9
    scene = Scene.from_tables(
        {
            "units": "SI",
            "oscillator": {
                "mass": mass,
                "damping": mass * omega / quality,
                "restoring_force": [0.0, mass * omega**2],
            },
            "piezo": {"coupling": 1e-4, "capacitance": capacitance},
            "load": {
                "netlist": "bridge",
                "parameters": {"resistance": 8e6, "storage": 6e-8},
            },
            "excitation": {
                "kind": "sine", "amplitude": 9.0, "frequency": 1.013 * omega / (6.0 * math.pi),
            },
            "run": {"seed": 1, "settle": 25.0, "duration": 5.0, "realizations": 1},
        },
        name="bridge",
    )  # fmt: skip
    elsewhere = scene.replace({"excitation.frequency": 0.4 * omega / (2.0 * math.pi)})
    assert spread(prepared(elsewhere)) < 0.01
    assert spread(prepared(scene)) > 1.0
    default, finest = (
        simulate(scene, method="monte-carlo", step=step, workers=1)["mean_output_power"]
        for step in ("default", "finest")
    )
    off = abs(default.estimate - finest.estimate)
    assert off < 2.0 * default.standard_error < 0.03 * finest.estimate
