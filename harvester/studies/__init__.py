"""Studies: many runs of one scene on common noise, with error bars, that survive a kill."""

# The default method of a load study: Monte Carlo, cross-checked with the circuit at some points.
JUDGED = "judged"
# Default number of rows of a design of devices.
ROWS = 64
# Default time budget of a load study with a precision, in seconds.
TIME_BUDGET = 540.0
