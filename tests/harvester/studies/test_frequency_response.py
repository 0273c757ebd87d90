import json
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from truths import flat

import harvester
from harvester.base.errors import HarvesterError
from harvester.base.signatures import grid_of
from harvester.cli.command_line import main
from harvester.device.record import Record
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.studies.frequency_response import (
    SETTLED_SHARE,
    _integrals,
    _means,
    _peak,
    stepped,
    with_sine,
)

pytestmark = pytest.mark.usefixtures("shared_workers")
# Of a resonance at 111.4 Hz and a Q of 152: far below it, at it and above it.
FLANKS = [94.8, 111.6, 119.9]


def sine(name, amplitude, **changes):
    tables = Scene.read(name).to_tables()
    tables["excitation"] = {"kind": "sine", "amplitude": amplitude, "frequency": 1.0}
    for table, values in changes.items():
        tables[table] = {**tables.get(table, {}), **values}
    return Scene.from_tables(tables, name=name)


def transfer(p, frequency, amplitude):
    """|X| and rms V of a linear device (Eq. 4)."""
    s = 2j * np.pi * frequency
    ratio = s / (s + p.decay_rate)
    x = amplitude / (p.linear_stiffness + s * s + s * p.damping + p.coupling * ratio)
    return np.abs(x), np.abs(x * ratio) / np.sqrt(2.0)


@pytest.mark.parametrize(
    ("method", "step", "frequencies", "tolerance"),
    # The trapezoidal rule of the circuit: (2π/80)²/12 of the frequency, times Q.
    [
        ("monte-carlo", "default", [0.1, 0.3, 0.37, 0.5, 1.0], 3e-4),
        ("circuit", "fine", [0.3, 0.5], 1e-3),
    ],
)
def test_a_linear_device_has_its_transfer_function(pool, method, step, frequencies, tolerance):
    scene = sine("linear", 0.3)
    response = harvester.frequency_response(
        scene, frequencies, method=method, step=step, executor=pool
    )
    p = flat(scene)
    amplitude, voltage = transfer(p, np.array(frequencies), 0.3)
    for sweep in response.sweeps:
        np.testing.assert_allclose(sweep.displacement_amplitude, amplitude, rtol=tolerance)
        np.testing.assert_allclose(sweep.rms_voltage, voltage, rtol=tolerance)
        power = p.coupling * p.decay_rate * voltage**2
        np.testing.assert_allclose(sweep.mean_power, power, rtol=2 * tolerance)
        assert np.all(sweep.residual < 1e-5)


@pytest.mark.slow
def test_powers_far_from_a_narrow_resonance_lie_within_the_printed_error(pool):
    """Steps that are exact at the resonance alone cost a bridge 0.7 to 1 % there."""
    tables = {
        "units": "SI",
        "oscillator": {"mass": 1.277e-3, "damping": 5.877e-3, "restoring_force": [0.0, 625.7]},
        "piezo": {"coupling": 9.363e-4, "capacitance": 4.748e-8},
        "load": {"netlist": "bridge", "parameters": {"resistance": 46.6e3, "storage": 0.5e-6}},
        "excitation": {"kind": "sine", "amplitude": 2.553, "frequency": 111.6},
        "run": {"duration": 0.5},
    }
    scene = Scene.from_tables(tables, name="narrow")
    usual, fine = (
        harvester.frequency_response(scene, FLANKS, step=step, executor=pool).sweeps[0]
        for step in ("default", "fine")
    )
    off = np.abs(usual.mean_power / fine.mean_power - 1.0)
    assert np.all(off < 2.0 * usual.step_error)
    assert np.all(off < 2e-3)
    # At 94.8 Hz the load takes a hundredth of the apparent power, which the bar knows.
    assert usual.step_error[0] > 2.0 * usual.step_error[2]


def test_si_units_are_those_of_the_scene(pool):
    oscillator = {"linear_stiffness": 126.9, "cubic_stiffness": 0.0}
    scene = Scene.read("device").replace(oscillator=oscillator)
    response = harvester.frequency_response(scene, [12.0], amplitude=2.0, executor=pool)
    mass, theta, cp, load = 0.022, 3.69e-4, 4.3e-8, 306e3
    s = 2j * np.pi * 12.0
    ratio = theta * s / (s * cp + 1 / load)
    x = mass * 2.0 / (126.9 + mass * s * s + 0.03342 * s + theta * ratio)
    power = np.abs(x * ratio) ** 2 / (2 * load)
    (sweep,) = response.sweeps
    # Runge–Kutta's (2π/40)⁴/120 of the frequency, near a resonance of Q = 50.
    assert response.values("displacement_amplitude", sweep)[0] == pytest.approx(abs(x), rel=5e-4)
    assert response.values("mean_power", sweep)[0] == pytest.approx(power, rel=1e-3)


