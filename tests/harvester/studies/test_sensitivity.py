"""Tolerance studies whose indices, effects and yield are known."""

import json
import math

import numpy as np
import pytest
from toy_runner import ToyRunner
from truths import flat, interpolated_linear_means, oscillator_power

from harvester.base.errors import HarvesterError, SimulationError
from harvester.cli.command_line import main
from harvester.engines.opening import open_runner
from harvester.results import figures
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing
from harvester.studies.public import sensitivity
from harvester.studies.sensitivity.study import draw_distribution, draw_tornado

pytestmark = pytest.mark.usefixtures("shared_workers")

PAPER = Scene.read("paper")
LINEAR = Scene.read("linear", ["run.realizations=2", "run.duration=400", "run.settle=50"])
VARY = {"load.decay_rate": "uniform:0.5:6", "piezo.coupling": "±60%"}


def ishigami(scene):
    """Of three numbers of the scene that are varied from 0 to 2π."""
    x = (
        np.array([scene.oscillator.damping, scene.stoppers[0].gap, scene.transducer.coupling])
        - np.pi
    )
    return np.sin(x[0]) * (1.0 + 0.1 * x[2] ** 4) + 7.0 * np.sin(x[1]) ** 2


ANGLES = dict.fromkeys(
    ("oscillator.damping", "stoppers.gap", "piezo.coupling"), f"uniform:1e-9:{2.0 * math.pi}"
)
VARIANCE = 0.5 + 49.0 / 8.0 + 0.1 * math.pi**4 / 5.0 + 0.01 * math.pi**8 / 18.0
ALONE = np.array([0.5 * (1.0 + 0.1 * math.pi**4 / 5.0) ** 2, 49.0 / 8.0, 0.0])
TOGETHER = 0.01 * math.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)


def assert_within(found, truth):
    """Twice as far as the 95 % interval reaches: one false alarm in 10 000."""
    reach = [found.estimate - found.low, found.high - found.estimate]
    assert found.estimate - 2.0 * reach[0] <= truth <= found.estimate + 2.0 * reach[1]


@pytest.mark.parametrize("noise", [0.0, 3.0])
def test_ishigami_by_a_method_with_noise(noise):
    runner = ToyRunner(ishigami, noise)
    study = sensitivity(PAPER, ANGLES, rows=128, above=6.0, runner=runner)
    for each, truth in zip(study.indices.first, ALONE / VARIANCE, strict=True):
        assert_within(each, truth)
    totals = (ALONE + np.array([TOGETHER, 0.0, TOGETHER])) / VARIANCE
    for each, truth in zip(study.indices.total, totals, strict=True):
        assert_within(each, truth)
    assert_within(study.indices.variance, VARIANCE)
    assert study.indices.noise_variance == pytest.approx(0.5 * noise**2, rel=0.25, abs=1e-12)
    shares = np.random.default_rng(1).random((1_000_000, 3))
    x = 2.0 * math.pi * shares - math.pi
    truth = np.sin(x[:, 0]) * (1.0 + 0.1 * x[:, 2] ** 4) + 7.0 * np.sin(x[:, 1]) ** 2
    assert_within(study.yield_above.share, np.mean(truth > 6.0))
    for share, each in study.population.quantiles.items():
        # What the noise leaves of the distribution's shape is beyond the interval.
        assert_within(each, np.quantile(truth, share)) if not noise else None


