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
# # Work and precision: which time step is short enough, and what does a shorter one cost?
#
# *For users who choose a time step, or ask what accuracy costs.*
#
# Two errors matter. The *strong error* is the rms difference of a path from the exact path, by
# scipy's integrator with eleven digits on the same noise. The *bias* is the error of a mean,
# compared with a Monte Carlo run with fine steps on the same noise, which cancels in the
# difference.

# %%
import matplotlib.pyplot as plt

import harvester

plt.style.use("harvester.results.house")

# %% [markdown]
# ## A small diagram
#
# `harvester accuracy paper --output results` measures every method on the whole scene. This run is
# shorter, with weak noise: the motion stays inside the wells, so that short runs suffice. If the
# device jumps between wells, choose a longer `run.duration`, or `--thorough`.

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
# ## Read the result
#
# In the first panel of the figure at the end, the slope of each line is the order of its scheme:
# half the step takes twice the time, and divides the error by 4 (order 2) or 16 (order 4). The grey
# line is the sampling error of the run. If a bias is below this line, a longer run improves the
# result more than a shorter step.

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


# %% mystnb={"image": {"alt": "Error of every method over run time"}}
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
