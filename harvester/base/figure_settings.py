"""matplotlib with its default settings and this project's style, without settings files."""

from __future__ import annotations

import contextlib
import os
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path

from harvester.base.arguments import usual_arithmetic
from harvester.base.surroundings import PACKAGE, away_from_working_folder


def load_matplotlib() -> None:
    """Import matplotlib and its styles without any settings file, for any MPLBACKEND.

    On import matplotlib reads `matplotlibrc` and the user's styles: a damaged file would break
    every figure, and a pipe would block. If the caller has already imported matplotlib, its
    settings apply.
    """
    if "matplotlib" not in sys.modules:
        with _variables(MATPLOTLIBRC=os.devnull, MPLBACKEND=None), away_from_working_folder():
            import matplotlib
        _choose_backend(matplotlib)
    if "matplotlib.style" not in sys.modules:
        _import_styles()


def _choose_backend(matplotlib):
    """Use the backend that MPLBACKEND names, if matplotlib has it."""
    backend = os.environ.get("MPLBACKEND")
    with contextlib.suppress(ValueError):
        if backend:
            matplotlib.rcParams["backend"] = backend


def _import_styles():
    """Import matplotlib's styles without the user's styles."""
    import matplotlib

    folder_of_settings = matplotlib.get_configdir
    # This folder contains no styles, so no user's styles are read.
    matplotlib.get_configdir = lambda: str(PACKAGE)
    try:
        import matplotlib.style
    finally:
        matplotlib.get_configdir = folder_of_settings


@contextlib.contextmanager
def _variables(**values: str | None) -> Iterator[None]:
    """Set environment variables within the block; None removes one."""
    before = {name: os.environ.get(name) for name in values}
    _set(values)
    try:
        yield
    finally:
        _set(before)


def _set(values):
    for name, value in values.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


@contextlib.contextmanager
def figure_settings(*styles: str | Path) -> Iterator[None]:
    """Draw within the block by matplotlib's defaults and these styles alone.

    A `matplotlibrc` could run TeX; a glyph missing from all fonts is drawn as a box, without a
    warning.
    """
    load_matplotlib()
    from matplotlib import style

    with usual_arithmetic(), style.context(["default", *styles]), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from")
        yield
