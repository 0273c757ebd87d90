"""Labels of logarithmic axes."""

from functools import partial

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from harvester.results.panels import Panel, Series, draw_panels, is_wide, label_words


@pytest.mark.parametrize(
    ("ends", "labels"),
    [
        ((5e-3, 8e-2), ["0.005", "0.01", "0.02", "0.05"]),
        ((2e4, 9e5), ["20k", "50k", "100k", "200k", "500k"]),
    ],
)
def test_a_short_logarithmic_axis_has_a_few_labels(ends, labels):
    figure = draw_panels([Panel("x", "y", [Series(ends, (1.0, 2.0))], log_x=True)], "title")
    (axes,) = figure.axes
    axes.set_xlim(*ends)
    figure.canvas.draw()
    shown = [each.get_text() for each in axes.get_xticklabels(which="both")]
    low, high = ends
    at = axes.get_xticks()
    assert [text for text, x in zip(shown, at, strict=False) if text and low <= x <= high] == labels


def drawn(values, **panel):
    series = [Series(values, np.arange(1.0, 1.0 + len(values)))]
    figure = draw_panels([Panel("R", "y", series, log_x=is_wide(values), **panel)], "title")
    FigureCanvasAgg(figure).draw()
    (axes,) = figure.axes
    low, high = axes.get_xlim()
    texts = [each.get_text() for each in axes.get_xticklabels()]
    at = zip(texts, axes.get_xticks(), strict=True)
    return axes.get_xscale(), axes.get_xlabel(), [text for text, x in at if low <= x <= high]


@pytest.mark.parametrize(
    ("values", "unit", "scale", "label", "ticks"),
    [
        ([1e5, 2e5, 4e5, 8e5], "Ω", "log", "R [kΩ]", ["100", "200", "300", "500"]),
        ([1e4, 1e5, 1e6, 1e7], "Ω", "log", "R [kΩ]", ["10", "100", "1000", "10000"]),
        ([2e4, 4e4, 6e4, 8e4], "Ω", "linear", "R [kΩ]", ["20", "40", "60", "80"]),
        ([-1e-6, 0.0, 1e-6], "", "linear", "R", ["−1u", "0", "1u"]),
        ([-8e-3, 8e-3], "m", "linear", "R [mm]", ["−2", "0", "2"]),
    ],
)
def test_positions_have_the_prefix_of_their_unit(values, unit, scale, label, ticks):
    found = drawn(values, x_unit=unit)
    assert found[:2] == (scale, label)
    assert {*ticks} <= {*found[2]}


def test_long_words_do_not_overlap():
    words = ["sshi_parallel", "sshi_series", "resistor", "a_rather_long_name"]
    figure = draw_panels(
        [Panel("", "y", [Series(range(4), range(4))], more=partial(label_words, words=words))], ""
    )
    FigureCanvasAgg(figure).draw()
    angles = {text.get_rotation() for text in figure.axes[0].get_xticklabels()}
    assert angles == {30.0}
