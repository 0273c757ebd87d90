"""The house style is drawn whatever settings files of matplotlib lie about."""

import os
import subprocess
import sys

import pytest

from harvester.base.surroundings import PACKAGE

DRAW = """
import io
from harvester.base.figure_settings import figure_settings

with figure_settings():
    from matplotlib.figure import Figure
    figure = Figure()
    figure.add_subplot().plot([1, 2])
    figure.savefig(io.BytesIO())
import matplotlib
print(matplotlib.rcParams["lines.linewidth"], len(matplotlib.style.library) > 5)
"""
SETTINGS = ["matplotlibrc", "matplotlib/matplotlibrc", "matplotlib/stylelib/own.mplstyle"]


@pytest.mark.parametrize("kind", ["pipe", "damaged"])
def test_settings_files_are_neither_waited_for_nor_believed(tmp_path, kind):
    """In the working folder, at home, among the user's styles, and by a variable."""
    for name in [*SETTINGS, "named"]:
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        if kind == "pipe":
            os.mkfifo(file)
        else:
            file.write_bytes(b"lines.linewidth: 7\n\xff\xfe: no setting\n")
    surroundings = {"XDG_CONFIG_HOME": str(tmp_path), "MATPLOTLIBRC": str(tmp_path / "named")}
    surroundings |= {"MPLBACKEND": "no_such_backend", "PYTHONPATH": str(PACKAGE.parent)}
    shown = subprocess.run(
        [sys.executable, "-P", "-c", DRAW],
        cwd=tmp_path,
        env=os.environ | surroundings,
        capture_output=True,
        text=True,
        timeout=120,
    )
    # matplotlib's own: what is drawn outside has no style of the house's.
    assert shown.stdout == "1.5 True\n", shown.stderr
