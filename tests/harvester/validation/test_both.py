"""One measurement, two pictures: both tell of the same runs."""

import json

import pytest

from harvester import accuracy
from harvester.cli.command_line import main
from harvester.scene.model import Scene
from harvester.validation import accuracy_measurement as measurement
from harvester.validation import timed, work_precision
from harvester.validation.accuracy_methods import REFERENCE, ComparedMethod

SQUARE = "mean_square_voltage"
SHORT = ["run.realizations=16", "run.duration=200", "run.settle=20"]
FEW = (
    ComparedMethod("Monte Carlo, Heun", "monte-carlo", 2, scheme="heun"),
    ComparedMethod("the reference", "monte-carlo", 4, REFERENCE.refinement),
)


@pytest.fixture
def briefly(monkeypatch):
    monkeypatch.setattr(timed, "NOISE_CLOSURES", ("consistent",))
    monkeypatch.setattr(measurement, "PATHS", 1)
    monkeypatch.setattr(measurement, "PERIODS", 1)


@pytest.mark.slow
@pytest.mark.usefixtures("briefly")
def test_both_pictures_tell_of_the_same_runs(pool):
    found = accuracy(Scene.read("linear", SHORT), methods=FEW, executor=pool)
    rows, lines = found.work_precision.rows, found.time_to_accuracy.lines
    assert [line.name for line in lines] == [row.method.family for row in rows]
    for row, line in zip(rows, lines, strict=True):
        assert line.simulated_time == pytest.approx(row.simulated_time * 200 / 220)
        paired, total = row.bias[SQUARE], line.errors[SQUARE]
        # On the same noise the paired difference and the control variate find the same bias.
        apart = abs(paired.estimate - total.bias.estimate)
        assert apart <= 0.5 * total.bias.standard_error + 1e-12
        # All of a run's sampling error is that of the reference over the same time.
        seconds = total.cost * line.simulated_time
        sampling = (total.after(seconds) ** 2 - total.resolved_bias**2) ** 0.5
        assert sampling == pytest.approx(row.sampling[SQUARE], rel=0.02)
    # The reference is known by itself, and has no bias.
    assert lines[1].errors[SQUARE].bias.estimate == rows[1].bias[SQUARE].estimate == 0.0
    told = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert list(told) == ["work_precision", "time_to_accuracy"]


@pytest.mark.exhaustive
@pytest.mark.usefixtures("briefly")
def test_the_command_writes_both_pictures(tmp_path, capsys, monkeypatch):
    few = Scene.read("linear", SHORT)
    made = work_precision.by_own_length
    monkeypatch.setattr(
        "harvester.validation.accuracy.by_own_length",
        lambda scene, runner, **_: made(few, runner, methods=FEW),
    )
    sets = [word for each in SHORT for word in ("--set", each)]
    call = ["accuracy", "linear", "--workers", "1", "--output", str(tmp_path), *sets]
    assert main(call) == 0
    names = {"linear-accuracy.json", "linear-work-precision.png", "linear-time-to-accuracy.png"}
    assert {path.name for path in tmp_path.glob("[!.]*")} == {*names, "points"}
    shown = capsys.readouterr().out
    assert "work precision" in shown
    assert "time to accuracy" in shown
