"""Kinds of what a load measures of itself."""

# Kinds of the rows of measured values: a power into what the load is for, a power lost, a stored
# energy, 1 while a condition holds, and the power taken while it does.
OUTPUT, LOSS, STORE, STATE, TAKEN = "output", "loss", "store", "state", "taken"
