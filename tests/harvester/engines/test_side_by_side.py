"""Realizations side by side in one netlist: the same paths, and each outcome its own."""

import math

import numpy as np
import pytest

from harvester.base.errors import HarvesterError, SimulatorCrashed
from harvester.base.worker_pool import WorkerPool
from harvester.cli.command_line import main
from harvester.engines.side_by_side import copies, share_steps, together
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.statistics.paired import paired_difference

MEANS = ("mean_square_voltage", "mean_square_velocity", "mean_input_power", "mean_loss_power")


def test_the_number_of_copies_follows_from_the_scene():
    assert [copies(n, "behavioural") for n in (1, 7, 64, 99999)] == [1, 1, 8, 16]
    assert [copies(n, "compiled") for n in (1, 2, 7, 64, 256, 1600, 99999)] == [
        *(1, 1, 3, 32),
        *(32, 200, 200),
    ]


def test_what_leaves_each_realization_its_own_netlist():
    def share(*overrides, **options):
        return share_steps(prepared(Scene.read("paper", overrides)), **options)

    assert share()
    assert not share(tolerance=1e-4)
    assert not share(source="pwl")
    assert not share("load.netlist=bridge")
    # A stiff contact of one copy would shorten the steps of all.
    assert not share("stoppers.stiffness=1e5")
    assert share("stoppers=none")


@pytest.mark.slow
def test_copies_with_equal_steps_are_the_single_runs(pool):
    """Without contacts every copy takes the steps that it takes alone."""
    options = ["run.realizations=5", "run.duration=20", "run.settle=5"]
    for name in ("duffing", "paper_si"):
        scene = Scene.read(name, ["stoppers=none", *options])
        single = simulate(scene, method="circuit", copies=1, device="behavioural", runner=pool)
        batched = simulate(scene, method="circuit", copies=3, device="behavioural", runner=pool)
        for one, other in zip(single.moments, batched.moments, strict=True):
            assert one.points == other.points
            np.testing.assert_allclose(one.integrals, other.integrals, rtol=1e-6, atol=1e-9)


def test_copies_with_contacts_follow_the_same_paths_to_the_step_error(pool):
    options = ["run.realizations=6", "run.duration=30", "run.settle=0"]
    scene = Scene.read("paper", ["excitation.intensity=0.05", *options])
    single = simulate(scene, method="circuit", step="fine", copies=1, runner=pool)
    batched = simulate(scene, method="circuit", step="fine", copies=6, runner=pool)
    assert abs(batched.energy_balance_residual) < 1e-3
    for name in MEANS:
        one, other = (r.scaled_quantities[name].estimate for r in (single, batched))
        assert other == pytest.approx(one, rel=5e-3), name


def test_the_batch_is_not_biased(pool):
    """Paired with Monte Carlo; false-alarm rate 0.3 % for each of two means."""
    options = ["excitation.intensity=0.005", "run.realizations=32", "run.duration=100"]
    scene = Scene.read("paper", options)
    circuit = simulate(scene, method="circuit", copies=16, runner=pool)
    reference = simulate(scene, method="monte-carlo", step="fine", runner=pool)
    difference = paired_difference(circuit, reference)
    for name in ("mean_square_voltage", "mean_square_velocity"):
        bias = difference[name]
        assert bias.standard_error < 0.02
        assert abs(bias.estimate) < 0.01 + 3 * bias.standard_error, name


def test_whatever_the_number_of_workers(pool):
    scene = Scene.read("paper", ["run.realizations=16", "run.duration=20", "run.settle=0"])
    two = simulate(scene, method="circuit", runner=pool).to_dict()["quantities"]
    assert simulate(scene, method="circuit", workers=1).to_dict()["quantities"] == two


def test_what_failed_together_is_tried_one_by_one(pool):
    scene = Scene.read("paper", ["run.realizations=4", "run.duration=20", "run.settle=0"])

    class Failing:
        """Batches crash, and so does realization 2 alone."""

        def map(self, function, calls, *arguments):
            outcomes = pool.map(function, calls, *arguments)
            for place, call in enumerate(calls):
                if len(call["indices"]) > 1 or 2 in call["indices"]:
                    outcomes[place] = SimulatorCrashed("gone")
            return outcomes

    result = simulate(scene, method="circuit", copies=2, keep_going=True, runner=Failing())
    assert result.failures == {2: "SimulatorCrashed: gone"}
    alone = simulate(scene, method="circuit", copies=1, runner=pool)
    expected = [m.integrals for k, m in enumerate(alone.moments) if k != 2]
    for found, wanted in zip(result.moments, expected, strict=True):
        np.testing.assert_array_equal(found.integrals, wanted)


@pytest.mark.parametrize("crashes", ["together", "alone too"])
def test_the_first_realization_has_the_waveform_alone_too(pool, tmp_path, crashes, capsys):
    scene = ["run.realizations=4", "run.duration=20", "run.settle=0"]
    whole = simulate(Scene.read("paper", scene), method="circuit", copies=1, runner=pool).waveform
    several = WorkerPool.map

    def failed(pool, function, calls, *arguments):
        outcomes = several(pool, function, calls, *arguments)
        for place, call in enumerate(calls):
            if call["indices"] == [0, 1] or (call["indices"] == [0] and crashes == "alone too"):
                outcomes[place] = SimulatorCrashed("gone")
        return outcomes

    words = ["simulate", "paper", "--copies", "2", "--keep-going"]
    words += ["--waveform", str(tmp_path / "first.csv")]
    words += [word for each in scene for word in ("--set", each)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(WorkerPool, "map", failed)
        patch.setattr(WorkerPool, "__enter__", lambda unused: pool)
        code = main(words)
    assert code == (0 if crashes == "together" else 1)
    if crashes == "alone too":
        assert "first.csv: not written, as the first realization failed" in capsys.readouterr().err
        return
    table = np.genfromtxt(tmp_path / "first.csv", delimiter=",", comments="#", names=True)
    np.testing.assert_allclose(table[table.dtype.names[1]], whole.displacement, rtol=1e-5)


@pytest.mark.parametrize("bad", [0, -1, 1.5])
def test_a_number_of_copies_that_is_none_is_refused(bad):
    with pytest.raises(HarvesterError, match="whole number"):
        simulate(Scene.read("paper"), method="circuit", copies=bad)
    with pytest.raises(HarvesterError, match="only the circuit"):
        simulate(Scene.read("paper"), method="monte-carlo", copies=2)


@pytest.mark.parametrize(
    ("realizations", "workers", "expected"),
    [(64, 2, 32), (64, 1, 64), (160, 2, 40), (4, 2, 2), (1, 4, 1), (64, math.inf, 8)],
)
def test_monte_carlo_keeps_every_worker_busy(realizations, workers, expected):
    assert together(realizations, workers) == expected
