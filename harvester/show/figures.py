"""Figures, drawn with matplotlib when asked for."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harvester.files.writing import whole_file
from harvester.former_names import handed_on
from harvester.show.figure_settings import figure_settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure


STYLE = Path(__file__).parent / "house.mplstyle"


def save(draw: Callable, result: Any, path: str | Path) -> None:
    """Draw a result into a file, whole; the suffix chooses the format.

    Parameters
    ----------
    draw : callable
        `draw_result`, `draw_comparison` or `draw_work_precision`.
    result : Result, Comparison or WorkPrecision
    path : Path

    Raises
    ------
    OutputError
    """
    with whole_file(path) as file:
        _render(draw, result, file, format=Path(path).suffix[1:])


def picture(draw: Callable, result: Any, format: str = "svg") -> bytes:
    """Draw a result into bytes; see `save`."""
    file = io.BytesIO()
    _render(draw, result, file, format=format)
    return file.getvalue()


def drawn(draw: Callable, result: Any) -> Any:
    """Call `draw` on a result with the project's style, independent of matplotlib's settings."""
    with figure_settings(STYLE):
        return draw(result)


def write(figure: Figure, path: str | Path) -> None:
    """Write a figure into a file, whole; the suffix chooses the format.

    Raises
    ------
    OutputError
    """
    with whole_file(path) as file, figure_settings(STYLE):
        _print(figure, file, format=Path(path).suffix[1:])


def _render(draw, result, target, **options):
    with figure_settings(STYLE):
        _print(draw(result), target, **options)


def _print(figure, target, **options):
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure)
    figure.savefig(target, **options)


# Names that stood here before, with their present place.
_FORMER = {
    **dict.fromkeys(
        ("draw_result", "draw_density", "frame", "axis_label"), "harvester.results.drawing"
    ),
    "draw_comparison": "harvester.studies.comparison.drawing",
    "draw_work_precision": "harvester.verification.accuracy.drawing",
}


def __getattr__(name: str) -> Any:
    if name not in _FORMER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return handed_on(__name__, _FORMER[name], name)
