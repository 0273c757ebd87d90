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
# # First run: how much power does a device give, and do three methods agree on it?
#
# *For newcomers: one scene by every method, in Python.*
#
# A scene describes a device, its load, its excitation and the run. This one is the bistable
# harvester of Li, Liu and Li (2023) with two stoppers, driven by coloured noise. It is computed by
# the equivalent circuit in ngspice, by Monte Carlo on the same noise, and by methods without
# simulation.

# %%
import matplotlib.pyplot as plt

import harvester

plt.style.use("harvester.results.house")

# %% [markdown]
# ## The scene
#
# `paper` is a built-in scene; `Scene.read` also reads your own TOML file. `replace` returns a
# checked copy with changed values. Here the runs are shorter, so that this page takes seconds.

# %%
scene = harvester.Scene.read("paper").replace(
    {"run.duration": 2000.0, "run.settle": 200.0, "run.realizations": 16}
)
scene.to_tables()

# %% [markdown]
# ## The circuit
#
# Node voltages represent displacement, velocity and the voltage of the piezo. A current into the
# node `velocity` represents an acceleration. `harvester netlist paper` writes the netlist.

# %% mystnb={"image": {"alt": "Equivalent circuit of the scene paper"}}
harvester.schematic(scene)

# %% [markdown]
# ## All methods
#
# Circuit and Monte Carlo receive the same noise samples. Each of their numbers has a standard
# error. For methods without simulation the table gives the deviation from Monte Carlo, in percent
# and in standard errors of Monte Carlo.

# %% tags=["table"]
comparison = harvester.validate(scene)
header, rows = comparison.table()
for row in [header, *rows]:
    print(f"{row[0]:28}", *(f"{cell:>27}" for cell in row[2:]))

# %%
print(*comparison.sentences(), sep="\n")

# %% [markdown]
# The result of one method, the circuit, with units, effective sample sizes and notes:

# %%
comparison.circuit

# %% [markdown]
# ## With sliders
#
# In Jupyter this cell shows a slider for each key, and a picture that follows the sliders. This
# page shows the picture of the unchanged scene.

# %% mystnb={"image": {"alt": "Densities, power and motion of the scene"}}
harvester.explore(scene, ["excitation.intensity", "stoppers.gap"])

# %% [markdown]
# ## Answer

# %% mystnb={"image": {"alt": "Densities and one path by every method"}}
power = comparison.circuit.quantity("mean_power")
names = ("mean_power", "mean_square_voltage", "mean_square_displacement", "mean_square_velocity")
apart = max(abs(comparison.difference(name)) for name in names)
off = {name: comparison.deviation(name, "mean_power")[0] for name in comparison.closures}
print(
    f"The device gives {power.estimate:.5f} ± {power.standard_error:.5f} scaled units of power; "
    f"circuit and Monte Carlo are at most {apart:.1f} joint standard errors apart, and of the "
    "stationary methods "
    + ", ".join(f"{name} is {share:+.0%}" for name, share in off.items())
    + " from Monte Carlo."
)
comparison.figure()
