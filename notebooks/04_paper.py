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
# # The paper of Li, Liu and Li (2023): do its figures come out again, and do its statements hold?
#
# *For whoever compares this program with that paper.*
#
# The paper derives its curves by stochastic averaging and compares them with its own Monte Carlo.
# Here the same equations go through the closures, Monte Carlo and the circuit. Everything is data:
# `harvester/validation/paper.toml`.

# %%
import matplotlib.pyplot as plt

import harvester

plt.style.use("harvester.results.house")
scene = harvester.Scene.read("paper")

# %% [markdown]
# ## One figure, quickly
#
# Fig. 5 is the density of the displacement for two noise intensities and two correlation times.
# Lines are closures, symbols simulation with two standard errors. `harvester reproduce all` draws
# all of them, with longer runs where `--quick` is left out.

# %%
(fifth,) = harvester.reproduce(scene, ["fig5"], quick=True)
heads, rows = fifth.table()
for row in [heads, *rows]:
    print(f"{row[1]:6} {row[2]:12} {row[6]:>36} {row[7]:>8}")

# %% [markdown]
# ## Its statements
#
# `harvester reproduce claims` tests every statement of the paper on a trend at the paper's
# conditions. A finding counts if it exceeds three standard errors. Here are the verdicts on the
# statements about the coupling coefficient β and the frequency band.

# %%
(statements,) = harvester.reproduce(scene, ["claims"])
header, verdicts = statements.table()
chosen = [row for row in verdicts if row[1].endswith("rises with β") or "frequencies" in row[1]]
for row in chosen:
    print(row[1])
    for method, verdict in zip(header[2:], row[2:], strict=True):
        print(f"    {method:14} {verdict}")

# %% [markdown]
# ## Answer

# %%
distances = {row[2]: row[7].lstrip("+") for row in rows if row[1].startswith("a")}
by_monte_carlo = {row[1]: row[header.index("monte-carlo")] for row in chosen}
held = [says for says, verdict in by_monte_carlo.items() if verdict.startswith("holds")]
failed = [says for says, verdict in by_monte_carlo.items() if verdict.startswith("does not hold")]
print(
    f"In Fig. 5a the circuit is {distances['circuit']} from Monte Carlo in ∫|p − p'| dX, the "
    f"closure fokker_planck {distances['fokker_planck']} and the closure as printed "
    f"{distances['paper']}; "
    f"of these statements, by Monte Carlo {'; '.join(held) or 'none'} held, and "
    f"{'; '.join(failed) or 'none'} did not."
)
fifth.figure()
