"""A grid of values by several methods, against the linear device's closed form."""

import csv
import math

import numpy as np
import pytest
from truths import flat, interpolated_linear_means

import harvester
from harvester.cli.command_line import main
from harvester.device import timescales
from harvester.engines.realization import quantity_names
from harvester.results.report import page_of
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing
from harvester.statistics.estimate import Estimate
from harvester.studies.sweep import Cell, Sweep

pytestmark = pytest.mark.usefixtures("shared_workers")

KEY = "load.decay_rate"
RATES = (0.5, 2.0)
METHODS = ("monte-carlo", "consistent")


@pytest.fixture(scope="module")
def swept(pool):
    scene = Scene.read("linear", ["run.realizations=2", "run.duration=500", "run.settle=50"])
    quantities = ["mean_power", "mean_square_voltage"]
    over = {"excitation.intensity": [0.05, 0.1], KEY: list(RATES)}
    return harvester.sweep(scene, over, methods=METHODS, quantities=quantities, executor=pool)


def test_every_place_is_the_closed_form_or_what_averaging_gives(swept):
    """Monte Carlo within four standard errors: false alarm in 1 of 2000 seeds."""
    for (intensity, rate), cell in swept.places():
        place = swept.scene.replace({KEY: rate, "excitation.intensity": intensity})
        found = cell.estimates["mean_power"]
        if cell.method == "consistent":
            alone = harvester.average(place, method="consistent")["mean_power"]
            assert found.estimate == pytest.approx(alone.estimate, rel=1e-12)
        else:
            truth = interpolated_linear_means(flat(place), knot_spacing(prepared(place)))[
                "mean_power"
            ]
            assert abs(found.estimate - truth) < 4.0 * found.standard_error


def test_the_noise_is_the_same_everywhere(swept):
    """Of a linear device the power is in proportion to D, path by path."""
    low, high = (swept.cells[k, 0, 0].estimates["mean_power"].estimate for k in (0, 1))
    assert high / low == pytest.approx(2.0, rel=1e-9)


def test_a_row_for_each_place_method_and_quantity(swept, tmp_path):
    swept.to_csv(tmp_path / "sweep.csv")
    rows = list(csv.DictReader((tmp_path / "sweep.csv").read_text().splitlines()))
    assert len(rows) == 2 * 2 * 2 * 2
    assert rows[0]["method"] == "monte-carlo"
    assert rows[0]["unit"] == "scaled power"
    first = swept.cells[0, 0, 0].estimates["mean_power"]
    assert float(rows[0]["estimate"]) == pytest.approx(first.estimate, rel=1e-8)
    assert float(rows[0]["standard_error"]) == pytest.approx(first.standard_error, rel=1e-8)
    header, text = swept.table()
    assert {len(row) for row in text} == {len(header)}
    assert len(swept.to_dict()["cells"]) == 8
    assert len(swept.figure().axes) == 2 * 2


def test_a_quantity_is_a_row_of_panels_with_one_scale():
    estimates = {"rms_voltage": 2.0, "mean_power": 3e-3}
    units = {"rms_voltage": "voltage", "mean_power": "power"}
    cells = np.empty((2, 3, 1), dtype=object)
    for place in np.ndindex(2, 3, 1):
        means = {
            name: Estimate(value * 10.0 ** place[0], None, None, units[name])
            for name, value in estimates.items()
        }
        cells[place] = Cell("monte-carlo", "complete", means)
    values = {"load.resistance": (3e5, 3e6), "excitation.intensity": (0.1, 0.2, 0.3)}
    found = Sweep(harvester.Scene.read("device"), values, ("monte-carlo",), tuple(estimates), cells)
    axes = found.figure().axes
    assert [panel.get_ylabel() for panel in axes] == ["rms voltage [V]", "", "mean power [mW]", ""]
    titles = ["load.resistance\n= 300 kΩ", "load.resistance\n= 3 MΩ", "", ""]
    assert [panel.get_title(loc="left") or panel.get_title() for panel in axes] == titles
    assert axes[2].get_ylim() == axes[3].get_ylim() != axes[0].get_ylim()


def test_views_have_the_same_numbers(swept):
    pytest.importorskip("xarray")
    data = swept.to_xarray()["mean_power"]
    assert data.dims == ("excitation.intensity", KEY, "method")
    table = swept.to_dataframe()
    assert np.array_equal(table["mean power [scaled power]"].to_numpy(), data.values.ravel())
    kinds = dict(zip(table["method"], table["kind of error"], strict=True))
    assert kinds == {"monte-carlo": "statistical", "consistent": "numerical"}


