"""Results as objects to work with: by name, as plain values and back, as xarray, in one line."""

import copy
import json
import math
import pickle
import re
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure

import harvester
from harvester.results.result import Result
from harvester.scene.prepared import prepared
from harvester.statistics.estimate import Estimate

SHORT = ["run.duration=2000", "run.realizations=8"]


@pytest.fixture(scope="module")
def result(pool):
    scene = harvester.Scene.read("paper_si", SHORT)
    return harvester.simulate(scene, method="monte-carlo", runner=pool)


def test_a_quantity_is_found_by_its_name(result):
    assert result["mean_power"] == result.quantities["mean_power"]
    assert [name for name in result if name in result.quantities] == list(result.quantities)
    assert "mean_power" in result
    assert "power" not in result
    scaled = result.scaled_quantities["mean_power"].estimate
    assert result["mean_power"].estimate == scaled * prepared(result.scene).scales.power


def test_what_the_table_shows_can_be_asked_for(result):
    square, root = result["mean_square_displacement"], result["rms_displacement"]
    assert root.estimate == pytest.approx(math.sqrt(square.estimate), rel=1e-12)
    relative = square.standard_error / square.estimate
    assert root.standard_error / root.estimate == pytest.approx(0.5 * relative, rel=1e-12)
    assert root == result["rms displacement"]
    assert root.unit == "m"
    shown = [row[0].replace(" (harvested)", "").replace(" ", "_") for row in result.table().rows]
    assert list(result) == shown
    assert all(np.isfinite(float(result[name])) for name in ("rms_velocity", "rms_voltage"))


def test_an_estimate_is_scaled_and_printed_and_nothing_else(result):
    power = result["mean_power"]
    milli = 1e3 * power
    assert (float(milli), milli.standard_error) == (
        1e3 * power.estimate,
        1e3 * power.standard_error,
    )
    assert power / 2.0 == power * 0.5
    assert (power.unit, milli.unit, (power / 2.0).unit) == ("W", "", "")
    assert str(1e6 * Estimate(2.9e-4, 1.1e-5, None, "power", "", "W")) == "290 ± 11"
    assert (-2.0 * power).standard_error == 2.0 * power.standard_error
    assert np.float64(1e3) * power == (np.array([1e3]) * power)[0] == milli
    assert f"{power:.3g}" == f"{power.estimate:.3g}"
    assert f"{power}" == repr(power)
    assert (f"{power:>40}", f"{power:_<40s}") == (str(power).rjust(40), str(power).ljust(40, "_"))
    for refused in (
        lambda: power - power,
        lambda: power / power,
        lambda: power > 0.0,
        lambda: power * "2",
        lambda: power + "2",
        lambda: round(power, 3),
        lambda: abs(power),
        lambda: np.sqrt(power),
        lambda: np.float64(1.0) / power,
        lambda: f"{power:d}",
    ):
        with pytest.raises(harvester.HarvesterError, match=r"float\(…\).*standard_error"):
            refused()


def test_a_number_shifts_an_estimate_and_lists_of_them_are_drawn(result):
    """A constant leaves the error unchanged; numpy and matplotlib take the values."""
    power = result["mean_power"]
    for shifted in (power + 1e-3, 1e-3 + power, power - -1e-3, np.float64(1e-3) + power):
        assert shifted.estimate == pytest.approx(float(power) + 1e-3)
        assert (shifted.standard_error, shifted.unit) == (power.standard_error, "W")
    assert (1e-3 - power).estimate == (-(power - 1e-3)).estimate
    powers = [power, power + 1e-3]
    values = np.asarray(powers)
    assert values.tolist() == [float(each) for each in powers]
    axes = Figure().subplots()
    (line,) = axes.plot([1, 2], powers)
    axes.errorbar([1, 2], powers, [each.standard_error for each in powers])
    assert np.array_equal(np.asarray(line.get_ydata(), float), values)


