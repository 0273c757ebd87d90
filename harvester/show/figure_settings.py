"""matplotlib with its own settings and the house's, whatever settings files lie about."""

from __future__ import annotations

import contextlib
import os
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path

from harvester.files.surroundings import away_from_working_folder


def load_matplotlib() -> None:
    """Import matplotlib without what lies in the working folder, whatever MPLBACKEND names.

    It reads a file `matplotlibrc` from there as it is imported, and fails at a backend it does
    not know.
    """
    if "matplotlib" in sys.modules:
        return
    wanted = os.environ.pop("MPLBACKEND", None)
    try:
        with away_from_working_folder():
            import matplotlib
    finally:
        if wanted is not None:
            os.environ["MPLBACKEND"] = wanted
    with contextlib.suppress(ValueError):
        if wanted:
            matplotlib.rcParams["backend"] = wanted


@contextlib.contextmanager
def figure_settings(*styles: str | Path) -> Iterator[None]:
    """Draw within the block by matplotlib's defaults and these styles, nothing else.

    A `matplotlibrc` could have TeX run; a glyph that no font has is a box, and no warning.
    """
    load_matplotlib()
    from matplotlib import style

    with style.context(["default", *styles]), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from")
        yield
