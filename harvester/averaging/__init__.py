"""Stationary means and densities of a scene or device without simulation, by a closure."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harvester.averaging.closures import CLOSURES as CLOSURES
    from harvester.averaging.closures import NOISE_CLOSURES as NOISE_CLOSURES
    from harvester.averaging.closures import average as average

# The default closure: it holds for the widest range of devices.
DEFAULT_CLOSURE = "fokker_planck"
__all__ = ["CLOSURES", "DEFAULT_CLOSURE", "NOISE_CLOSURES", "average"]


def __getattr__(name: str) -> object:
    # Imported here, not at the head: the closures need numba, the default's name does not.
    if name in ("CLOSURES", "NOISE_CLOSURES", "average"):
        from harvester.averaging import closures

        return getattr(closures, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