def test_densities_are_a_frame_in_the_scenes_units(result):
    pytest.importorskip("pandas")
    frame = result.to_dataframe("densities")
    assert [*frame.columns[:4]] == ["method", "quantity", "centre", "density"]
    for name in result.densities:
        part = frame[frame["quantity"] == name]
        area = np.trapezoid(part["density"], part["centre"])
        assert area == pytest.approx(1.0, abs=0.01)
        empty = result.densities[name].density == 0.0
        assert part["standard_error"].dtype == float
        assert np.array_equal(np.isnan(part["standard_error"]), empty)
    width = np.ptp(frame[frame["quantity"] == "displacement"]["centre"])
    assert width == pytest.approx(
        np.ptp(result.densities["displacement"].centre) * result.scales.displacement
    )
    with pytest.raises(harvester.UnknownQuantity, match="no density of x; there are displacement"):
        result.densities["x"]


def test_a_style_that_there_is_not_leads_to_the_one_that_is(result):
    with pytest.raises(harvester.UnknownOption, match=r"no option color .did you mean colour"):
        result.draw_density(None, "displacement", color="red")


def test_one_file_holds_what_its_ending_says(result, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "home").mkdir()
    assert harvester.save(result, "one.json") == ["one.json"]
    assert harvester.save(result, "~/one.JSON") == ["one.JSON"]
    for file in (tmp_path / "one.json", tmp_path / "home/one.JSON"):
        assert json.loads(file.read_text())["engine"] == "monte-carlo"
    for target in ("one.xlsx", "r.h5", "out.v1", ".csv", "", "  ", "..", "new/.csv"):
        with pytest.raises(harvester.HarvesterError, match=r"give a file that ends in \.json"):
            harvester.save(result, target)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["home", "one.json"]


def test_a_scene_is_saved_as_toml(tmp_path):
    scene = harvester.Scene.read("device", {"load.resistance": 2e5})
    assert harvester.save(scene, tmp_path / "mine.toml") == ["mine.toml"]
    assert harvester.Scene.read(tmp_path / "mine.toml").digest() == scene.digest()
    with pytest.raises(harvester.HarvesterError, match=r"a scene's file ends in \.toml"):
        harvester.save(scene, tmp_path / "mine.json")


def test_a_wrong_name_says_which_is_near(result):
    with pytest.raises(harvester.UnknownQuantity, match="did you mean mean_power") as raised:
        result["meanpower"]
    assert isinstance(raised.value, KeyError)
    assert not str(raised.value).startswith("'")


def test_attributes_that_there_are_not_lead_to_those_that_are(result):
    with pytest.raises(AttributeError, match=r'result\["mean_power"\]'):
        assert result.mean_power
    for name in ("plot", "save", "to_json", "power", "items"):
        with pytest.raises(AttributeError, match=r"has mean_square_voltage.*figure\(\).*save\("):
            getattr(result, name)
    for name in ("error", "se", "units", "ci"):
        with pytest.raises(AttributeError, match="there are estimate, standard_error"):
            getattr(result["mean_power"], name)
    with pytest.raises(AttributeError, match="did you mean voltage"):
        assert result.waveform.voltag
    assert copy.deepcopy(result["mean_power"]) == result["mean_power"]


def test_python_and_json_look_names_up_without_a_hint(result, monkeypatch):
    for module in ("base.arguments", "device.keys", "results.view"):
        monkeypatch.setattr(f"harvester.{module}.nearest", None)
    result.to_dict()
    for item in (result["mean_power"], result.scene):
        assert copy.deepcopy(item) == pickle.loads(pickle.dumps(item)) == item


def test_names_of_densities_and_figures_lead_to_them(result):
    for name in ("displacement", "density"):
        with pytest.raises(harvester.UnknownQuantity, match=r'to_dataframe\("densities"\)'):
            result[name]
    with pytest.raises(harvester.UnknownQuantity, match=r"figure\(\), without a name.*joint"):
        result.figure("displacement")
    without = Result.from_dict(result.to_dict())
    with pytest.raises(harvester.UnknownQuantity, match=r"JSON contains none: run the scene again"):
        without.draw_density(None, "displacement")


