"""matplotlib with its own settings and the house's, whatever settings files lie about."""

import contextlib
import os
import warnings
from pathlib import Path


@contextlib.contextmanager
def figure_settings(*styles):
    """Draw within the block by matplotlib's defaults and these styles, nothing else.

    A `matplotlibrc` could have TeX run; a glyph that no font has is a box, and no warning.
    """
    style = import_style()
    with style.context(list(styles), after_reset=True), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from")
        yield


def import_style():
    """The module `matplotlib.style`, imported where no `matplotlibrc` lies."""
    try:
        here = os.getcwd()
    except OSError:  # it was removed
        here = None
    os.chdir(Path(__file__).parent)
    try:
        from matplotlib import style
    finally:
        if here:
            os.chdir(here)
    return style
