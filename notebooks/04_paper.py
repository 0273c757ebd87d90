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
from dataclasses import replace

import matplotlib.pyplot as plt

import harvester
from harvester.validation.claims import METHODS, claims
from harvester.validation.statements import CLAIMS, JUMPING

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
header, rows = fifth.table()
for row in [header, *rows]:
    print(f"{row[1]:6} {row[2]:12} {row[6]:>36} {row[7]:>8}")

# %% [markdown]
# ## Three statements
#
# Each statement is tested at its conditions, and counts from three standard errors on. Here are
# three of them at D = 0.08, where the mass jumps between the wells. `harvester reproduce claims`
# tests all.

# %%
chosen = [
    claim if claim.conditions == ((),) else replace(claim, conditions=(JUMPING,))
    for claim in CLAIMS
    if claim.says.endswith("rises with β") or "wider frequency band" in claim.sentence
]
statements = claims(scene, chosen=chosen)
for claim, opinions in statements.opinions:
    print(claim.sentence)
    print(f"  tested: {claim.says}")
    for method in METHODS:
        print(f"    {method:12} {opinions[method].text()}")

# %% [markdown]
# ## Answer

# %%
distances = {row[2]: row[7].lstrip("+") for row in rows if row[1].startswith("a")}
held = [
    claim.says for claim, opinions in statements.opinions if opinions["monte-carlo"].word == "holds"
]
failed = [
    claim.says
    for claim, opinions in statements.opinions
    if opinions["monte-carlo"].word == "does not hold"
]
print(
    f"In Fig. 5a the circuit is {distances['circuit']} from Monte Carlo in ∫|p − p'| dX, the "
    f"closure fokker_planck {distances['fokker_planck']} and the closure as printed "
    f"{distances['paper']}; "
    f"of the statements tried, by Monte Carlo {'; '.join(held) or 'none'} held, and "
    f"{'; '.join(failed) or 'none'} did not."
)
fifth.figure()
