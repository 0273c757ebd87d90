"""Stationary means and densities of a scene or device without simulation, by a closure."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harvester.averaging.closures import average as average

CLOSURES = ("paper", "consistent", "fokker_planck")
# The closure that holds most widely.
DEFAULT_CLOSURE = "fokker_planck"
# Largest numerical error of each that is an answer, unless told otherwise.
TOLERANCES = {"paper": 1e-3, "consistent": 1e-3, "fokker_planck": 1e-2}
__all__ = ["CLOSURES", "DEFAULT_CLOSURE", "TOLERANCES", "average"]


def __getattr__(name: str) -> object:
    # Imported where it is used: the closures need numba, their names do not.
    if name == "average":
        from harvester.averaging.closures import average

        return average
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