def test_plain_values_lead_back_to_the_result(result):
    content = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    again = Result.from_dict(content)
    assert again.to_dict() == result.to_dict()
    assert again.quantities == result.quantities
    assert again.scene == result.scene
    with pytest.raises(harvester.UnknownQuantity, match="JSON does not contain: run the scene"):
        again.figure()
    with pytest.raises(harvester.UnknownQuantity, match="joint_density=True"):
        again.figure("joint")
    with pytest.raises(harvester.UnknownQuantity, match="no densities, which JSON does not"):
        again.to_dataframe("densities")


def test_a_results_json_is_read_and_that_of_a_study_refused(result, tmp_path, pool):
    harvester.save(result, tmp_path / "result.json")
    assert Result.read(tmp_path / "result.json").quantities == result.quantities
    study = harvester.sweep(
        "linear", {"load.decay_rate": [0.1]}, methods=["spectral"], executor=pool
    )
    harvester.save(study, tmp_path / "study.json")
    with pytest.raises(harvester.HarvesterError, match=r"study\.json: .*\.csv.* pickle$"):
        Result.read(tmp_path / "study.json")
    assert pickle.loads(pickle.dumps(study)).table() == study.table()
    (tmp_path / "text.json").write_text("{")
    with pytest.raises(harvester.HarvesterError, match=r"text\.json: not a JSON file; give one"):
        Result.read(tmp_path / "text.json")
    with pytest.raises(AttributeError, match=r"Result\.read reads"):
        assert harvester.load


def test_what_is_not_finite_comes_back_as_missing():
    scene = harvester.Scene.read("paper")
    bare = Estimate(math.nan, None, None, "power", "too short")
    plain = {"error_kind": "numerical", "energy_balance_residual": None, "wall_seconds": math.nan}
    plain |= {"engine_seconds": 0.0, "simulated_time": 0.0, "steps": 0, "step": None}
    plain |= {"realizations": 0, "engine_version": "", "netlist_sha256": None}
    plain |= {"failures": {3: "SimulatorCrashed: killed"}, "outcome": "incomplete"}
    made = Result(scene, "none", {"mean_power": bare}, prepared(scene).scales, **plain)
    again = Result.from_dict(json.loads(json.dumps(made.to_dict(), allow_nan=False)))
    assert math.isnan(again["mean_power"].estimate)
    assert again["mean_power"].note == "too short"
    assert again.failures == made.failures
    assert again.to_dict() == made.to_dict()


def test_a_record_that_has_changed_since_is_named(tmp_path):
    noise = np.random.default_rng(1).standard_normal(4000)

    def write(scale):
        times = 0.05 * np.arange(noise.size)
        np.savetxt(tmp_path / "record.csv", np.stack([times, scale * noise], 1), delimiter=",")

    write(1.0)
    record = {"kind": "record", "file": str(tmp_path / "record.csv"), "unit": "scaled"}
    record |= {"column": 1, "time_column": 0}
    tables = harvester.Scene.read("paper").to_tables()
    run = {"duration": 150.0, "settle": 10.0, "seed": 1, "realizations": 1}
    scene = harvester.Scene.from_tables(tables | {"excitation": record, "run": run})
    result = harvester.average(scene, method="consistent", fit=True)
    content = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert Result.from_dict(content).to_dict() == result.to_dict()
    write(2.0)
    with pytest.raises(harvester.SceneError, match="has changed since"):
        Result.from_dict(content)


