"""Series of a panel: what is told apart, measured in the drawing itself."""

from functools import partial

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from harvester.results import figures
from harvester.results.panels import Panel, Series, draw_panels

X, Y = (1.0, 2.0, 3.0), (1.0, 2.0, 3.0)


def drawn(*series, **panel):
    figure = draw_panels([Panel("x", "y", series, **panel)], "title")
    FigureCanvasAgg(figure).draw()
    return figure, figure.axes[0]


def test_a_point_without_an_error_bar_shows_its_hollow_mark():
    hollow = [False, True, False]
    series = Series(X, Y, "a", "C0", "", "o", bars=[0.1, 0.0, 0.1], hollow=hollow, size=20.0)
    figure, axes = drawn(series)
    image = np.asarray(figure.canvas.buffer_rgba())
    across, up = axes.transData.transform(np.column_stack([X, Y])).T
    # A little beside the middle, through which the bar runs.
    centres = image[(image.shape[0] - up).astype(int) + 4, across.astype(int) + 4, :3]
    assert [bool(np.all(pixel == 255)) for pixel in centres] == hollow


@pytest.mark.parametrize("names", [["a", "b"], ["a rather long name of a load", *"abcd"]])
def test_a_legend_is_no_wider_than_its_figure(names):
    figure, _ = drawn(*(Series(X, Y, f"{name}{k}") for k, name in enumerate(names)))
    (legend,) = figure.legends
    extent = legend.get_window_extent()
    assert extent.x0 >= 0.0
    assert extent.x1 <= figure.bbox.width


def test_a_title_is_no_wider_than_its_figure_and_above_its_panels():
    words = f"{'some words ' * 20}\n{'others ' * 30}"
    figure = figures.drawn(partial(draw_panels, title=words), [Panel("x", "y", [Series(X, Y)])])
    figures.image(figure)
    (axes,) = figure.axes
    title = figure.texts[0].get_window_extent()
    assert title.x1 <= figure.bbox.width
    assert axes.get_tightbbox().y1 <= title.y0


@pytest.mark.parametrize("log_x", [False, True])
def test_marks_at_one_place_stand_side_by_side_and_the_axis_holds_both(log_x):
    places = np.array([1.0, 2.0, 300.0])
    bars = [0.1] * 3
    series = [
        Series(places, Y, name, marker=marker, bars=bars, shift=shift)
        for name, marker, shift in (("left", "o", -3.0), ("right", "s", 3.0))
    ]
    figure, axes = drawn(*series, log_x=log_x)
    left, right = (
        line.get_transform().transform(line.get_xydata())
        for line in axes.lines
        if line.get_marker() in "os"
    )
    assert right - left == pytest.approx(np.tile([6.0 * figure.dpi / 72.0, 0.0], (3, 1)))
    low, high = axes.get_xlim()
    assert low < 1.0
    assert 300.0 < high < 3000.0
