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
# # The paper of Li, Liu and Li (2023): can its figures be reproduced, and do its statements hold?
#
# *For readers of the paper.*
#
# The paper derives its curves by stochastic averaging and compares them with its own Monte Carlo.
# Here the same equations are solved by stationary methods, Monte Carlo and the circuit. The file
# `harvester/validation/paper.toml` contains the figures and statements.

# %%
import matplotlib.pyplot as plt
import numpy as np

import harvester

plt.style.use("harvester.results.house")
scene = harvester.Scene.read("paper")

# %% [markdown]
# ## One figure
#
# Fig. 5 is the density of the displacement for two noise intensities and two correlation times.
# Lines are stationary methods, symbols are simulations with bars of two standard errors. `harvester
# reproduce all` draws all figures; without `--quick` its runs are longer.

# %% tags=["table"]
(fifth,) = harvester.reproduce(scene, ["fig5"], quick=True)
heads, rows = fifth.table()
for row in [heads, *rows]:
    print(f"{row[1]:6} {row[2]:12} {row[6]:>36} {row[7]:>8}")

# %% [markdown]
# ## Two statements
#
# `harvester reproduce claims` tests every statement of the paper. This cell tests two of them at
# the noise intensity D = 0.08, with jumps between the wells: the mean-square voltage E[V²] and the
# mean power E[P] rise with the coupling coefficient β. A change is significant if it exceeds three
# standard errors.

# %%
QUANTITIES = {"E[V²]": "mean_square_voltage", "E[P]": "mean_power"}
jumping = scene.replace({"excitation.intensity": 0.08, "run.realizations": 160})
weak, strong = (jumping.replace({"piezo.coupling": beta}) for beta in (0.3, 0.95))
answers = {
    "monte-carlo": [harvester.simulate(case, method="monte-carlo") for case in (weak, strong)],
    "fokker_planck": [harvester.average(case) for case in (weak, strong)],
}
changes = {}
for method, (first, last) in answers.items():
    for symbol, name in QUANTITIES.items():
        before, after = first.quantities[name], last.quantities[name]
        error = np.hypot(before.standard_error, after.standard_error)
        changes[method, symbol] = (after.estimate - before.estimate) / error
        growth = after.estimate / before.estimate - 1.0
        print(
            f"{method:14} {symbol:6} {growth:+.1%}, {changes[method, symbol]:+.0f} standard errors"
        )

# %% [markdown]
# ## Answer

# %% mystnb={"image": {"alt": "Density of the displacement by every method, in four panels"}}
distances = {row[2]: row[7].lstrip("+") for row in rows if row[1].startswith("a")}
says = {symbol: f"{symbol} rises with β" for symbol in QUANTITIES}
held = [says[symbol] for symbol in says if changes["monte-carlo", symbol] > 3.0]
failed = [says[symbol] for symbol in says if changes["monte-carlo", symbol] < -3.0]
print(
    f"In Fig. 5a the circuit is {distances['circuit']} from Monte Carlo in ∫|p − p'| dX, the "
    f"method fokker_planck {distances['fokker_planck']} and the method as printed "
    f"{distances['paper']}; "
    f"of the statements tried, by Monte Carlo {'; '.join(held) or 'none'} held, and "
    f"{'; '.join(failed) or 'none'} did not."
)
fifth.figure()