def test_a_precision_adds_realizations_and_closures_have_none(pool):
    scene = Scene.read("linear", ["run.duration=100", "run.settle=50"])
    found = harvester.sweep(scene, {KEY: [1.0]}, methods=METHODS, precision=0.2, executor=pool)
    simulated, averaged = found.cells[0]
    each = simulated.estimates["mean_power"]
    assert each.standard_error < 0.2 * each.estimate
    assert simulated.realizations >= 8
    assert averaged.realizations == 0


def test_every_quantity_of_a_place_can_be_asked_for(swept):
    place = ("consistent", 0.1, 2.0)
    power = swept["mean_power"][place]
    (cell,) = (c for point, c in swept.places() if (c.method, *point) == place)
    assert power.estimate == cell.estimates["mean_power"].estimate
    assert "mean_square_velocity" in list(swept)
    with pytest.raises(harvester.UnknownQuantity, match=r"write result.*consistent"):
        swept["mean_power"]["consistent"]
    with pytest.raises(harvester.UnknownQuantity, match=rf"rows by method, .*{KEY}: no {KEY}"):
        swept[KEY]


def test_roots_of_mean_squares_are_quantities(pool):
    over = {KEY: [2.0]}
    found = harvester.sweep(
        "linear", over, methods=["consistent"], quantities=["rms_displacement"], executor=pool
    )
    (square, root) = (
        found[name]["consistent", 2.0] for name in ("mean_square_displacement", "rms_displacement")
    )
    assert root.estimate == pytest.approx(math.sqrt(square.estimate), rel=1e-12)
    assert found.table().header[2] == "rms displacement"
    assert "consistent: ± is the numerical error alone" in " ".join(found.sentences())


def test_the_headline_has_the_unit_of_the_key(pool):
    over = {"load.resistance": [2.5e5]}
    found = harvester.sweep("device", over, methods=["fokker_planck"], executor=pool)
    assert "at load.resistance = 250 kΩ, by fokker_planck" in found.headline()


def test_what_fails_is_the_outcome_of_its_place(pool):
    scene = Scene.read("device").replace({"load.netlist": "bridge"})
    over = {"load.parameters.resistance": [1e5]}
    found = harvester.sweep(scene, over, methods=["consistent"], executor=pool)
    assert found.cells[0, 0].outcome.startswith("LoadError")
    header, (row,) = found.data()
    assert math.isnan(row[header.index("estimate")])


@pytest.mark.parametrize(
    ("over", "options", "words"),
    [
        ({"load.decay_rat": [1.0]}, {}, "did you mean load.decay_rate"),
        ({KEY: 1.0}, {}, "over.*must be a list"),
        ({KEY: [1.0, 1.0]}, {}, "none twice"),
        ({}, {}, "over: names no key; write over="),
        ({KEY: (0.1, 2.0, 7)}, {}, r"\[0.1, 2, 7.0\], or numpy.linspace\(0.1, 2, 7\)"),
        ({KEY: ["0.1"]}, {}, "must be a number; write 0.1 without quotes"),
        ({KEY: [1.0]}, {"methods": "circuit"}, "methods = 'circuit': must be a list"),
        ({KEY: [1.0]}, {"methods": ["spice"]}, "unknown method spice"),
        ({KEY: [1.0]}, {"methods": []}, "at least one"),
        ({KEY: [1.0]}, {"methods": ["circuit", "circuit"]}, "each once"),
        ({KEY: [1.0]}, {"methods": ["consistent"], "quantities": [""]}, "there are mean_square"),
    ],
)
def test_mistakes_are_named(over, options, words):
    with pytest.raises(harvester.HarvesterError, match=words):
        harvester.sweep("linear", over, workers=1, **options)


@pytest.mark.parametrize("method", ["monte-carlo", "consistent"])
def test_a_misspelt_quantity_is_refused_before_anything_runs(method):
    for study, arguments in (
        (harvester.sweep, {"over": {KEY: [1.0]}, "methods": [method], "quantities": ["mean_powr"]}),
        (harvester.sensitivity, {"vary": {KEY: "±10%"}, "method": method, "quantity": "mean_powr"}),
        (
            harvester.optimum,
            {"over": {KEY: (1, 2), "piezo.coupling": (1, 2)}, "maximise": "mean_powr"},
        ),
    ):
        with pytest.raises(harvester.HarvesterError, match="did you mean mean_power"):
            study("linear", **arguments, executor=RunsNothing())