def test_a_hardening_spring_shows_hysteresis(pool):
    changes = {"oscillator": {"damping": 0.1, "cubic_stiffness": 1.0}}
    changes["piezo"], changes["load"] = {"coupling": 0.2}, {"decay_rate": 0.5}
    scene = sine("linear", 0.5, **changes)
    response = harvester.frequency_response(
        scene, np.linspace(0.3, 0.45, 7), down=True, executor=pool
    )
    up, down = (sweep.displacement_amplitude for sweep in response.sweeps)
    # Both branches at 0.375 Hz, one below and above.
    assert up[3] > 3 * down[3]
    np.testing.assert_allclose(up[[0, 1, 2, 5, 6]], down[[0, 1, 2, 5, 6]], rtol=2e-3)
    assert up[3] == pytest.approx(_swept_up(flat(scene), response.frequencies[:4]), rel=1e-3)


def _swept_up(p, frequencies):
    """Amplitude at the last of some frequencies, 120 s at each, by DOP853."""
    state, turn = np.zeros(3), 0.0
    for frequency in frequencies:

        def derivative(time, y, start=turn, frequency=frequency):
            x, v, voltage = y
            force = 0.5 * np.sin(2 * np.pi * (start + frequency * time)) - p.damping * v
            force -= p.linear_stiffness * x + p.cubic_stiffness * x**3 + p.coupling * voltage
            return [v, force, v - p.decay_rate * voltage]

        times = np.linspace(100.0, 120.0, 4001)
        solved = solve_ivp(derivative, (0, 120), state, "DOP853", times, rtol=1e-8, atol=1e-9)
        state, turn = solved.y[:, -1], turn + 120.0 * frequency
    return 0.5 * np.ptp(solved.y[0])


