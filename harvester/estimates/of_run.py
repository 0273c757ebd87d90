"""What the moments of a run come to: its estimates, what they are too short for, and notes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from harvester.estimates.balance import energy_balance_residual
from harvester.estimates.batch_means import standard_error, standard_error_of_drift
from harvester.estimates.means import estimate_all
from harvester.estimates.output_side import estimate_output
from harvester.estimates.passivity import efficiency_notes, source_notes
from harvester.estimates.settling import Shortfall, shortfalls, withheld
from harvester.results import unit_of
from harvester.scene.units import scale

if TYPE_CHECKING:
    from harvester.estimates.estimate import Estimate
    from harvester.record.moments import Moments
    from harvester.scene.model import Scene


@dataclass(frozen=True)
class RunEstimates:
    """Scaled estimates of a run, and what to know before citing one.

    Attributes
    ----------
    whole : dict of str to Estimate
        With all error bars.
    shortfalls : list of Shortfall
        What the run was too short for.
    residual : float
        Of the energy balance, as a share of the energy put in.
    notes : tuple of str
        On sources in the load, efficiencies above 1 and the shortfalls.
    """

    whole: dict[str, Estimate]
    shortfalls: list[Shortfall]
    residual: float
    notes: tuple[str, ...]

    @property
    def scaled(self) -> dict[str, Estimate]:
        """The estimates without the error bars that would lie."""
        return withheld(self.whole, self.shortfalls)


def run_estimates(scene: Scene, moments: Sequence[Moments]) -> RunEstimates:
    """Estimates from the moments of a scene's realizations."""
    system, scales = scale(scene)
    moments = list(moments)
    error_of = standard_error_of_drift if scene.excitation.drifts else standard_error
    whole = estimate_all(moments, system, error_of) | estimate_output(moments)
    found = shortfalls(scene, system, moments, whole)
    notes = (
        *source_notes(scene.load.circuit),
        *_loose_nodes(scene.load.circuit),
        *(scene.load.circuit.reading_notes if scene.load.circuit else ()),
        *efficiency_notes(whole, scales.of("power"), unit_of(scene, "power")),
        *(each.note for each in found),
    )
    return RunEstimates(whole, found, energy_balance_residual(moments, system), notes)


def _loose_nodes(load):
    """A note on nodes of a load that lead nowhere: a misspelt name makes such."""
    if load is None or not load.loose_nodes:
        return ()
    more = " …" if load.loose_nodes[3:] else ""
    return (f"nothing else is connected to the node {', '.join(load.loose_nodes[:3])}{more}",)
