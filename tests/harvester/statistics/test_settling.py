"""Runs shorter than what their device and load remember say so, and show no error bar."""

import math
import warnings

import numpy as np
import pytest
from scipy.signal import lfilter

from harvester.averaging.closures import average
from harvester.engines.methods import ENGINES
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.statistics.estimate import UNRESOLVED, Estimate
from harvester.statistics.moments import QUANTITIES, Moments
from harvester.statistics.settling import (
    _expected_jumps,
    _linear,
    left_of_start,
    shortfalls,
    withheld,
)

SLOW_LOAD = ["load.decay_rate=1e-3", "excitation.intensity=0.1", "run.realizations=32"]
LONG = {"run.settle": 8000.0, "run.duration": 2000.0}

# Others of the same kinds are exhaustive.
BRIEF = ("cantilever", "device", "duffing", "linear", "paper")
EACH = [
    pytest.param(name, marks=() if name in BRIEF else pytest.mark.exhaustive)
    for name in Scene.names()
]


def notes_of(result):
    return [note for note in result.notes if "run." in note or "drifts" in note]


@pytest.mark.slow
@pytest.mark.parametrize("name", EACH)
def test_built_in_scenes_are_long_enough(pool, name):
    result = simulate(Scene.read(name), method="monte-carlo", runner=pool)
    assert notes_of(result) == []
    assert result.scaled_quantities["mean_square_voltage"].standard_error > 0.0


@pytest.mark.parametrize("engine", ENGINES)
def test_a_run_short_against_the_load_has_no_error_bar_and_names_the_time(pool, engine):
    scene = Scene.read("paper", [*SLOW_LOAD, "run.realizations=16", "run.duration=300"])
    result = simulate(scene, method=engine, runner=pool)
    found = result.scaled_quantities["mean_square_voltage"]
    assert found.standard_error is None
    assert found.estimate > 0.0
    assert "1/λ" in found.note
    assert any("1/λ of 1e+03 s" in note and "run.settle" in note for note in result.notes)
    assert "no error bar" in result.to_dict()["quantities"]["mean_power"]["note"]


@pytest.mark.exhaustive
def test_long_enough_after_the_advice_it_has_one_that_holds(pool):
    """Within four standard errors of averaging, whose own error is 1 % here."""
    scene = Scene.read("paper", SLOW_LOAD).replace(LONG)
    result = simulate(scene, method="monte-carlo", runner=pool)
    assert notes_of(result) == []
    found = result.scaled_quantities["mean_square_voltage"]
    truth = average(prepared(scene).system).mean_square_voltage
    assert abs(found.estimate - truth) < 4.0 * found.standard_error + 0.01 * truth


def test_a_run_from_rest_shorter_than_the_relaxation_is_noted(pool):
    scene = Scene.read(
        "linear",
        ["oscillator.damping=0.01", "run.settle=0", "run.duration=20", "load.decay_rate=9"],
    )
    result = simulate(scene, method="monte-carlo", runner=pool)
    assert result.scaled_quantities["mean_square_velocity"].standard_error is None
    assert any("relaxation of device and load" in note for note in result.notes)
    assert result.densities["velocity"].standard_error is None


def test_a_slow_load_of_a_linear_device_is_no_shortfall(pool):
    """Without wells the charge begins at its mean: a long 1/λ alone is no reason for a note."""
    result = simulate(
        Scene.read("linear", ["load.decay_rate=1e-4"]), method="monte-carlo", runner=pool
    )
    assert notes_of(result) == []


@pytest.mark.parametrize(
    ("intensity", "words"), [(0.015, "no pass between the wells"), (0.001, None)]
)
def test_jumps_that_may_be_missed_are_named_and_impossible_ones_are_not(pool, intensity, words):
    scene = Scene.read(
        "paper", [f"excitation.intensity={intensity}", "run.realizations=8", "run.duration=1000"]
    )
    result = simulate(scene, method="monte-carlo", runner=pool)
    assert result.scaled_quantities["well_crossing_rate"].estimate == 0.0
    assert result.scaled_quantities["well_crossing_rate"].standard_error is None
    assert [words in note for note in notes_of(result)] == ([True] if words else [])


def test_jumps_are_expected_by_the_upper_end_of_the_energy_s_interval():
    """Else runs with little energy by chance keep bars, and their means are all too low."""
    scene = Scene.read("paper", ["run.realizations=4", "run.duration=500"])
    moments = series(scene, np.ones((4, 16)))

    def jumps(energy, error):
        estimates = {"mean_square_velocity": Estimate(energy, error, None, "velocity^2")}
        return _expected_jumps(prepared(scene).system, moments, estimates)

    assert jumps(0.12, 0.015) == jumps(0.15, None) > 2.0 * jumps(0.12, None)


