"""Kinds of the values that a load's measures ask for."""

# Kinds of measures: a power delivered to the load's purpose, a power lost, a stored energy, 1 while
# a condition holds, and the power taken while it holds.
OUTPUT, LOSS, STORE, STATE, TAKEN = "output", "loss", "store", "state", "taken"
# The power that sources of the load take, and the power that a battery stores. No measure of a
# file has these kinds.
SUPPLY, BATTERY = "supply", "battery"
# The voltage (V) or current (A) of a store that is followed. No measure of a file has this kind.
LEVEL = "level"
