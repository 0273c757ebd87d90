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
# A scene says what is simulated. Here it is the bistable harvester of Li, Liu and Li (2023) with
# two stoppers, shaken by coloured noise. The same scene goes through a circuit (ngspice), a Monte
# Carlo reference on the same noise, and stochastic averaging.

# %%
import matplotlib.pyplot as plt

import harvester

plt.style.use("harvester.results.house")

# %% [markdown]
# ## The scene
#
# `paper` is built in; `Scene.read` reads a TOML file of your own as well. `replace` gives a scene
# with other values, checked: shorter runs, so that this page takes seconds.

# %%
scene = harvester.Scene.read("paper").replace(
    {"run.duration": 2000.0, "run.settle": 200.0, "run.realizations": 16}
)
scene.to_tables()

# %% [markdown]
# ## The circuit
#
# Voltages represent displacement, velocity and the piezo's voltage, a current into node `velocity`
# an acceleration. `harvester netlist paper` writes the netlist.

# %%
harvester.schematic(scene)

# %% [markdown]
# ## Three ways
#
# Circuit and Monte Carlo get the same noise, knot by knot. Each number has an error bar from
# correlated batches; a closure's deviation is given in per cent and in those standard errors.

# %%
comparison = harvester.validate(scene)
header, rows = comparison.table()
for row in [header, *rows]:
    print(f"{row[0]:28}", *(f"{cell:>27}" for cell in row[2:]))
print(*comparison.sentences(), sep="\n")

# %% [markdown]
# One method alone: the circuit's result, with units, effective samples and what a reader must know.

# %%
comparison.circuit

# %% [markdown]
# ## With sliders
#
# In Jupyter this is a slider for each key, and a picture that follows them; here it is the picture
# of the scene as it is.

# %%
harvester.explore(scene, ["excitation.intensity", "stoppers.gap"])

# %% [markdown]
# ## Answer

# %%
power = comparison.circuit.quantity("mean_power")
names = ("mean_power", "mean_square_voltage", "mean_square_displacement", "mean_square_velocity")
apart = max(abs(comparison.difference(name)) for name in names)
off = {name: comparison.deviation(name, "mean_power")[0] for name in comparison.closures}
print(
    f"The device gives {power.estimate:.5f} ± {power.standard_error:.5f} scaled units of power; "
    f"circuit and Monte Carlo are at most {apart:.1f} joint standard errors apart, and of the "
    "closures "
    + ", ".join(f"{name} is {share:+.0%}" for name, share in off.items())
    + " from Monte Carlo."
)
comparison.figure()