class RunsNothing:
    """An executor that is not to be used."""

    def submit(self, *_):
        raise AssertionError("a run began")


@pytest.mark.parametrize("name", ["device", "asymmetric", "bridge"])
def test_all_quantities_of_a_run_are_known_before_it(name, pool):
    scene = Scene.read("linear" if name == "bridge" else name)
    scene = scene.replace({"load": {"netlist": name}} if name == "bridge" else {})
    cycle = 2.0 * math.pi / timescales.angular_frequency(prepared(scene).system)
    run = {"duration": 5 * cycle, "settle": cycle, "realizations": 2}
    scene = scene.replace(run=run)
    found = harvester.simulate(scene, method="monte-carlo", executor=pool)
    assert {*found.scaled_quantities} <= {*quantity_names(prepared(scene))}


def test_any_key_and_words_make_a_grid_on_the_command_line(tmp_path, capsys):
    """Closed form of a linear device: the density's variance goes with D, whatever the seed."""
    command = ["sweep", "linear", "--over", "excitation.intensity=0.1,200m", "--over"]
    command += ["run.seed=1,2", "--method", "consistent", "--quantity", "mean_square_voltage"]
    assert main([*command, "--output", str(tmp_path), "--report", str(tmp_path / "page.html")]) == 0
    assert "scaled voltage²" in capsys.readouterr().out
    with open(tmp_path / "linear-sweep.csv", newline="") as file:
        header, *rows = csv.reader(file)
    assert header[:5] == ["excitation.intensity", "run.seed", "method", "quantity", "estimate"]
    values = [float(row[4]) for row in rows]
    assert values[2:] == pytest.approx([2.0 * each for each in values[:2]], rel=1e-4)
    assert (tmp_path / "linear-sweep.png").exists()
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "highest mean square voltage" in page
    loads = {"load.netlist": ["resistor", "bridge"]}
    found = harvester.sweep("linear", loads, methods=["consistent"], workers=1)
    assert found.values == {"load.netlist": ("resistor", "bridge")}
    assert [cell.outcome.split(":")[0] for cell in found.cells.ravel()] == ["complete", "LoadError"]
    found.figure()
    page = page_of(found, "sweep")
    assert "<td>load.netlist</td><td>resistor, bridge</td>" in page
    for name in ("resistor.lib", "bridge.lib"):
        assert page.count(f"<summary>{name}</summary>") == page.count(f".ends {name[:-4]}\n") == 1


def test_a_swept_key_has_its_unit_in_the_header():
    found = harvester.sweep(
        "cantilever", {"load.resistance": [5e4], "oscillator.quality_factor": [50.0]},
        methods=["spectral"], workers=1,
    )  # fmt: skip
    header, (row, *_) = found.data()
    assert header[:2] == ["load.resistance [Ω]", "oscillator.quality_factor [1]"]
    assert row[:2] == [5e4, 50.0]
    assert found.table()[0][1] == "load.resistance [Ω]"


@pytest.mark.slow
def test_jump_rates_of_a_closure_are_computed_or_the_reason_is_given(pool):
    """A closure's rate is that of `average` with jump_rates=True."""
    over = {"excitation.intensity": [0.1]}
    methods = ["fokker_planck", "consistent"]
    found = harvester.sweep("paper", over, methods=methods, quantities=["jump_rate"], executor=pool)
    scene = Scene.read("paper", ["excitation.intensity=0.1"])
    expected = harvester.average(scene, jump_rates=True)["jump_rate"]
    rate = found["jump_rate"]["fokker_planck", 0.1]
    assert rate.estimate == pytest.approx(expected.estimate, rel=1e-9)
    assert "consistent computes no jump_rate" in " ".join(found.sentences())
    over = {"load.decay_rate": (0.05, 0.1)}
    options = {"method": "consistent", "maximise": "jump_rate", "evaluations": 16}
    with pytest.raises(harvester.UnknownQuantity, match="by consistent: no quantity jump_rate"):
        harvester.optimum("paper", over, executor=pool, **options)
