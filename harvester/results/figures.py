"""Figures, drawn with matplotlib when asked for."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harvester.base.figure_settings import figure_settings
from harvester.base.writing import whole_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure


STYLE = Path(__file__).parent / "house.mplstyle"


def save(draw: Callable, result: Any, path: str | Path) -> None:
    """Call `draw` on a result and write the figure, whole; the suffix chooses the format.

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
