"""Kinds of the values that are recorded for a load."""

# Kinds of measures: useful power, lost power, stored energy, 1 while a condition is true, and the
# power taken while it is true.
OUTPUT, LOSS, STORE, STATE, TAKEN = "output", "loss", "store", "state", "taken"
# Power absorbed by the load's sources, and power stored in a battery. A file's measures cannot have
# these kinds.
SUPPLY, BATTERY = "supply", "battery"
# Recorded voltage (V) or current (A) of an energy store. A file's measures cannot have this kind.
LEVEL = "level"
