"""Draw figures with matplotlib and write them to files."""

from __future__ import annotations

import io
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harvester.base.figure_settings import figure_settings
from harvester.base.writing import whole_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure


STYLE = Path(__file__).parent / "house.mplstyle"


def drawn(draw: Callable, result: Any) -> Any:
    """Call `draw` on a result with the project's style, independent of matplotlib's settings.

    Notebooks show the figure without `%matplotlib inline`.
    """
    with figure_settings(STYLE):
        figure = draw(result)
    if figure is not None:
        figure._repr_png_ = partial(image, figure, "png")
    return figure


def image(figure: Figure, format: str = "svg") -> bytes:
    """A figure as the bytes of a file."""
    file = io.BytesIO()
    with figure_settings(STYLE):
        _print(figure, file, format=format)
    return file.getvalue()


def write(figure: Figure, path: str | Path) -> None:
    """Write a figure atomically to a file; the suffix determines the format.

    Raises
    ------
    OutputError
    """
    with whole_file(path) as file, figure_settings(STYLE):
        _print(figure, file, format=Path(path).suffix[1:])


def _print(figure, target, **options):
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure)
    figure.savefig(target, **options)
