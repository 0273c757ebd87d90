"""Errors of means over whole periods, where nothing is by chance."""

import math

import numpy as np
import pytest

from harvester import Scene
from harvester.estimates.batch_means import error_without_chance
from harvester.estimates.of_run import run_estimates
from harvester.prepared.prepared import prepared
from harvester.prepared.steps import step_error
from harvester.simulation.methods import MonteCarlo
from harvester.simulation.realization import empty_moments, run


def test_equal_batches_have_no_error():
    assert error_without_chance(np.full((1, 7), 3.0)) == 0.0


def test_what_is_left_of_the_start_is_covered():
    batches = 1.0 + 0.1 * np.exp(-np.arange(64) / 8.0)[None]
    assert abs(batches.mean() - 1.0) < error_without_chance(batches) < 0.05


def test_a_resistor_after_two_seconds_is_known_to_its_steps():
    """Without whole periods the same run said ± 1.5 %."""
    excitation = {"kind": "sine", "amplitude": 1.0, "frequency": 6.3}
    length = {"run.settle": 4.0, "run.duration": 2.0, "run.realizations": 1}
    scene = Scene.load("device").replace(
        {
            "oscillator.linear_stiffness": 60.0,
            "oscillator.cubic_stiffness": 0.0,
            "oscillator.damping": 1.0,
            "excitation": excitation,
            **length,
        }
    )
    [found] = run(scene, MonteCarlo(), [0], None, lambda _: None)
    power = run_estimates(
        prepared(scene), [found.moments], step_error(prepared(scene), engine="monte-carlo")
    ).scaled["mean_power"]
    assert power.standard_error < 2e-3 * power.estimate
    assert power.effective_sample_size is None
    exact = linear_power(scene)
    assert abs(power.estimate / exact - 1.0) < 2e-3


def linear_power(scene):
    """By complex numbers, in scaled units."""

    ready = prepared(scene)
    system, scales = ready.system, ready.scales
    omega = 2.0 * math.pi * scene.excitation.frequency
    beta, rate = system.transducer.coupling, system.transducer.decay_rate()
    stiffness, force = system.spring.coefficients[1], scene.excitation.amplitude
    voltage = 1j * omega / (1j * omega + rate)
    force /= scales.displacement
    x = force / (stiffness - omega**2 + 1j * omega * system.damper.damping + beta * voltage)
    return 0.5 * beta * rate * abs(voltage * x) ** 2


@pytest.mark.parametrize("duration", [2.0, 2.07])
def test_the_mean_does_not_depend_on_where_a_period_is_cut(duration):
    scene = Scene.load("linear").replace(
        {
            "excitation": {"kind": "sine", "amplitude": 0.1, "frequency": 2.0},
            "oscillator.damping": 2.0,
            "run.settle": 20.0,
            "run.duration": duration,
            "run.realizations": 1,
        }
    )
    [found] = run(scene, MonteCarlo(), [0], None, lambda _: None)
    power = run_estimates(prepared(scene), [found.moments]).scaled["mean_power"]
    assert power.estimate == pytest.approx(linear_power(scene), rel=1e-3)


def test_what_a_bridge_gets_from_a_sine_has_an_error_without_samples():
    scene = Scene.load("device").replace(
        {
            "oscillator.linear_stiffness": 60.0,
            "oscillator.cubic_stiffness": 0.0,
            "oscillator.damping": 0.3,
            "excitation": {"kind": "sine", "amplitude": 3.0, "frequency": 8.3},
            "load": {"netlist": "bridge", "parameters": {"resistance": 1e6, "storage": 1e-6}},
            "run.settle": 10.0,
            "run.duration": 2.0,
            "run.realizations": 1,
        }
    )
    [found] = run(scene, MonteCarlo(), [0], None, lambda _: None)
    cost = step_error(prepared(scene), engine="monte-carlo")
    power = run_estimates(prepared(scene), [found.moments], cost).scaled["mean_output_power"]
    assert cost * power.estimate <= power.standard_error < 0.01 * power.estimate
    assert power.effective_sample_size is None


def test_one_batch_has_no_error():
    assert error_without_chance(np.ones((1, 1))) is None


# Under 12.5 Hz in a run of 1 s. With a period of 0.05 s both repeat after 0.4 s.
OWN_SOURCES = {
    "no source": ("Rx out ref 1meg", 0.96),
    "a sine": ("Vs s ref sin(0 5 20)", 0.8),
    "pulses": ("Vs s ref pulse(0 1 0 1m 1m 24m 50m)", 0.8),
    "a faster one": ("Vs s ref sin(0 5 100)", 0.96),
    "two": ("Vs s ref sin(0 5 20)\nVq q ref sin(0 1 25)", 0.8),
    "one that decays": ("Vs s ref sin(0 5 20 0 3)", 0.96),
    "one pulse": ("Vs s ref exp(0 1 0.1 0.1 0.3 0.1)", 0.96),
    "one that repeats once in the run": ("Vs s ref sin(0 5 1.25)", 0.96),
    "one without a simple ratio": ("Vs s ref sin(0 5 20.123456789)", 0.96),
}


@pytest.mark.parametrize("name", OWN_SOURCES)
def test_means_are_over_whole_periods_of_the_loads_sources_too(tmp_path, name):
    """Of a current that 20 Hz turn on, 0.96 s hold 1 % less than 0.8 s do."""
    source, measured = OWN_SOURCES[name]
    load = f".subckt load p n out ref\n{source}\nRo out ref 10k\nRg ref n 1k\nRp p n 306k\n.ends\n"
    (tmp_path / "load.lib").write_text(load)
    scene = Scene.load("device").replace(
        {
            "excitation": {"kind": "sine", "amplitude": 0.5, "frequency": 12.5},
            "load": {"netlist": str(tmp_path / "load.lib")},
            "run.settle": 0.5,
            "run.duration": 1.0,
            "run.realizations": 1,
        }
    )
    moments = empty_moments(prepared(scene))
    batches = len(moments.integrals)
    assert batches * moments.batch_length == pytest.approx(measured, rel=1e-9)
    assert moments.start + measured == pytest.approx(1.5, rel=1e-9)