def series(scene, values):
    """Moments whose mean squares are these, shape (realizations, batches)."""
    found = []
    for row in values:
        moments = Moments.empty(
            0.0, float(len(row)), (-math.inf, math.inf), (), False, len(row), 1, 1.0
        )
        moments.integrals[:, QUANTITIES.index("time")] = 1.0
        for name in ("square_voltage", "square_displacement", "square_velocity"):
            moments.integrals[:, QUANTITIES.index(name)] = row
        moments.first[0], moments.last[0] = 0.0, float(len(row))
        found.append(moments)
    return found


def judged(values, memory=0.0):
    from harvester.statistics.run_quantities import estimate_all

    scene = Scene.read("linear", ["run.settle=1000", f"run.realizations={len(values)}"])
    ready = prepared(scene)
    moments = series(scene, values)
    estimates = estimate_all(moments, ready.system)
    found = shortfalls(ready, moments, estimates, memory=memory)
    return found, withheld(estimates, found)["mean_square_voltage"]


@pytest.mark.parametrize("shape", [(1, 256), (64, 4)])
def test_a_drift_is_told_from_chance(shape):
    """Chance at 4.5 standard errors: below one false alarm in 300 series, 600 tried here."""
    random = np.random.default_rng(8)
    alarms = sum(bool(judged(1.0 + 0.3 * random.random(shape))[0]) for _ in range(300))
    assert alarms == 0
    drifting = 1.0 + 0.3 * random.random(shape) + np.linspace(0.0, 0.3, shape[1])
    found, estimate = judged(drifting)
    assert "drifts" in found[0].note
    assert estimate.standard_error is None


def test_what_is_left_of_a_start():
    time = np.linspace(3.0, 10.0, 100_001)
    expected = np.trapezoid(np.exp(-time / 2.0), time) / 7.0
    assert left_of_start(2.0, 3.0, 7.0) == pytest.approx(expected, rel=1e-8)
    assert left_of_start(1e300, 1.0, 1.0) == pytest.approx(1.0)
    assert left_of_start(1e-300, 1.0, 1.0) == 0.0


def test_a_storage_that_is_still_charging_is_named(pool):
    load = "load={netlist='bridge', parameters={storage=1e-4}}"
    run = ["run.realizations=2", "run.duration=2", "run.settle=0.5"]
    result = simulate(Scene.read("device", [load, *run]), method="circuit", runner=pool)
    assert any("cstorage (bridge.lib:28) still charges" in note for note in result.notes)
    for name in ("output_voltage", "mean_output_power", "mean_square_voltage"):
        assert result.scaled_quantities[name].standard_error is None
        assert math.isfinite(result.scaled_quantities[name].estimate)


