# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # A load study: which resistance suits my rectifier best, and what does rectifying cost?
#
# *For designers of rectifiers.*
#
# Any SPICE sub-circuit can be the load. This one is a full-wave bridge in a file of its own, as
# your netlist would be.

# %%
import math
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import harvester

plt.style.use("harvester.results.house")

# %% [markdown]
# ## The load
#
# Pins named `p n out ref` are the piezo's terminals and the DC side. Resistors across `out ref` are
# the output, capacitors there its storage.

# %%
folder = tempfile.TemporaryDirectory()
path = Path(folder.name) / "my_rectifier.lib"
_ = path.write_text(
    """* full-wave bridge of small Schottky diodes
.subckt my_rectifier p n out ref resistance=500k storage=100n
.model schottky d(is=200n n=1.05 rs=10 cjo=5p)
D1 p out schottky
D2 ref p schottky
D3 n out schottky
D4 ref n schottky
Cstray ref n 10p
Cstorage out ref {storage}
Rload out ref {resistance}
.ends
"""
)

# %% [markdown]
# ## The sweep
#
# The rectifier is compared with a plain resistor, which takes the alternating voltage directly. All
# points receive the same noise, and each runs until the standard error of its output power is 5 %.
# With `output="folder"` every finished task is stored, and the same call continues after an
# interruption.

# %%
scene = harvester.Scene.read("device").replace({"run.settle": 2.0})
study = harvester.load_study(
    scene,
    loads=["resistor", str(path)],
    over={"load.parameters.resistance": np.geomspace(1e5, 3e6, 5)},
    precision=0.05,
)
for evaluation, point in zip(study.evaluations, study.grid.points, strict=True):
    power = evaluation.estimates["output_power"]
    resistance = point.scene.load.parameters["resistance"]
    print(
        f"{point.scene.load.circuit.name:14} {resistance / 1e3:6.0f} kΩ: "
        f"{power.estimate * 1e6:5.0f} ± {power.standard_error * 1e6:.0f} µW"
    )

# %% [markdown]
# ## The optimum and the ranking
#
# The optimum of a load is the maximum of a parabola through its highest point and the two
# neighbours. Its interval follows from differences on the same noise; at an end of the sweep there
# is no optimum. Loads are ranked by the difference between their highest points, in which the
# common noise cancels.

# %%
print(*study.sentences(), sep="\n")

# %% [markdown]
# ## Answer

# %% mystnb={"image": {"alt": "Output power of rectifier and resistor over load resistance"}}
(found, place) = study.optima[1]
power = study.best((1,)).estimates["output_power"]
best = study.grid.sweeps["load.parameters.resistance"][place]
interval = (
    f"its optimum lies between {found.low / 1e3:.0f} and {found.high / 1e3:.0f} kΩ"
    if math.isfinite(found.low)
    else "the sweep does not enclose its optimum"
)
(_, (difference,)) = study.rankings[()]
print(
    f"My rectifier gives {power.estimate * 1e3:.2f} ± {power.standard_error * 1e3:.2f} mW at "
    f"{best / 1e3:.0f} kΩ, and {interval}; at the best of each, {difference.better} is "
    f"{difference.estimate:.0%} ± {difference.standard_error:.0%} ahead of {difference.worse}."
)
study.figure()
