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

plt.style.use("harvester.results.house")

# %% [markdown]
# ## A small diagram
#
# `harvester accuracy paper --output results` measures every method on the whole scene. This run is
# shorter, with weak noise: the motion stays inside the wells, so short runs resolve the bias.
# If the device jumps between wells, take a longer `run.duration`, or `--thorough`.

# %%
scene = harvester.Scene.read("paper").replace(
    {
        "excitation.intensity": 0.005,
        "run.duration": 400.0,
        "run.settle": 100.0,
        "run.realizations": 8,
    }
)
diagram = harvester.accuracy(scene)

# %% [markdown]
# ## Reading it
#
# In the first panel of the figure at the end, each line falls with the order of its scheme: half
# the step costs twice the time, and divides the error by 4 (order 2) or 16 (order 4). A bias below
# the grey line is below the sampling error of the run: to improve that answer, lengthen the run
# instead of shortening the step.

# %%
for row in diagram.rows:
    biases = ", ".join(f"{name} {bias.estimate:+.2%}" for name, bias in row.bias.items())
    print(
        f"{row.method.family:34} step {diagram.longest_step(row.method):<8.3g} "
        f"{row.seconds_per_unit * 1e6:8.1f} µs per simulated second; "
        f"error of X {row.strong['displacement']:.1e}; bias: {biases}"
    )

# %% [markdown]
# ## Answer


# %%
def largest_bias(row):
    """Largest bias of a row's means, plus three of its standard errors."""
    return max(abs(bias.estimate) + 3.0 * bias.standard_error for bias in row.bias.values())


rows = [row for row in diagram.rows if row.method.family == "external source, trapezoidal"]
below = [row for row in rows if largest_bias(row) <= 0.01]
default = next(row for row in rows if row.method.refinement == 1)
if below:
    chosen = max(below, key=lambda row: diagram.longest_step(row.method))
    step, default_step = (diagram.longest_step(row.method) for row in (chosen, default))
    price = chosen.seconds_per_unit / default.seconds_per_unit
    print(
        f"The longest circuit step whose biases are shown to be below 1 % is "
        f"{step:g} s; it costs {price:.1f} times the time of the default, "
        f"{default_step:g} s, whose largest bias is "
        f"{max(abs(bias.estimate) for bias in default.bias.values()):.2%}."
    )
else:
    print("This run is too short to show any circuit step's biases below 1 %: lengthen it.")
diagram.figure()