@pytest.mark.slow
def test_the_command_writes_table_json_and_figure(tmp_path, capsys):
    scene = tmp_path / "sine.toml"
    scene.write_text(
        'units = "scaled"\n[oscillator]\ndamping = 0.2\nlinear_stiffness = 4.0\n[piezo]\n'
        "coupling = 1.0\n[load]\ndecay_rate = 2.0\n[excitation]\n"
        'kind = "sine"\namplitude = 0.3\nfrequency = 0.3\n[run]\nduration = 100.0\n'
    )
    command = ["frequency-response", str(scene), "--frequencies", "0.2:0.6:log:3", "--down"]
    assert main([*command, "--output", str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    for word in ("sweep down", "rms voltage", "residual", "largest power"):
        assert word in shown
    content = json.loads((tmp_path / "sine-frequency-response.json").read_text())
    assert len(content["sweeps"]["down"]["mean_power"]) == 3
    assert (tmp_path / "sine-frequency-response.png").exists()
    rows = (tmp_path / "sine-frequency-response.csv").read_text().splitlines()
    assert rows[0].startswith("sweep,frequency [Hz],displacement_amplitude [scaled],")
    powers = [float(row.split(",")[4]) for row in rows[1:] if row.startswith("down")]
    assert powers == pytest.approx(content["sweeps"]["down"]["mean_power"], rel=1e-8)
    xarray = pytest.importorskip("xarray")
    grid = xarray.load_dataset(tmp_path / "sine-frequency-response.nc", engine="scipy")
    down = grid["mean_power"].sel(sweep="down").values.tolist()
    assert down == content["sweeps"]["down"]["mean_power"]
    assert main(["frequency-response", "paper", "--frequencies", "1"]) == 2
    assert '"sine"' in capsys.readouterr().err
    short = ["--frequencies", "1", "--amplitude"]
    assert main(["frequency-response", "linear", *short, "0"]) == 2
    assert "amplitude 0" in capsys.readouterr().err


def test_points_at_one_time_spoil_neither_integral_nor_peak():
    """Where a switch turns there are two: here at the end, and at the peak."""
    times = np.array([0.0, 0.5, 1.0, 1.0, 1.5, 2.0, 2.0])
    values = np.array([0.0, 1.0, 2.0, 2.0, 1.0, 0.0, 0.0])
    assert _integrals(times, values, (0.0, 1.0, 2.0)) == pytest.approx([1.0, 1.0])
    assert _peak(times, values) == pytest.approx(2.0)


def test_an_amplitude_is_half_of_what_lies_between_the_ends():
    """Of a motion about another place than 0, over two of six periods; before, it was larger."""
    time = np.linspace(0.0, 3.0, 3001)
    swing = np.where(time < 2.0, 0.9, 0.5) * np.sin(4.0 * np.pi * time)
    voltage = 0.2 + 2.0 * swing
    one = np.zeros_like(time)
    record = Record(time, 0.3 + swing, one, voltage, voltage**2 / 4.0, one, one, one, voltage)
    amplitude, rms, power, residual = _means(record, one, 3.0, 1.0)[:4]
    assert amplitude == pytest.approx(0.5, rel=1e-4)
    assert rms == pytest.approx(math.sqrt(0.2**2 + 0.5), rel=1e-4)
    assert power == pytest.approx((0.2**2 + 0.5) / 4.0, rel=1e-4)
    assert residual < 1e-3


def test_it_dwells_until_a_storage_is_charged():
    """R·C of 10 s is longer than what the motion of `device` remembers."""
    storing = {"load.netlist": "bridge", "load.parameters.resistance": 1e6}
    dwells = [
        stepped(
            prepared(with_sine(Scene.read("device").replace(storing | {name: size}), 1.0)),
            np.array([12.0]),
        )
        for name, size in (("load.parameters.storage", 1e-8), ("load.parameters.storage", 1e-5))
    ]
    short, long = (scene.excitation.dwell for scene in dwells)
    assert short < 20.0
    assert long > 10.0 * math.log(1.0 / SETTLED_SHARE)


@pytest.mark.parametrize("frequency", [1e-300, 1e-9, 1e12])
def test_frequencies_that_no_run_ends_with_are_refused(frequency):
    with pytest.raises(HarvesterError, match=r"frequencies .* Hz: .* exceed 1e\+10 steps"):
        harvester.frequency_response("linear", frequencies=[frequency], amplitude=1.0)


def test_frequencies_have_a_short_form(capsys):
    np.testing.assert_allclose(grid_of("0.1:10:log:3"), [0.1, 1, 10])
    np.testing.assert_allclose(grid_of("1:2:linear:3"), [1, 1.5, 2])
    assert grid_of("1,2.5") == [1.0, 2.5]
    for text in ("1:2", "1:2:lin:3", "a", "1:2:log:x"):
        assert main(["frequency-response", "linear", "--frequencies", text]) == 2
        assert f"--frequencies {text}: must be written as 0.1:2:log:40" in capsys.readouterr().err
    with pytest.raises(HarvesterError, match="> 0"):
        harvester.frequency_response(sine("linear", 0.3), [0.0, 1.0])


def test_output_power_excludes_what_a_source_supplies(tmp_path, pool):
    """A follower draws nothing: all of its output is supplied."""
    file = tmp_path / "follower.lib"
    file.write_text(
        ".subckt follower p n out ref\nRp p n 60k\nE1 out ref p n 1\nRl out ref 60k\n"
        "Rw ref n 1k\n.ends\n"
    )
    scene = Scene.read("cantilever", [f'load.netlist="{file}"'])
    found = harvester.frequency_response(scene, [47.0], amplitude=9.80665, executor=pool)
    (sweep,) = found.sweeps
    assert found.values("mean_power", sweep) > 0.0
    used = 0.5 * found.values("peak_voltage", sweep) ** 2 / 60e3
    assert abs(found.values("mean_output_power", sweep)) < 1e-5 * used


@pytest.mark.slow
def test_tip_voltage_and_output_behind_a_netlist_per_g(tmp_path, pool):
    """A linear piezo on a divider, by its transfer functions; 2 g, shown for 1 g."""
    upper, lower, level = 60e3, 25e3, 2.0
    file = tmp_path / "divider.lib"
    file.write_text(
        f".subckt divider p n out ref\nRu p out {upper}\nRl out ref {lower}\nRw ref n 1u\n.ends\n"
    )
    scene = Scene.read("cantilever", [f'load.netlist="{file}"'])
    found = harvester.frequency_response(
        scene, [44.0, 47.0], amplitude=level * 9.80665, per_g=True, executor=pool
    )
    assert found.shown == (
        "displacement_amplitude", "rms_voltage", "mean_power", "mean_output_voltage",
        "mean_output_power",
    )  # fmt: skip
    o, t = scene.oscillator, scene.transducer
    w = 2.0 * np.pi * np.array([44.0, 47.0])
    total = upper + lower
    volts = t.coupling / (t.capacitance + 1.0 / (1j * w * total))
    stiff = o.linear_stiffness - o.mass * w**2 + 1j * w * o.damping + t.coupling * volts
    tip = o.base_factor * o.mass * 9.80665 / stiff
    v = np.abs(tip * volts)
    (sweep,) = found.sweeps
    for name, truth in (
        ("displacement_amplitude", np.abs(tip)),
        ("absolute_amplitude", np.abs(tip + 9.80665 / w**2)),
        ("rms_voltage", v / np.sqrt(2.0)),
        ("peak_voltage", v),
        ("mean_power", v**2 / (2.0 * total)),
        ("peak_power", v**2 / total),
        ("mean_output_power", v**2 * lower / (2.0 * total**2)),
    ):
        np.testing.assert_allclose(found.values(name, sweep), truth, rtol=4e-3, err_msg=name)
    assert np.abs(found.values("mean_output_voltage", sweep)).max() < 1e-3 * v.max()
    assert found.unit("power") == "W/g²"
    assert found.to_dict()["sweeps"]["up"]["peak_voltage"] == pytest.approx(v, rel=2e-3)
    assert found.headline().startswith("largest output power")
