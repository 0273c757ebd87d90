"""A package that adds a part of each kind, as pip would have installed it."""

import shutil
from pathlib import Path

MODULES = ("toy_excitation", "spring_dashpot", "series_piezo", "toy_closure", "toy_format")
METADATA = "Metadata-Version: 2.1\nName: toys\nVersion: 1.0\n"
ENTRY_POINTS = """\
[harvester.excitations]
steps = toy_excitation:Steps
[harvester.contact_laws]
dashpot = spring_dashpot:spring_dashpot
[harvester.transducers]
electrode_piezo = series_piezo:SeriesPiezoTable
[harvester.closures]
toy = toy_closure:TOY
[harvester.record_formats]
.counts = toy_format:FORMAT
"""
SCENE = """\
units = "SI"
[oscillator]
mass = 0.01
damping = 0.02
linear_stiffness = 40.0
[[stoppers]]
gap = 0.002
stiffness = 100.0
restitution = 0.5
side = "right"
law = "dashpot"
[electrode_piezo]
coupling = 1e-3
capacitance = 1e-7
electrode_resistance = 1e4
[load]
resistance = 1e5
[excitation]
kind = "steps"
height = 1.0
[run]
duration = 5.0
settle = 1.0
realizations = 2
"""


def install(folder: Path) -> None:
    """Put the package into a folder of packages."""
    for name in MODULES:
        shutil.copy(Path(__file__).parent / f"{name}.py", folder)
    about = folder / "toys-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(METADATA)
    (about / "entry_points.txt").write_text(ENTRY_POINTS)