def test_devices_of_a_row_share_noise_that_replicates_and_rows_do_not():
    runner = ToyRunner(ishigami, 1.0)
    sensitivity(PAPER, ANGLES, rows=16, runner=runner)
    _, *asked = runner.asked
    seeds = np.array([each.scene.run.seed for each in asked]).reshape(16, 5, 2)
    assert len(np.unique(seeds)) == 32
    assert np.all(seeds == seeds[:, :1])
    assert {each.scene.run.realizations for each in asked} == {PAPER.run.realizations // 2}
    assert len({each.scene.excitation.knot_spacing for each in asked}) == 1


def quadrature(power, limit):
    """First-order and total indices, variance and share above a limit, over the box of `VARY`."""
    value = LINEAR.transducer.coupling
    nodes, weights = np.polynomial.legendre.leggauss(24)
    shares, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    rates, couplings = 0.5 + 5.5 * shares, value * (0.4 + 1.2 * shares)
    grid = np.array([[power(rate, coupling) for coupling in couplings] for rate in rates])
    mean = weights @ grid @ weights
    variance = weights @ (grid - mean) ** 2 @ weights
    first = [weights @ (grid @ weights - mean) ** 2, weights @ (weights @ grid - mean) ** 2]
    fine = np.linspace(0.0, 1.0, 200, endpoint=False) + 0.5 / 200
    above = np.mean(
        [[power(0.5 + 5.5 * a, value * (0.4 + 1.2 * b)) > limit for b in fine] for a in fine]
    )
    first = np.array(first) / variance
    return first, 1.0 - first[::-1], variance, above


def closed(rate, coupling):
    return oscillator_power(flat(LINEAR)._replace(decay_rate=rate, coupling=coupling))


@pytest.fixture(scope="module")
def truth():
    limit = closed(2.0, LINEAR.transducer.coupling)
    return limit, quadrature(closed, limit)


def compare(study, truth):
    first, total, variance, above = truth
    for found, exact in ((study.indices.first, first), (study.indices.total, total)):
        for each, number in zip(found, exact, strict=True):
            assert_within(each, number)
    assert_within(study.indices.variance, variance)
    assert_within(study.yield_above.share, above)


def test_the_closed_form_s_indices_are_those_of_a_quadrature(truth):
    """Power of a linear harvester by Lyapunov's equation."""
    limit, exact = truth
    runner = ToyRunner(lambda scene: oscillator_power(flat(scene)))
    study = sensitivity(LINEAR, VARY, rows=128, above=limit, method="consistent", runner=runner)
    assert study.values.shape == (1, 128, 4)
    compare(study, exact)
    assert study.indices.total[0].high - study.indices.total[0].low < 0.5


@pytest.mark.slow
def test_simulation_comes_to_the_same(truth, pool):
    limit, exact = truth
    with open_runner(executor=pool) as runner:
        study = sensitivity(LINEAR, VARY, rows=32, above=limit, runner=runner)
    compare(study, exact)
    # Noise between knots is linear: the closed form is right to a percent here.
    spaced = interpolated_linear_means(flat(LINEAR), knot_spacing(prepared(LINEAR)))["mean_power"]
    assert spaced == pytest.approx(oscillator_power(flat(LINEAR)), rel=0.02)
    # A run this short is known to some ten percent only.
    assert study.indices.noise_variance > 0.02 * study.indices.variance.estimate


def test_failed_devices_are_left_out_and_told():
    def function(scene):
        return math.nan if scene.oscillator.damping > 6.2 else ishigami(scene)

    class Failing(ToyRunner):
        def _answer(self, request):
            if math.isnan(function(request.scene)):
                return SimulationError("it fell apart")
            return super()._answer(request)

    study = sensitivity(PAPER, ANGLES, rows=128, runner=Failing(function))
    assert 110 < study.values.shape[1] < 128
    assert "it fell apart" in study.failures[0]
    with pytest.raises(HarvesterError, match="it fell apart"):
        sensitivity(
            PAPER,
            {**ANGLES, "oscillator.damping": "uniform:5:7"},
            rows=16,
            runner=Failing(function),
        )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"quantity": "mean_powr"}, "did you mean mean_power"),
        ({"method": "spice"}, "unknown method spice"),
        ({"rows": 100}, r"rows 100: must be a power of two"),
    ],
)
def test_mistakes_are_named(options, message):
    with pytest.raises(HarvesterError, match=message):
        sensitivity(PAPER, ANGLES, runner=ToyRunner(ishigami), **options)


def test_figures_and_files_are_made():
    study = sensitivity(PAPER, ANGLES, rows=16, above=3.0, runner=ToyRunner(ishigami, 1.0))
    json.dumps(study.to_dict(), allow_nan=False)
    header, rows = study.table()
    assert {len(row) for row in rows} == {len(header)}
    assert len(study.view().texts()["-devices.csv"].splitlines()) == 1 + 16 * 5
    for draw in (draw_tornado, draw_distribution):
        assert figures.image(figures.drawn(draw, study), "png").startswith(b"\x89PNG")


@pytest.mark.slow
def test_the_command_writes_its_files(tmp_path, capsys):
    command = ["sensitivity", "linear", "--set", "run.realizations=2", "--set", "run.duration=200"]
    command += ["--set", "run.settle=20", "--rows", "16", "--vary", "load.decay_rate=±60%"]
    assert main([*command, "--workers", "2", "--output", str(tmp_path)]) == 0
    assert "total index" in capsys.readouterr().out
    name = "linear-sensitivity"
    content = json.loads((tmp_path / f"{name}.json").read_text())
    assert content["rows"] == 16
    assert len((tmp_path / f"{name}-devices.csv").read_text().splitlines()) == 1 + 16 * 3
    assert (tmp_path / f"{name}-tornado.png").exists()
    assert (tmp_path / f"{name}-distribution.png").exists()


@pytest.mark.parametrize("text", ["load.decay_rate", "load.decay_rate=", "load.decay_rate=5"])
def test_the_command_names_mistakes(text, capsys):
    assert main(["sensitivity", "linear", "--vary", text]) == 2
    assert "--vary load.decay_rate" in capsys.readouterr().err
