"""The licence text at the head of every file that is written for other programs."""

EXPORTED = (
    "Made by harvester. You may use, change and pass on this file under any terms: its lines of",
    "harvester are free of the program's own licence, see LICENSE-EXCEPTION there.",
)
