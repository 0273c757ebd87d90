"""What follows from a result's view: values, files, notebooks."""

import importlib
import inspect
import pkgutil
from dataclasses import dataclass

import numpy as np
import pytest

import harvester
from harvester.base.arguments import Named
from harvester.base.formatting import (
    NOT_KNOWN,
    Printed,
    quantity,
    share_with_error,
    span,
    with_error,
)
from harvester.results.view import LONGEST_REPR, Picture, ResultBase, View
from harvester.statistics.estimate import Estimate

# What a result class leaves to its base.
DERIVED = (
    "table", "sentences", "headline", "figure", "data", "to_csv", "to_dataframe",
    "to_xarray", "__repr__", "_repr_html_",
)  # fmt: skip


def result_classes():
    for module in pkgutil.walk_packages(harvester.__path__, "harvester."):
        if "numba" not in module.name and "__main__" not in module.name:
            importlib.import_module(module.name)
    classes, waiting = [], [ResultBase]
    while waiting:
        waiting += (subclasses := waiting.pop().__subclasses__())
        classes += [kind for kind in subclasses if kind.__module__.startswith("harvester.")]
    return classes


def test_no_result_prints_draws_or_writes_itself():
    classes = result_classes()
    assert len(classes) >= 13
    overridden = {
        f"{kind.__name__}.{name}" for kind in classes for name in DERIVED if name in vars(kind)
    }
    assert not overridden
    for kind in (kind for kind in classes if not kind.__name__.startswith("_")):
        assert hasattr(kind, "scene") or "scene" in kind.__dataclass_fields__, kind
        assert not inspect.isabstract(kind), kind


@dataclass(frozen=True, repr=False)
class Example(ResultBase):
    """A result with one of each kind of cell."""

    scene = None
    power: float = 2.0744e-3

    def view(self):
        estimate = Estimate(self.power, 5.9e-5, 40.0, "power")
        share = Estimate(0.1281, 0.0012, 40.0, "1")
        rows = [
            ["circuit", with_error(estimate, "W"), quantity(1e4, "Ω"), share_with_error(share)],
            [
                "theory",
                with_error(Estimate(2e-3, None, None, "power"), "W"),
                quantity(2e4, "Ω"),
                "",
            ],
        ]
        return View(
            table=(["method", "mean power", "resistance", "efficiency"], rows),
            findings=["the first finding " * 20],
            pictures=[Picture(lambda content: None, self)],
        )


def test_a_result_answers_by_the_names_of_its_table():
    example = Example()
    assert list(example) == ["mean_power", "resistance", "efficiency"]
    power = example["mean_power"]["circuit"]
    assert (power.estimate, power.standard_error, power.effective_sample_size) == (
        2.0744e-3,
        5.9e-5,
        40.0,
    )
    assert repr(power) == "2.074 ± 0.059 mW"
    assert example["mean power"]["theory"].standard_error is None
    assert example["resistance"] == {"circuit": 1e4, "theory": 2e4}
    with pytest.raises(
        harvester.UnknownQuantity, match=r"did you mean mean_power.*; there are mean"
    ):
        example["power"]
    with pytest.raises(harvester.UnknownQuantity, match="with rows by method: no circuit"):
        example["circuit"]
    rows = Named("mean power: no", {("circuit", 0.3): 1.0, ("theory", 0.3): 2.0}, 'result["x"]')
    with pytest.raises(harvester.UnknownQuantity) as caught:
        rows["circuit"]
    assert str(caught.value) == (
        "mean power: no circuit: write result[\"x\"]['circuit', 0.3] or "
        "result[\"x\"]['theory', 0.3] (2 rows)"
    )
    with pytest.raises(AttributeError, match=r'Example has no .*: write result\["mean_power"\]'):
        assert example.mean_power
    with pytest.raises(
        harvester.UnknownQuantity, match=r"mean power: no circut .did you mean circuit"
    ):
        example["mean_power"]["circut"]
    with pytest.raises(harvester.UnknownQuantity, match="no table density; there are shown, data"):
        example.to_dataframe("density")


def test_a_table_for_people_has_the_values_with_their_errors_and_units():
    header, rows = Example().data()
    assert header == [
        "method", "mean power [W]", "mean power standard error [W]", "resistance [Ω]", "efficiency",
        "efficiency standard error",
    ]  # fmt: skip
    assert rows[0] == ["circuit", 2.0744e-3, 5.9e-5, 1e4, 0.1281, 0.0012]
    assert rows[1][:4] == ["theory", 2e-3, None, 2e4]


def test_a_frame_has_numbers_in_a_row_for_each_row_of_the_table():
    pandas = pytest.importorskip("pandas")

    @dataclass(frozen=True, repr=False)
    class Places(ResultBase):
        scene = None

        def view(self):
            header = ["key", "unit", "place ± standard error", "range", "exponent"]
            rows = [
                ["a", "kΩ", Printed("1 ± 0", 1e3, 1.0, "Ω"), span(1e3, 2e3, "Ω"), NOT_KNOWN],
                ["b", "µs", Printed("2", 2e-6, None, "s"), NOT_KNOWN, NOT_KNOWN],
            ]
            return View((header, rows), [], records=lambda: (["start"], [[1.0]] * 9))

    frame = Places().to_dataframe()
    assert len(frame) == 2
    assert [*frame.columns] == [
        "key", "unit", "place", "place standard error", "range, low [Ω]", "range, high [Ω]",
        "exponent",
    ]  # fmt: skip
    assert [*frame["unit"]] == ["Ω", "s"]
    assert all(pandas.api.types.is_numeric_dtype(frame[name]) for name in frame.columns[2:])
    # The CSV has all records.
    assert len(Places().data().rows) == 9


def test_a_csv_has_an_empty_cell_for_what_is_not_known(tmp_path):
    Example().to_csv(tmp_path / "table.csv")
    lines = (tmp_path / "table.csv").read_text().splitlines()
    assert lines[2] == "theory,0.002,,20000,,"


def test_a_dataset_has_the_units():
    pytest.importorskip("xarray")
    dataset = Example().to_xarray()
    assert dataset["mean power"].attrs["unit"] == "W"
    assert np.isnan(dataset["mean power standard error"].values[1])


def test_a_notebook_shows_a_short_name_and_a_page():
    assert len(repr(Example())) <= LONGEST_REPR
    assert "Example" in repr(Example())
    html = Example()._repr_html_()
    assert "2.074 ± 0.059 mW" in html


def test_a_figure_shows_itself_in_a_notebook():
    figure = harvester.average("linear", method="consistent").figure()
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_the_density_of_a_spectrum_is_a_table_of_numbers():
    """Its integral is the mean square."""
    spectrum = harvester.spectrum("linear", duration=100.0)
    frequency, density = np.array(spectrum.data().rows).T
    assert density.sum() * frequency[0] == pytest.approx(spectrum.rms**2)