def test_rates_too_far_apart_to_be_compared_are_no_trouble(pool):
    scene = Scene.read(
        "linear", ["excitation.correlation_time=1e29", "run.duration=1", "run.realizations=1"]
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert simulate(scene, method="monte-carlo", runner=pool).steps > 0


def test_short_settled_runs_do_not_drift():
    """100 runs of 14 correlation times and 50 cycles: batches alone show a drift in eight."""
    steps, times = 4096, 14.0
    alarms = 0
    for seed in range(100):
        random = np.random.default_rng(seed)
        keep = np.exp(-0.5 * times / steps)
        white = np.sqrt(1.0 - keep**2) * random.standard_normal((2, steps))
        white[:, 0] /= np.sqrt(1.0 - keep**2)
        real, imaginary = lfilter([1.0], [1.0, -keep], white)
        phase = 2.0 * np.pi * 50.0 * np.arange(steps) / steps
        square = (real * np.cos(phase) + imaginary * np.sin(phase)) ** 2
        values = square.reshape(1, 256, -1).mean(axis=2)
        alarms += bool(judged(values, memory=256 / times)[0])
    assert alarms == 0


def disc(folder, settle, duration, **changes):
    """A disc of Q = 120 at 50 Hz under a recorded sine and noise: its amplitude time is 0.76 s."""
    time = np.arange(round(1000 * (settle + duration)) + 2) / 1000.0
    noise = np.random.default_rng(3).standard_normal(time.size)
    values = np.sin(2.0 * np.pi * 50.0 * time + 1.0) + 0.15 * noise
    file = folder / f"{settle}_{duration}.csv"
    heading = "time [s],acceleration [m/s^2]"
    np.savetxt(file, np.c_[time, values], delimiter=",", header=heading, comments="")
    return Scene.from_tables(
        {
            "units": "SI",
            "oscillator": {"mass": 4e-3, "frequency": 50.0, "quality_factor": 120.0},
            "piezo": {"coupling": 1e-4, "capacitance": 30e-9},
            "load": {"resistance": 1e5},
            "excitation": {"kind": "record", "file": str(file)},
            "run": {"duration": duration, "settle": settle, "realizations": 1},
        }
    ).replace(changes)


def test_a_device_that_rings_up_under_a_record_has_no_bar_and_a_settled_one_does(pool, tmp_path):
    """The ring-up lowers the mean by a fifth; batches alone show an error of a percent."""
    unsettled = simulate(disc(tmp_path, 0.1, 6.0), method="monte-carlo", runner=pool)
    assert unsettled["mean_power"].standard_error is None
    (note,) = (note for note in unsettled.notes if "relaxation" in note)
    assert "raise run.settle to at least 5.8 s, which takes a record of 12 s" in note
    settled = simulate(disc(tmp_path, 6.0, 20.0), method="monte-carlo", runner=pool)
    assert not any("relaxation" in note for note in settled.notes)
    power = settled["mean_power"]
    assert 0.0 < power.standard_error < 0.05 * power.estimate
    assert unsettled["mean_power"].estimate < 0.85 * power.estimate


def test_effective_samples_are_at_most_the_correlation_times_of_a_record(pool, tmp_path):
    found = simulate(disc(tmp_path, 6.0, 20.0), method="monte-carlo", runner=pool)
    energy_time = 120.0 / (2.0 * np.pi * 50.0)
    for name in ("mean_power", "mean_square_velocity", "power_conversion_efficiency"):
        assert 7.0 < found[name].effective_sample_size < 20.0 / energy_time


def test_what_a_regulator_holds_keeps_its_own_bar_while_the_device_rings_up(pool, tmp_path):
    load = tmp_path / "regulated.lib"
    load.write_text(
        ".subckt regulated p n out ref\n.model d d(is=200n rs=10)\nD1 p rail d\nD2 ref p d\n"
        "D3 n rail d\nD4 ref n d\nCstray ref n 10p\nCbuffer rail ref 1m ic=2.5\n"
        "Bout out ref V=0.9*(1+tanh((v(rail,ref)-1.9)*50))\nRload out ref 100k\n.ends\n"
    )
    scene = disc(tmp_path, 0.1, 1.5, **{"load.netlist": str(load), "piezo.coupling": 1e-3})
    found = simulate(scene, method="monte-carlo", runner=pool)
    assert found["mean_power"].standard_error is None
    output = found["output_voltage"]
    assert output.estimate == pytest.approx(1.8, abs=1e-6)
    assert output.standard_error < 1e-6
    assert found["output_ripple"].note == UNRESOLVED


def test_an_output_that_ramps_under_a_record_says_so(pool, tmp_path):
    scene = disc(tmp_path, 6.0, 6.0, **{"load.netlist": "bridge", "piezo.coupling": 1e-3})
    scene = scene.replace({"load.parameters": {"storage": 1e-3, "resistance": 1e6}})
    found = simulate(scene, method="monte-carlo", runner=pool)
    assert "rises throughout" in found["output_voltage"].note
    assert found["mean_square_velocity"].standard_error > 0.0
    assert any("raise run.settle, or start the stores" in note for note in found.notes)


def test_one_record_tells_nothing_of_means_that_follow_a_slow_store(pool, tmp_path):
    """The bridge holds the voltage at its store's, whose time constant is a tenth of the record."""
    scene = disc(tmp_path, 6.0, 20.0, **{"load.netlist": "bridge", "piezo.coupling": 1e-3})
    storage = {"fast": 1e-7, "slow": 4e-6}
    bars = {}
    for name, size in storage.items():
        changed = scene.replace({"load.parameters": {"storage": size, "resistance": 5e5}})
        found = simulate(changed, method="monte-carlo", runner=pool)
        assert found["mean_square_velocity"].standard_error > 0.0
        bars[name] = [found[n].standard_error for n in ("rms_voltage", "mean_converter_loss")]
    assert bars["slow"] == [None, None]
    assert all(bars["fast"])


@pytest.mark.parametrize(("load", "states"), [({"netlist": "bridge"}, 3), ({"resistance": 2e4}, 4)])
def test_a_leakage_is_no_relaxation_behind_a_rectifier(load, states):
    """A bridge discharges the piezo long before the leakage, of 4 s, would."""
    scene = Scene.from_tables(
        {
            "units": "SI",
            "oscillator": {"mass": 0.01, "frequency": 60.0, "quality_factor": 20.0},
            "piezo": {"capacitance": 9e-8, "k2": 0.08, "leakage_resistance": 4e7},
            "load": load,
            "excitation": {"rms": 2.0, "correlation_time": 5e-3},
            "run": {"duration": 8.0},
        }
    )
    names = "mean_square_displacement", "mean_square_velocity", "mean_power", "mean_loss_power"
    estimates = {name: Estimate(1.0, 0.1, 10.0, "1") for name in names}
    matrix, _ = _linear(prepared(scene).system, estimates, scene.load.is_resistor)
    assert len(matrix) == states
