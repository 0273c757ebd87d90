"""matplotlib with its own settings and the house's, whatever settings files lie about."""

import contextlib
import warnings

from harvester.surroundings import load_matplotlib


@contextlib.contextmanager
def figure_settings(*styles):
    """Draw within the block by matplotlib's defaults and these styles, nothing else.

    A `matplotlibrc` could have TeX run; a glyph that no font has is a box, and no warning.
    """
    load_matplotlib()
    from matplotlib import style

    with style.context(["default", *styles]), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from")
        yield
