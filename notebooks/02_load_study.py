# ---
# jupyter:
#   jupytext:
#     text_representation:
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # A load study: which resistance behind my own rectifier harvests most?
#
# Any sub-circuit can be the load. This one is a full-wave bridge with its own diodes; it comes from
# a file, as a netlist of yours would, and no line of Python knows it.

# %%
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import harvester
from harvester import figures

plt.style.use(figures.STYLE)

# %% [markdown]
# ## The load
#
# Pins named `p n out ref` are the piezo's terminals and the DC side. Resistors across `out ref` are
# the output, capacitors there its storage.

# %%
folder = tempfile.TemporaryDirectory()
path = Path(folder.name) / "my_rectifier.lib"
path.write_text(
    """* full-wave bridge of small Schottky diodes
.subckt my_rectifier p n out ref resistance=100k storage=100n
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
scene = harvester.Scene.load("device").replace(
    {
        "load.netlist": str(path),
        "run.duration": 20.0,
        "run.settle": 2.0,
        "run.realizations": 8,
    }
)
scene.electrical_load.circuit.has_output

# %% [markdown]
# ## The sweep
#
# The noise is the same for every resistance, so differences between neighbours are surer than the
# error bars of each.

# %%
resistances = np.geomspace(5e4, 5e6, 7)
results = [
    harvester.simulate(scene.replace({"load.parameters.resistance": float(resistance)}))
    for resistance in resistances
]
for resistance, result in zip(resistances, results, strict=True):
    power, efficiency = (
        result.quantity("mean_output_power"),
        result.quantity("converter_efficiency"),
    )
    print(
        f"{resistance / 1e3:7.0f} kΩ: {power.estimate * 1e6:6.2f} ± "
        f"{power.standard_error * 1e6:.2f} µW out, converter efficiency {efficiency.estimate:.1%}"
    )

# %% [markdown]
# ## Answer

# %%
powers = [result.quantity("mean_output_power") for result in results]
best = max(range(len(powers)), key=lambda k: powers[k].estimate)
inside = 0 < best < len(powers) - 1
where = "near" if inside else "at the end of the range,"
print(
    f"Of these loads the rectifier harvests most {where} {resistances[best] / 1e3:.0f} kΩ: "
    f"{powers[best].estimate * 1e6:.1f} ± {powers[best].standard_error * 1e6:.1f} µW, "
    f"{results[best].quantity('end_to_end_efficiency').estimate:.1%} of the mechanical input."
)
_, axes = plt.subplots(figsize=(6.0, 3.2))
axes.errorbar(
    resistances,
    [1e6 * power.estimate for power in powers],
    [2e6 * power.standard_error for power in powers],
    marker="o",
    capsize=2,
)
axes.set(xscale="log", xlabel="resistance [Ω]", ylabel="mean output power [µW]", ylim=(0.0, None))
axes.set_title("output power, two standard errors")
plt.show()
