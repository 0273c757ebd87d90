"""Densities as letters: heights against areas, and where they are shown."""

import io
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

import harvester
from harvester.cli import console
from harvester.results import terminal
from harvester.statistics.estimate import Density


def result_with(centre, density):
    """What the sketch takes of a result, in millimetres."""
    return SimpleNamespace(
        densities={"displacement": Density(centre, density, None, "displacement")},
        scales=SimpleNamespace(of=lambda dimension: 1e3),
        unit=lambda dimension: "mm",
    )


@pytest.fixture(scope="module")
def average():
    return harvester.average("linear", method="consistent")


@pytest.mark.parametrize("points", [23, 400])
def test_heights_are_the_areas_above_each_letter(points):
    centre = np.linspace(-5.0, 5.0, points)
    line, axis = terminal.density_sketch({"exact": result_with(centre, norm.pdf(centre))})
    shown = centre[norm.pdf(centre) >= terminal.VISIBLE_SHARE * norm.pdf(centre).max()]
    edges = np.linspace(shown[0], shown[-1], terminal.LETTERS + 1)
    areas = np.diff(norm.cdf(edges))
    heights = [terminal.HEIGHTS.index(letter) for letter in line[-terminal.LETTERS :]]
    # Half a letter for rounding, and what straight lines between few points leave out.
    assert np.abs(heights - 8.0 * areas / areas.max()).max() < (0.51 if points > 100 else 0.8)
    assert heights == heights[::-1]
    assert f"{1e3 * shown[0]:.3g}" in axis
    assert axis.endswith("mm")


def test_methods_share_range_and_height():
    centre = np.linspace(-5.0, 5.0, 400)
    lines = terminal.density_sketch(
        {
            "narrow": result_with(centre, norm.pdf(centre)),
            "wide one": result_with(centre, norm.pdf(centre, scale=2.0)),
        }
    )
    assert len({len(line) for line in lines}) == 1
    assert "█" in lines[0]
    assert max(terminal.HEIGHTS.index(letter) for letter in lines[1][-terminal.LETTERS :]) == 4


def test_a_method_without_the_density_has_no_line():
    assert terminal.density_sketch({"none": SimpleNamespace(densities={})}) == []


class Terminal(io.TextIOWrapper):
    """A stream that says it is a terminal."""

    def isatty(self):
        return True


@pytest.mark.parametrize(
    ("kind", "encoding", "no_colour", "shown"),
    [
        (Terminal, "utf-8", False, True),
        (Terminal, "utf-8", True, False),
        (Terminal, "ascii", False, False),
        (io.TextIOWrapper, "utf-8", False, False),
    ],
)
def test_a_sketch_is_for_terminals_that_show_it(
    average, monkeypatch, kind, encoding, no_colour, shown
):
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    if no_colour:
        monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    stream = kind(io.BytesIO(), encoding=encoding, errors="replace")
    monkeypatch.setattr("sys.stdout", stream)
    console.show_view(average.view(), "power")
    stream.flush()
    text = stream.buffer.getvalue().decode(encoding)
    assert "mean power" in text
    assert ("density of displacement" in text) == shown
