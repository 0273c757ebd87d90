"""One recorded path for the circuit, Monte Carlo and the exported netlist."""

import re

import numpy as np
import pytest
from scipy import signal

from circuits.equivalent.export import stand_alone
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path
from harvester.scene.prepared import prepared
from harvester.studies.comparison.comparison import Comparison


@pytest.fixture
def quake(tmp_path):
    """A scene of `device` with 300 s of ground motion at 100 Hz, in g, with an envelope."""
    rng = np.random.default_rng(3)
    time = np.arange(30001) / 100
    sections = signal.butter(2, [0.5, 20.0], "bandpass", fs=100.0, output="sos")
    motion = signal.sosfiltfilt(sections, rng.standard_normal(time.size))
    motion *= 0.3 + np.exp(-(((time - 100.0) / 60.0) ** 2))
    motion *= 0.3 / motion.std()
    np.savetxt(
        tmp_path / "quake.csv",
        np.column_stack([time, motion, 0.0 * motion]),
        fmt=["%.2f", "%.6f", "%.1f"],
        delimiter=",",
        header="time,north,up",
        comments="",
    )
    tables = Scene.read("device").to_tables()
    tables["excitation"] = {
        "kind": "record",
        "file": str(tmp_path / "quake.csv"),
        "column": "north",
        "time_column": "time",
        "unit": "g",
        "detrend": "none",
    }
    tables["run"] = {"duration": 290.0, "settle": 5.0}
    return Scene.from_tables(tables, name="quake")


@pytest.mark.slow
def test_a_record_gives_power_with_error_bars_that_agree(pool, quake):
    """The mean power at three joint standard errors: 0.3 % false alarms at most."""
    circuit, reference = (
        simulate(quake, method=engine, runner=pool) for engine in ("circuit", "monte-carlo")
    )
    comparison = Comparison(circuit, reference, {}, {}, {})
    for result in (circuit, reference):
        power = result.quantity("mean_power")
        assert 0.0 < power.standard_error < 0.2 * power.estimate
        assert abs(result.energy_balance_residual) < 0.01
    assert abs(comparison.difference("mean_power")) < 3.0
    assert abs(comparison.difference("power_conversion_efficiency")) < 3.0


def test_circuit_and_monte_carlo_follow_the_record_point_by_point(pool, quake):
    """Until the two steps let the paths separate: the first seconds, from rest."""
    short = quake.replace({"run.duration": 3.0, "run.settle": 0.0})
    window = (0.0, 3.0)
    circuit = simulate(
        short, method="circuit", step="finest", window=window, runner=pool
    ).waveform.record
    reference = simulate(
        short, method="monte-carlo", step="fine", window=window, runner=pool
    ).waveform.record
    at = np.interp(circuit.time, reference.time, reference.displacement)
    np.testing.assert_allclose(circuit.displacement, at, atol=2e-3)
    assert np.ptp(at) > 0.1


def test_the_exported_netlist_holds_the_same_knots(quake, tmp_path):
    short = quake.replace({"run.duration": 2.0, "run.settle": 0.0})
    ready = prepared(short)
    netlist = stand_alone(prepared(short), noise_path(ready, 0))
    source = re.search(r"Inoise 0 velocity PWL\((.*?)\)", netlist.text, re.DOTALL).group(1)
    numbers = np.array(source.replace("+", " ").split(), dtype=float).reshape(-1, 2)
    path = noise_path(ready, 0).read(len(numbers))
    np.testing.assert_allclose(numbers[:, 0], 0.01 * np.arange(201), atol=1e-12)
    np.testing.assert_allclose(numbers[:, 1] * netlist.rate**2, path, rtol=1e-12)
    np.testing.assert_allclose(
        -path * 0.01 / 9.80665,
        np.genfromtxt(tmp_path / "quake.csv", delimiter=",", skip_header=1)[:201, 1],
        atol=1e-12,
    )
