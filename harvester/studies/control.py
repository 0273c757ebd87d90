"""The control variate of a load study: Monte Carlo of the device with the resistor that matches it.

It sees the same noise as the circuit, costs a hundredth, and its mean is known from a long run.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np

from harvester.device import timescales
from harvester.estimates.batch_means import standard_error
from harvester.estimates.control_variate import significant_correlation
from harvester.excitation import OrnsteinUhlenbeck
from harvester.running.realizations import Realizations
from harvester.running.request import good_ones
from harvester.running.task import Wanted
from harvester.scene.model import Scene
from harvester.scene.units import scale
from harvester.studies.evaluation import power_series

# The control's mean comes from so many realizations, this much longer, of another seed.
CONTROL_REALIZATIONS, CONTROL_LENGTH = 32, 30.0


@dataclass(frozen=True)
class Control:
    """A scene beside a point, on the same noise.

    Attributes
    ----------
    cut : Realizations
    long : Realizations
        Where its mean is known from: longer, and another seed.
    """

    cut: Realizations
    long: Realizations

    def beside(
        self, series: np.ndarray | None, found: Sequence
    ) -> Generator[Wanted, list, tuple[np.ndarray, float, float] | None]:
        """A plan: (series, its known mean, that one's error) for `controlled_mean`, or None.

        Parameters
        ----------
        series : ndarray or None
            Of the point, shape (realizations, batches).
        found : sequence
            Answers of the control's own tasks.
        """
        own = self._series(self.cut, found)
        if series is None or own is None:
            return None
        if significant_correlation(series, own[: len(series)]) is None:
            return None
        answers = yield Wanted(self.long.tasks(0, CONTROL_REALIZATIONS))
        long = self._series(self.long, answers)
        if long is None or (error := standard_error(long)) is None:
            return None
        return own, float(long.mean()), error

    def _series(self, cut, found):
        moments = [each for part in good_ones(found)[0] for each in part["moments"]]
        return power_series(moments, scale(cut.scene)[1].power) if moments else None


def control_of(scene: Scene) -> Control | None:
    """The Control of a scene; None where there is none."""
    if not isinstance(scene.excitation, OrnsteinUhlenbeck):
        return None
    parameters, _ = scale(scene)
    rate = timescales.angular_frequency(parameters)
    resistance = scene.transducer.matched_resistance(rate)
    load = {"resistance": resistance} if scene.units == "SI" else {"decay_rate": rate}
    tables = scene.to_tables()
    tables["load"] = load
    tables["excitation"].setdefault("knot_spacing", scene.excitation.knot_spacing)
    resistor = Scene.from_tables(tables, name=scene.name, origin=scene.name)
    long = resistor.replace(
        {
            "run.seed": scene.run.seed + 1,
            "run.duration": CONTROL_LENGTH * scene.run.duration,
            "run.realizations": CONTROL_REALIZATIONS,
        }
    )
    cut = Realizations.of(resistor, "monte-carlo")
    return Control(cut, Realizations(long, "monte-carlo", "default", size=1))
