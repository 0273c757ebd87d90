"""Deviations batch by batch, from which differences on common noise get their errors."""

import pytest

from harvester.base.errors import HarvesterError
from harvester.base.formatting import share_with_error
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.statistics.batch_means import standard_error
from harvester.statistics.output_side import RATIOS, estimate_output
from harvester.statistics.paired import WITH_DEVIATIONS, deviations, paired_difference
from harvester.statistics.run_quantities import estimate_all


def test_they_have_the_errors_of_the_estimates(pool):
    """Of a bridge with its output, every ratio of sums: each by its own formula there."""
    changes = ["load.netlist=bridge", "run.realizations=4", "run.duration=6", "run.settle=1"]
    scene = Scene.read("device", changes)
    moments = simulate(scene, method="circuit", runner=pool).moments
    estimates = estimate_all(moments, prepared(scene).system) | estimate_output(moments)
    compared = 0
    for name in ("mean_power", "power_conversion_efficiency", *RATIOS):
        assert name in WITH_DEVIATIONS
        series = deviations(moments, name)
        assert series.mean() == pytest.approx(0.0, abs=1e-9 * abs(series).max())
        error = estimates[name].standard_error
        if error is not None:
            assert standard_error(series) == pytest.approx(error, rel=1e-6)
            compared += 1
    assert compared >= 4
    assert "output_ripple" not in WITH_DEVIATIONS


def test_equal_counts_of_events_claim_no_certainty(pool):
    """Circuit and Monte Carlo count the same contacts on a short path; their powers differ."""
    changes = ["run.realizations=16", "run.duration=20", "run.settle=2"]
    scene = Scene.read("paper", changes)
    runs = [simulate(scene, method=m, runner=pool) for m in ("circuit", "monte-carlo")]
    differences = paired_difference(*runs)
    rate = differences["impact_rate"]
    assert runs[0]["impact_rate"].estimate > 0.0
    assert (rate.estimate, rate.standard_error) == (pytest.approx(0.0, abs=1e-12), None)
    assert share_with_error(rate) == "0 % (no error bar)"
    assert "count the same events" in rate.note
    assert differences["mean_power"].standard_error > 0.0


def test_runs_on_different_noise_are_refused():
    scene = Scene.read("linear", ["run.duration=60", "run.settle=20", "run.realizations=2"])
    runs = [
        simulate(scene.replace({key: value}), method="monte-carlo")
        for key, value in (("run.seed", 1), ("run.duration", 30.0), ("run.realizations", 3))
    ]
    for other, key in zip(runs[1:], ("duration", "realizations"), strict=True):
        with pytest.raises(HarvesterError, match=rf"run\.{key} = .* not on the same noise"):
            paired_difference(runs[0], other)
