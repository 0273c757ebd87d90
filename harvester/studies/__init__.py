"""Studies: many runs of one scene on common noise, with error bars, that survive a kill."""

# The default method of a load study: Monte Carlo, cross-checked with the circuit at some points.
JUDGED = "judged"
# Default number of rows of a design of devices.
ROWS = 64
# Files in the folder of a load study, and in that of a sensitivity study.
LOAD_STUDY_FILES = (
    "load-study.nc", "load-study.csv", "power.png", "efficiency.png", "waveforms.png",
)  # fmt: skip
SENSITIVITY_FILES = ("sensitivity.json", "sensitivity.csv", "tornado.png", "distribution.png")
