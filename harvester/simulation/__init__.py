"""`simulate`: realizations by one engine, and the estimates from them."""

from harvester.former_names import handed_on


def __getattr__(name: str) -> object:
    return handed_on("harvester.simulation", "harvester.simulation.simulate", name)
