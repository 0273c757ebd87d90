"""Results of engines and closures, and how they are written and drawn."""

from harvester.former_names import handed_on


def __getattr__(name: str) -> object:
    return handed_on("harvester.results", "harvester.results.result", name)
