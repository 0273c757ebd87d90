"""Method object of a stationary method, with its settings."""

from dataclasses import dataclass
from typing import Any

from harvester.base.arguments import check_name
from harvester.base.method import Method
from harvester.base.signatures import Share

# The default stationary method: it holds for the widest range of devices.
DEFAULT_CLOSURE = "fokker_planck"


@dataclass(frozen=True)
class Stationary(Method):
    """Stationary means and densities by a stationary method, without simulation.

    Attributes
    ----------
    closure : str
        fokker_planck, paper, consistent or spectral; see `harvester.average`.
    tolerance, fit, jump_rates
        See `harvester.average`.
    """

    closure: str = DEFAULT_CLOSURE
    tolerance: Share | None = None
    fit: bool = False
    jump_rates: bool = False

    def __post_init__(self) -> None:
        from harvester.averaging.closures import CLOSURES

        check_name("method", self.closure, CLOSURES)

    @property
    def settings(self) -> dict[str, Any]:
        """The settings of the method, without its name."""
        return {name: value for name, value in super().settings.items() if name != "closure"}

    @property
    def name(self) -> str:
        """The name of the stationary method."""
        return self.closure
