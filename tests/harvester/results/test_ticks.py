"""Labels of logarithmic axes."""

import pytest

from harvester.results.panels import Panel, Series, draw_panels


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
