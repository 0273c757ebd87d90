"""Optima with a known place, and maxima that are none."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from truths import flat, interpolated_linear_means, oscillator_power

from harvester.base.errors import HarvesterError, OptimumError
from harvester.cli.command_line import main
from harvester.engines.methods import MonteCarlo
from harvester.engines.opening import open_runner
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing, step_error
from harvester.statistics.batch_means import standard_error
from harvester.statistics.estimate import Estimate
from harvester.studies.answers import missing_from
from harvester.studies.optimum import line as optimum_search
from harvester.studies.optimum.axis import Axis
from harvester.studies.optimum.line import CubicFit, Search, averaged
from harvester.studies.public import optimum

pytestmark = pytest.mark.usefixtures("shared_workers")

LINEAR = Scene.read("linear", ["run.realizations=2", "run.duration=3000"])


@pytest.fixture
def runner(pool):
    with open_runner(executor=pool) as opened:
        yield opened


def best_load(power):
    def loss(rate):
        return -power(flat(LINEAR.replace({"load.decay_rate": rate})))

    return minimize_scalar(loss, bounds=(0.5, 10.0), method="bounded", options={"xatol": 1e-9}).x


def test_simulation_finds_the_load_of_a_linear_harvester(runner):
    """Within four standard errors of the closed form: one false alarm in 16 000."""
    axis = Axis("load.decay_rate", 0.5, 10.0)
    search = Search(LINEAR, axis, "mean_power", MonteCarlo(), runner, lambda: None)
    place, fitted = search.find(None)
    closed = best_load(oscillator_power)
    exact = best_load(
        lambda p: interpolated_linear_means(p, knot_spacing(prepared(LINEAR)))["mean_power"]
    )
    assert closed == pytest.approx(exact, rel=2e-3)
    assert abs(place.estimate - exact) < 4.0 * place.standard_error
    assert place.standard_error < 0.1 * exact
    assert fitted[0][0] < place.estimate < fitted[-1][0]


@pytest.mark.slow
def test_averaging_and_simulation_together():
    found = optimum(
        LINEAR, "load.decay_rate", maximise="mean_power", closure="consistent", workers=2
    )
    closed = best_load(oscillator_power)
    exact = best_load(
        lambda p: interpolated_linear_means(p, knot_spacing(prepared(LINEAR)))["mean_power"]
    )
    assert closed == pytest.approx(exact, rel=2e-3)
    assert abs(found.place.estimate - exact) < 4.0 * found.place.standard_error
    assert found.place.standard_error < 0.05 * exact
    value = oscillator_power(flat(LINEAR.replace({"load.decay_rate": closed})))
    assert abs(found.value.estimate - value) < 4.0 * found.value.standard_error
    header, rows = found.table()
    assert {len(row) for row in rows} == {len(header)}
    told = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert len(found.figure().axes) == 1
    place, value = found.searched[0]
    bare = replace(found, searched=[(place, replace(value, standard_error=None))])
    lines = bare.figure().axes[0].lines
    white = [line for line in lines if line.get_markerfacecolor() == "white"]
    assert [list(line.get_xdata()) for line in white] == [[place["load.decay_rate"]]]
    low, high = told["simulation"]["interval"]
    assert low < told["simulation"]["place"]["estimate"] < high


def test_the_closed_form_has_its_white_noise_optimum():
    """α* = 1/√(1 + κ²)."""
    white = LINEAR.replace({"excitation.correlation_time": 1e-6, "excitation.knot_spacing": 1e-7})

    def loss(rate):
        return -oscillator_power(flat(white.replace({"load.decay_rate": rate})))

    best = minimize_scalar(loss, bounds=(0.5, 10.0), method="bounded", options={"xatol": 1e-9}).x
    p = flat(white)
    frequency, square = math.sqrt(p.linear_stiffness), p.coupling / p.linear_stiffness
    assert frequency / best == pytest.approx(1.0 / math.sqrt(1.0 + square), rel=1e-4)


@pytest.mark.parametrize("start", [None, 0.5])
def test_an_edge_is_no_optimum(runner, start):
    scene = Scene.read("linear", ["run.realizations=2", "run.duration=1000"])
    axis = Axis("excitation.intensity", 0.01, 0.04)
    with pytest.raises(OptimumError, match=r"largest at the end of the range, 0\.04"):
        Search(scene, axis, "mean_power", MonteCarlo(), runner, lambda: None).find(start)


def test_averaging_gives_a_reason_instead_of_an_edge(runner, monkeypatch):
    monkeypatch.setattr(optimum_search, "SCANNED", 3)
    scene = Scene.read("linear")
    axis = Axis("excitation.intensity", 0.01, 0.04)
    place, _, reason = averaged(scene, axis, "mean_power", "consistent", runner)
    assert place is None
    assert reason == "largest at the end of the range, excitation.intensity = 0.04"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"over": "load.decay_rat"}, "did you mean load.decay_rate"),
        ({"over": "run.duration"}, "not a number of this scene"),
        ({"over": "load.decay_rate", "low": 2.0, "high": 1.0}, "give it as LOW:HIGH"),
        ({"over": "load.decay_rate", "low": -1.0}, "must be a number > 0"),
        ({"over": "load.decay_rate", "maximise": "mean_powr"}, "did you mean mean_power"),
        ({"over": "load.decay_rate", "method": "spice"}, "unknown method spice"),
        ({"over": "load.decay_rate", "evaluations": 20}, "is for several parameters"),
        ({"over": {}}, "name at least one parameter"),
        ({"over": {"load.decay_rate": (1.0, 2.0)}, "low": 1.0}, "are for a single"),
        (
            {"over": {"load.decay_rate": None, "excitation.intensity": None}, "closure": "paper"},
            "is for one parameter",
        ),
    ],
)
def test_mistakes_are_named(options, message):
    with pytest.raises(HarvesterError, match=message):
        optimum(LINEAR, **options)


def test_what_runs_were_too_short_for_is_told_of_what_is_found_from_them(pool):
    """A storage of R·C = 30 s in runs that settle for 5 s."""
    changes = {"load.netlist": "bridge", "load.parameters.resistance": 3e6}
    scene = Scene.read("device", ["run.realizations=4", "run.duration=8"]).replace(changes)
    found = simulate(scene, method="monte-carlo", runner=pool)["output_voltage"]
    (sentence,) = missing_from("output_voltage", found)
    assert re.match(r"output voltage: no error bar: the store cstorage .* still charges", sentence)
    assert missing_from("output_voltage", Estimate(1.0, 0.1, 4, "voltage")) == []


def test_an_axis_goes_by_logarithm_where_it_is_wide():
    wide, narrow = Axis("a", 0.1, 10.0), Axis("a", 1.0, 2.0)
    assert wide.value(0.5) == pytest.approx(1.0)
    assert narrow.value(0.5) == pytest.approx(1.5)
    for axis in (wide, narrow):
        assert axis.coordinate(axis.value(0.3)) == pytest.approx(0.3)
        numeric = (axis.value(0.3 + 1e-6) - axis.value(0.3 - 1e-6)) / 2e-6
        assert axis.slope(0.3) == pytest.approx(numeric, rel=1e-6)


def test_the_fit_covers_a_known_maximum(monkeypatch):
    """Cubic with its maximum at 0.2 under noise of which most is common to all places.

    300 intervals of two standard errors: 95 % expected, 91 % is four deviations below that.
    """
    places = np.linspace(-1.0, 1.0, 7)
    t = places - 0.2
    truth = 10.0 - 2.0 * t**2 - 0.5 * t**3
    noise = np.random.default_rng(3)
    series = {}
    monkeypatch.setattr(optimum_search, "series_in_units", lambda answer, _: series[answer.name])

    class Synthetic:
        def __init__(self, name, value):
            self.name, self.value = name, value

        def in_units(self):
            return {"mean_power": Estimate(self.value, None, None, "power")}

    covered = 0
    for _ in range(300):
        batches = 3.0 * noise.normal(size=(2, 64)) + 0.3 * noise.normal(size=(7, 2, 64))
        means = batches.mean(axis=(1, 2))
        series.update({k: batches[k] - means[k] for k in range(7)})
        fit = CubicFit(
            places,
            [Synthetic(k, truth[k] + means[k]) for k in range(7)],
            "mean_power",
            standard_error,
        )
        assert fit.peaked
        covered += abs(fit.place - 0.2) < 2.0 * fit.error
    assert 0.91 * 300 < covered < 300


def searched(function, own_noise, monkeypatch, error=None):
    """A Search over 0 … 1 of a function, under noise that all places have in common and their own.

    What is their own is a hundredth of the common part, as on a path that a parameter hardly
    changes.
    """
    noise = np.random.default_rng(7)
    common = 0.05 * noise.normal(size=(2, 64))
    monkeypatch.setattr(optimum_search, "series_in_units", lambda answer, _: answer.series)

    class Synthetic:
        def __init__(self, coordinate):
            own = own_noise / math.sqrt(search._more)
            batches = common + own * noise.normal(size=common.shape)
            self.value = function(coordinate) + batches.mean()
            self.series = batches - batches.mean()

        def in_units(self):
            return {"mean_power": Estimate(self.value, error, None, "power")}

    search = Search(
        LINEAR, Axis("load.decay_rate", 0.0, 1.0), "mean_power", MonteCarlo(), None, lambda: None
    )
    monkeypatch.setattr(search, "_answers", lambda places: [Synthetic(c) for c in places])
    return search


@pytest.mark.parametrize("own_noise", [0.0, 5e-4])
@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("start", [0.5, 0.7])
def test_a_plateau_is_no_optimum(own_noise, side, start, monkeypatch):
    """Rises up to one place and stays: stoppers too far away to be touched."""

    def plateau(coordinate):
        return 10.0 - 9.0 * max(0.5 - (0.5 + side * (coordinate - 0.5)), 0.0) ** 2

    search = searched(plateau, own_noise, monkeypatch)
    with pytest.raises(OptimumError, match="mean power is flat from") as caught:
        search.find(start)
    (ends,) = re.findall(r"flat from ([\d.]+) to ([\d.]+) ", str(caught.value))
    assert all(side * (float(end) - 0.5) > 0.0 for end in ends)
    # All places are named, with what would tell them apart.
    assert str(caught.value).count(" at ") == optimum_search.PLACES
    assert "raise run.duration = 3000" in str(caught.value)


def test_differences_without_an_error_bar_are_not_flat(monkeypatch):
    search = searched(lambda place: 1.0 - (place - 0.4) ** 2, 0.0, monkeypatch)
    search._error_of = lambda series: None
    with pytest.raises(OptimumError, match="differences have no error bar") as caught:
        search.find(0.5)
    assert "flat" not in str(caught.value)


@pytest.mark.parametrize(("own_noise", "least", "most"), [(0.5, 1.0, 1.0), (1.5, 1.2, 3.9)])
def test_no_more_realizations_run_than_the_interval_takes(own_noise, least, most, monkeypatch):
    """Two standard errors of the place may be 0.15 of the half width; 0.18 take twice the runs.

    Within four standard errors of the maximum; false alarm one in 16 000.
    """
    search = searched(
        lambda coordinate: 10.0 - 20.0 * (coordinate - 0.5) ** 2, own_noise, monkeypatch
    )
    place, _ = search.find(0.5)
    assert abs(place.estimate - 0.5) < 4.0 * place.standard_error
    assert least <= search._more <= most
    assert 2.0 * place.standard_error < 0.15 * 0.25


def test_where_nothing_is_harvested_there_is_nothing_to_optimise(monkeypatch):
    """A load that never conducts: 0 ± 0.1 everywhere."""
    search = searched(lambda coordinate: 0.0, 0.05, monkeypatch, 0.1)
    with pytest.raises(OptimumError, match="is 0 within its errors at all 7 points, so it cannot"):
        search.find(0.5)
    search = searched(lambda coordinate: 9.0, 0.05, monkeypatch, 0.1)
    with pytest.raises(OptimumError, match=r"same within its errors from 0\.25 to 0\.75"):
        search.find(0.5)


@pytest.mark.parametrize("top", [0.35, 0.5])
def test_a_sharp_bend_is_fitted_closely(top, monkeypatch):
    """Parabolas of different width on both sides, which no cubic follows.

    Within four standard errors, which know of the misfit; false alarm one in 16 000.
    """

    def bent(coordinate):
        off = coordinate - top
        return 10.0 - (30.0 if off > 0.0 else 3.0) * off * off

    place, _ = searched(bent, 5e-4, monkeypatch).find(0.5)
    assert abs(place.estimate - top) < 4.0 * place.standard_error
    assert place.standard_error < 0.03


def test_averaging_refines_its_scan(monkeypatch):
    """The closed form as a closure: 24 points of it come to its maximum."""
    monkeypatch.setattr(optimum_search, "answers_in_time", lambda runner, requests: requests)
    monkeypatch.setattr(
        optimum_search, "amount", lambda request, name: oscillator_power(flat(request.scene))
    )
    axis = Axis("load.decay_rate", 0.5, 10.0)
    place, value, _ = averaged(LINEAR, axis, "mean_power", "consistent", None)
    best = best_load(oscillator_power)
    assert place == pytest.approx(best, rel=2e-3)
    assert value == pytest.approx(
        oscillator_power(flat(LINEAR.replace({"load.decay_rate": best}))), rel=1e-5
    )


def test_averaging_knows_a_plateau_too(monkeypatch):
    def rate(scene):
        return scene.to_tables()["load"]["decay_rate"]

    monkeypatch.setattr(optimum_search, "answers_in_time", lambda runner, requests: requests)
    monkeypatch.setattr(
        optimum_search, "amount", lambda request, name: min(rate(request.scene), 3.0)
    )
    axis = Axis("load.decay_rate", 0.5, 10.0)
    place, _, reason = averaged(LINEAR, axis, "mean_power", "consistent", None)
    assert place is None
    assert reason.startswith("flat above load.decay_rate = 3.")


@pytest.mark.slow
def test_the_command_prints_the_interval(capsys, tmp_path):
    options = [
        "--set",
        "run.duration=5000",
        "--from",
        "0.8",
        "--to",
        "6",
        "--output",
        str(tmp_path),
    ]
    options += ["--closure", "consistent"]
    arguments = ["--over", "load.decay_rate", "--maximise", "mean_power", *options]
    assert main(["optimum", "linear", *arguments]) == 0
    assert "interval" in capsys.readouterr().out
    assert json.loads((tmp_path / "linear-optimum.json").read_text())["over"] == "load.decay_rate"


@pytest.mark.slow
def test_the_output_of_a_netlist_has_its_optimum(runner):
    """A bridge on a linear spring: most power where its resistance fits, by every place's own."""
    scene = Scene.read(
        "device",
        [
            "oscillator.linear_stiffness=126.9",
            "oscillator.cubic_stiffness=0",
            "load.netlist=bridge",
            "run.realizations=4",
            "run.duration=6",
            "run.settle=2",
        ],
    )
    found = optimum(
        scene,
        "load.parameters.resistance",
        maximise="mean_output_power",
        low=2e4,
        high=5e6,
        runner=runner,
    )
    assert found.averaging.place is None
    assert "does not compute mean output power" in " ".join(found.sentences())
    low, high = found.interval
    assert 2e4 < low < found.place.estimate < high < 5e6
    values = [estimate.estimate for _, estimate in found.searched]
    assert max(values) < 1.05 * found.value.estimate
    assert max(values[0], values[-1]) < found.value.estimate
    with pytest.raises(HarvesterError, match="unknown quantity mean_output_power"):
        optimum(LINEAR, over="load.decay_rate", maximise="mean_output_power")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frequency", "settle", "below", "share"),
    [(0.27, 600.0, 4.0, 1e-3), (0.32, 250.0, 4.0, 3e-3), (0.27, 600.0, 1.1, 2e-3)],
)
def test_the_place_without_noise_is_known_as_well_as_its_steps(
    pool, frequency, settle, below, share
):
    """Also where a transient is left, and between the end of the range and the next place."""
    sine = {"kind": "sine", "amplitude": 0.1, "frequency": frequency}
    run = {"seed": 1, "settle": settle, "duration": 200.0, "realizations": 1}
    # The scene's own load has steps that cost an eighth of those at the optimum.
    own = {"load.decay_rate": 1000.0}
    scene = Scene.read("linear").replace({"excitation": sine, "run": run, **own})
    p, s = flat(scene), 2j * math.pi * sine["frequency"]

    def power(log):
        decay = math.exp(log)
        electrical = s / (s + decay)
        x = 1.0 / (p.linear_stiffness + s**2 + s * p.damping + p.coupling * electrical)
        return decay * abs(electrical * x) ** 2

    best = minimize_scalar(lambda log: -power(log), bounds=(-3.0, 4.0), method="bounded")
    place = math.exp(best.x)
    ends = (place / below, 4.0 * place)
    found = optimum(scene, {"load.decay_rate": ends}, method="monte-carlo", executor=pool).place
    assert abs(found.estimate - place) < 2.0 * found.standard_error < share * place
    there = prepared(scene.replace({"load.decay_rate": place}))
    assert found.standard_error > 0.9 * step_error(there, engine="monte-carlo") * place


@pytest.mark.slow
def test_an_open_runner_reports_each_task_of_an_optimum(pool):
    """As the command line calls it: with a runner that has a progress."""
    shares = []
    with open_runner(executor=pool, progress=lambda share, _: shares.append(share)) as runner:
        optimum(
            LINEAR.replace({"run.duration": 300.0}),
            {"load.decay_rate": (0.1, 10.0), "piezo.coupling": (0.5, 1.0)},
            evaluations=24,
            runner=runner,
        )
    assert shares == sorted(shares)
    assert len({*shares}) > 20


def test_an_end_that_is_no_number_is_refused():
    with pytest.raises(HarvesterError, match="low '100k': must be a number; write 100000 without"):
        optimum(LINEAR, "load.decay_rate", low="100k", high=2.0, method="consistent")
