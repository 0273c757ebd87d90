"""Studies: many runs of one scene on common noise, with error bars; they can be resumed."""

# Default method of a load study: Monte Carlo, cross-checked with the circuit at some points.
JUDGED = "judged"
# Default number of rows in a design of devices.
ROWS = 64
# Default time budget (s) of a load study with a target precision.
TIME_BUDGET = 540.0