@pytest.mark.parametrize("content", [{}, {"scene": 1}, None, {"engine": "circuit"}])
def test_what_is_no_result_is_refused(content):
    with pytest.raises(harvester.HarvesterError, match="not a result"):
        Result.from_dict(content)


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("engine",), 3),
        (("steps",), "many"),
        (("steps",), -1),
        (("realizations",), True),
        (("notes",), "one note"),
        (("failures",), {"first": "reason"}),
        (("netlist_sha256",), 1),
        (("simulated_time",), None),
        (("scales", "power"), 0.0),
        (("scales",), {"power": 1.0, "force": 1.0}),
        (("scales", "voltage"), None),
        (("scaled_quantities",), []),
        (("scaled_quantities", "mean_power", "estimate"), "0.1"),
        (("scaled_quantities", "mean_power", "standard_error"), [0.1]),
        (("scaled_quantities", "mean_power", "dimension"), "furlong"),
        (("scaled_quantities", "mean_power", "dimension"), "voltage^two"),
        (("scaled_quantities", "mean_power"), None),
        (("scaled_quantities", "mean_power", "estimate"), math.nan),
        (("scaled_quantities", "mean_power", "estimate"), 1e-3),
        (("scaled_quantities", "mean_power", "standard_error"), -1e-9),
        (("scaled_quantities", "mean_power", "standard_error"), math.inf),
        (("scaled_quantities", "mean_power", "effective_sample_size"), -1.0),
        (("quantities", "mean_power", "estimate"), 1e-3),
        (("quantities", "mean_power", "unit"), "mW"),
        (("quantities",), {}),
        (("seed",), 12345),
        (("scales", "power"), 2.0),
        (("wall_seconds",), math.nan),
        (("step",), -1.0),
        (("step_error",), -0.1),
        (("error_kind",), "guess"),
    ],
)
def test_a_damaged_result_is_refused_by_the_value(result, place, value):
    content = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert Result.from_dict(content).to_dict() == result.to_dict()
    part = content
    for name in place[:-1]:
        part = part[name]
    part[place[-1]] = value
    with pytest.raises(harvester.HarvesterError, match=r"not a result: .*of Result.to_dict"):
        Result.from_dict(content)


def test_xarray_holds_every_quantity_and_density_with_its_unit(result):
    pytest.importorskip("xarray")
    data = result.to_xarray()
    assert data["mean_power"].item() == result["mean_power"].estimate
    assert data["mean_power_standard_error"].item() == result["mean_power"].standard_error
    assert data["mean_power"].attrs["unit"] == "W"
    # Mirrored about x = 0, so that the bins hold the whole probability.
    total = float(data["displacement_density"].sum() * np.diff(data["displacement"])[0])
    assert total == pytest.approx(1.0, rel=1e-9)
    assert data["displacement_density"].attrs["unit"] == "1/m"


def test_the_frame_of_densities_has_the_units_of_both_columns(result):
    frame = result.to_dataframe("densities").set_index("quantity")
    units = frame.groupby(level=0)[["unit_of_centre", "unit_of_density"]].first()
    assert units.loc["velocity"].to_list() == ["m/s", "1/(m/s)"]
    assert units.loc["displacement"].to_list() == ["m", "1/m"]


def test_frames_of_an_engine_and_of_averaging_have_the_same_columns(result):
    frame = harvester.average("linear", method="spectral").to_dataframe()
    assert set(frame) < set(result.to_dataframe())


def test_without_xarray_the_extra_is_named(result, monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(harvester.MissingLibrary, match=r"harvester\[study\]"):
        result.to_xarray()


def test_a_result_is_one_line(result):
    assert "\n" not in repr(result)
    assert len(repr(result)) <= 150
    assert repr(result).startswith("<Result of paper_si: ")


def test_a_notebook_shows_every_quantity(result):
    text = result._repr_html_()
    assert text.count("<tr>") == 1 + len(result.quantities)
    assert list(result.quantities) == list(result)
    assert "rms_displacement" not in result.to_dict()["quantities"]
    assert re.search("<td>mean power</td><td>[µnp]W</td>", text)


def test_a_figure_is_in_the_project_style_whatever_is_set(result):
    import matplotlib as mpl

    with mpl.rc_context({"axes.facecolor": "red"}):
        figure = result.figure()
        assert mpl.rcParams["axes.facecolor"] == "red"
    assert len(figure.axes) == len(result.densities)
    assert {axes.get_facecolor()[:3] for axes in figure.axes} != {(1.0, 0.0, 0.0)}
