"""A record of a few pulses: its energy, and what the steps may cost it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from harvester.engines.realization import RESOLVED
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.statistics.run_estimates import with_steps

pytestmark = pytest.mark.usefixtures("shared_workers")

INTERVAL, SETTLE, DURATION = 0.002, 0.1, 2.3
MASS, DAMPING, SPRING, CUBIC = 0.0115, 0.0043, 49.4, 1.38e7
COUPLING, CAPACITANCE, RESISTANCE = 6.6e-5, 2.5e-8, 1e5
SCENE = f"""
units = "SI"
[oscillator]
mass = {MASS}
damping = {DAMPING}
linear_stiffness = {SPRING}
cubic_stiffness = CUBIC
[piezo]
coupling = {COUPLING}
capacitance = {CAPACITANCE}
[start]
displacement = 0.0
velocity = 0.0
[load]
kind = "resistor"
resistance = {RESISTANCE}
[excitation]
kind = "record"
file = "pulses.csv"
unit = "m/s^2"
sampling_rate = {1 / INTERVAL}
detrend = "none"
[run]
settle = {SETTLE}
duration = {DURATION}
realizations = 1
"""


def pulses():
    """Three half sines of 6 ms, the second against the others."""
    time = np.arange(round((SETTLE + DURATION) / INTERVAL) + 1) * INTERVAL
    begins = ((0.2, -93.0), (0.9, 88.0), (1.7, -104.0))
    shapes = [peak * np.sin(np.pi * (time - begin) / 0.006) for begin, peak in begins]
    inside = [(time >= begin) & (time <= begin + 0.006) for begin, _ in begins]
    return np.sum(np.where(inside, shapes, 0.0), axis=0)


def power_by_scipy(samples, cubic):
    """Mean power by DOP853, restarted at every sample."""
    rates = np.diff(samples) / INTERVAL
    state, before = np.zeros(4), 0.0
    for k, rate in enumerate(rates):

        def derivative(t, y, k=k, rate=rate):
            x, v, voltage = y[:3]
            force = DAMPING * v + (SPRING + cubic * x * x) * x + COUPLING * voltage
            change = (COUPLING * v - voltage / RESISTANCE) / CAPACITANCE
            return [v, -samples[k] - rate * t - force / MASS, change, voltage**2 / RESISTANCE]

        if k == round(SETTLE / INTERVAL):
            before = state[3]
        found = solve_ivp(derivative, (0.0, INTERVAL), state, "DOP853", rtol=1e-9, atol=1e-12)
        state = found.y[:, -1]
    return (state[3] - before) / DURATION


@pytest.fixture
def scene_of(tmp_path):
    np.savetxt(tmp_path / "pulses.csv", pulses())

    def make(cubic):
        (tmp_path / "scene.toml").write_text(SCENE.replace("CUBIC", str(cubic)))
        return Scene.read(tmp_path / "scene.toml")

    return make


@pytest.mark.slow
@pytest.mark.parametrize("cubic", [0.0, CUBIC])
def test_energy_of_pulses_within_the_error_of_the_steps(scene_of, cubic):
    truth = power_by_scipy(pulses(), cubic)
    for method in ("monte-carlo", "circuit"):
        result = simulate(scene_of(cubic), method=method, workers=1)
        power = result.quantity("mean_power")
        assert abs(power.estimate - truth) < 2.0 * power.standard_error
        assert power.effective_sample_size is None
        assert power.standard_error >= result.step_error * power.estimate * (1.0 - 1e-9) > 0.0
        sensitive = any("sensitive to the steps" in note for note in result.notes)
        assert sensitive == (result.step_error >= 3.0 * RESOLVED)
        assert method == "circuit" or power.estimate == pytest.approx(truth, rel=RESOLVED)


def test_a_run_of_many_events_is_no_transient(scene_of):
    scene = scene_of(CUBIC)
    assert scene.excitation.transient(scene.run)
    noise = np.random.default_rng(1).standard_normal(pulses().size)
    np.savetxt(scene.excitation.file, noise)
    assert not scene_of(CUBIC).excitation.transient(scene.run)


def test_error_bars_of_a_chaotic_path_hold_its_scatter_and_others_do_not_grow(scene_of):
    scene = scene_of(CUBIC)
    well = np.sqrt(SPRING / CUBIC)
    # Noise that drives the device over the barrier between two wells in some of its periods.
    noise = np.random.default_rng(3).standard_normal(pulses().size)
    np.savetxt(scene.excitation.file, 2.0 * well * SPRING / MASS * noise)
    wells = {"oscillator.linear_stiffness": -SPRING, "start.displacement": well}
    chaotic, linear = scene_of(CUBIC).replace(wells), scene_of(0.0)
    assert not chaotic.excitation.transient(chaotic.run)
    options = {"method": "monte-carlo", "workers": 1}
    quiet, loud, finest = (
        simulate(each, step=step, **options)
        for each, step in ((linear, "default"), (chaotic, "default"), (chaotic, "finest"))
    )
    circuit = simulate(chaotic, method="circuit", workers=1)
    assert not any("chaotic" in note for note in quiet.notes)
    assert quiet.moments[0].spread == 0.0
    for each in (loud, circuit):
        assert any("the path is chaotic" in note for note in each.notes)
        assert each.moments[0].spread > 0.03
    power, other = (found.scaled_quantities["mean_power"] for found in (loud, finest))
    # A device that rings up has no bar. Another one holds the scatter.
    assert power.standard_error is None
    settled = replace(power, standard_error=0.01 * power.estimate)
    error = with_steps(chaotic, settled, loud.moments[0].spread).standard_error
    assert error >= loud.moments[0].spread * power.estimate
    assert abs(power.estimate - other.estimate) < 2.0 * error
