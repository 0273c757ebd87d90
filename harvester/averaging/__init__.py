"""Means and densities of a scene without noise paths: averaging, Fokker–Planck, spectral."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harvester.averaging.closures import CLOSURES as CLOSURES
    from harvester.averaging.closures import NOISE_CLOSURES as NOISE_CLOSURES
    from harvester.averaging.closures import average as average

__all__ = ["CLOSURES", "NOISE_CLOSURES", "average"]


def __getattr__(name: str) -> object:
    # Imported here, not at the head: the closures need numba, `Stationary` does not.
    if name in __all__:
        from harvester.averaging import closures

        return getattr(closures, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
