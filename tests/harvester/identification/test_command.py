"""From a measured file to the scatter of a quantity, on the command line."""

import json

import numpy as np
import pytest
from measured_records import scene_of

from harvester.cli.command_line import main
from harvester.scene.model import Scene
from harvester.scene.text import scene_text

MASS, COUPLING, COIL, LOAD = 0.01, 9.0, 300.0, 600.0
STIFFNESS = MASS * (2.0 * np.pi * 30.0) ** 2


def power(damping, coupling):
    """Mean power of a linear coil device on white noise, but for a factor: R Φ²/(R + Rc)² D/c."""
    return coupling**2 / (damping + coupling**2 / (COIL + LOAD))


@pytest.mark.slow
@pytest.mark.usefixtures("shared_workers")
def test_what_a_record_leaves_open_scatters_the_power_as_its_covariance_says(tmp_path, capsys):
    coil = {"coupling": COUPLING, "resistance": COIL}
    truth = scene_of(MASS, 0.05, [0.0, STIFFNESS], {"coil": coil}, LOAD)
    (tmp_path / "made.toml").write_text(scene_text(truth, {}, []))
    rng = np.random.default_rng(8)
    frequency = np.linspace(18.0, 48.0, 90)
    rate = 2j * np.pi * frequency
    damping = 0.05 + COUPLING**2 / (COIL + LOAD)
    seen = -MASS * rate * COUPLING * LOAD / (COIL + LOAD)
    seen = seen / (STIFFNESS + MASS * rate**2 + rate * damping)
    size = 0.02 * np.abs(seen).max()
    seen = seen + size * (rng.standard_normal(90) + 1j * rng.standard_normal(90))
    columns = np.column_stack([frequency, seen.real, seen.imag])
    header = "frequency [Hz],real [V/(m/s^2)],imaginary [V/(m/s^2)]"
    file = tmp_path / "response.csv"
    np.savetxt(file, columns, delimiter=",", header=header, comments="")
    words = ["identify", str(tmp_path / "made.toml"), "--record", str(file), "--alone"]
    assert main([*words, "--output", str(tmp_path)]) == 0
    identified = tmp_path / "made-identified.toml"
    words = ["sensitivity", str(identified), "--covariance", str(identified.with_suffix(".json"))]
    words += ["--method", "spectral", "--rows", "16", "--workers", "1"]
    assert main([*words, "--output", str(tmp_path)]) == 0
    capsys.readouterr()
    found = json.loads((tmp_path / "made-identified-sensitivity.json").read_text())
    covariance = json.loads(identified.with_suffix(".json").read_text())
    keys = [covariance["keys"].index(key) for key in ("oscillator.damping", "coil.coupling")]
    table = np.array(covariance["covariance"])[np.ix_(keys, keys)]
    scene = Scene.read(identified)
    values = np.array([scene.oscillator.damping, scene.transducer.coupling])
    slopes = np.array(
        [
            (power(*(values + step)) - power(*(values - step))) / (2.0 * step.max())
            for step in np.diag(1e-4 * values)
        ]
    )
    wanted = np.sqrt(slopes @ table @ slopes) / power(*values)
    # 80 devices: their deviation has a standard error of 8 %; four of those.
    scatter = found["standard_deviation"]["estimate"] / found["nominal"]["estimate"]
    assert scatter == pytest.approx(wanted, rel=0.32)


def test_a_record_kept_aside_needs_one_that_is_fitted_to(tmp_path, capsys):
    time = np.arange(600) / 50.0
    columns = np.column_stack([time, np.sin(20.0 * time), np.cos(20.0 * time)])
    file = tmp_path / "kept.csv"
    header = "time [s],acceleration [m/s^2],voltage [V]"
    np.savetxt(file, columns, delimiter=",", header=header, comments="")
    assert main(["identify", "paper_si", "--keep-aside", str(file)]) == 2
    assert "--record: no record to fit is given" in capsys.readouterr().err
