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
# # Work and precision: which step is short enough, and what does a shorter one cost?
#
# *For whoever chooses a step, or asks what accuracy costs.*
#
# Two errors matter. The *strong* error is that of the path itself, against scipy's integrator at
# eleven digits on the same noise. The *bias* is that of the means, against a fine Monte Carlo run
# on the same noise: what the noise does to both cancels in the difference.

# %%
import matplotlib.pyplot as plt

import harvester
from harvester.validation import MEANS
from harvester.validation.accuracy import bias_verdict
from harvester.validation.accuracy_methods import ComparedMethod

plt.style.use("harvester.results.house")

# %% [markdown]
# ## A small diagram
#
# `harvester accuracy paper --output results` measures every method. Here are two families:
# the circuit at four steps, and Runge–Kutta at two. `refinement` divides the engine's default step.
# The noise is weak, so that the motion stays inside the wells and short runs tell the bias; with
# jumps between the wells take a longer `run.duration`, or `--thorough`.

# %%
scene = harvester.Scene.read("paper").replace(
    {
        "excitation.intensity": 0.005,
        "run.duration": 600.0,
        "run.settle": 100.0,
        "run.realizations": 8,
    }
)
circuit = [
    ComparedMethod(
        "circuit, trapezoidal", "circuit", 2, refinement, scheme="trapezoidal", copies=None
    )
    for refinement in (0.5, 1, 2, 4)
]
monte_carlo = [ComparedMethod("Monte Carlo", "monte-carlo", 4, refinement) for refinement in (1, 2)]
diagram = harvester.accuracy(scene, methods=[*circuit, *monte_carlo])

# %% [markdown]
# ## Reading it
#
# In the first panel each line falls with the order of its scheme: half the step costs twice the
# time, and divides the error by 4 (order 2) or 16 (order 4). A bias below the grey line is below
# the run's own sampling error: a shorter step would not make that answer better, a longer run does.

# %%
for row in diagram.rows:
    print(
        f"{row.method.family:22} step {row.method.step(scene):<8g} "
        f"{row.seconds_per_unit * 1e6:6.1f} µs per simulated second; "
        f"error of X {row.strong['displacement']:.1e}; bias: {bias_verdict(row)}"
    )

# %% [markdown]
# ## Answer


# %%
def resolved(row):
    """Largest bias of a row's means with three of its standard errors on top."""
    biases = [row.bias[name] for name in MEANS]
    return max(abs(bias.estimate) + 3.0 * bias.standard_error for bias in biases)


rows = [row for row in diagram.rows if row.method.engine == "circuit"]
below = [row for row in rows if resolved(row) <= 0.01]
default = next(row for row in rows if row.method.refinement == 1)
if below:
    chosen = max(below, key=lambda row: row.method.step(scene))
    price = chosen.seconds_per_unit / default.seconds_per_unit
    print(
        f"The longest circuit step whose biases are shown to be below 1 % is "
        f"{chosen.method.step(scene):g} s; it costs {price:.1f} times the time of the default, "
        f"{default.method.step(scene):g} s, whose largest bias is "
        f"{max(abs(default.bias[name].estimate) for name in MEANS):.2%}."
    )
else:
    print("This run is too short to show any circuit step's biases below 1 %: lengthen it.")
diagram.figure()
