"""Kinds of the values that a load's measures ask for."""

# A power into what the load is for, a power lost, a stored energy, 1 while a condition holds, and
# the power taken while it does.
OUTPUT, LOSS, STORE, STATE, TAKEN = "output", "loss", "store", "state", "taken"
# A voltage (V) or a current (A) by which the load's stores are followed; no measure asks for it.
LEVEL = "level"
