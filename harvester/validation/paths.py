"""Single paths of a scene at the knots of its noise, computed in a worker process."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from harvester.engines.methods import engine_of
from harvester.engines.realization import Realization, noise_path, run
from harvester.scene.prepared import Prepared
from harvester.scene.steps import knot_spacing, steps_per_sample
from harvester.validation import STATES


def longest_step(model: Prepared, step: str | float, engine: str) -> float:
    """Longest step of an engine (s)."""
    return knot_spacing(model) / steps_per_sample(model, step, engine)


def knot_times(model: Prepared) -> np.ndarray:
    """Times of the knots 1, 2, … of a run without settling (s)."""
    spacing = knot_spacing(model)
    return spacing * np.arange(1, round(model.scene.run.duration / spacing) + 1)


def noise_at_knots(model: Prepared, index: int) -> np.ndarray:
    """The noise of one realization at the knots 0, 1, 2, …, scaled."""
    return noise_path(model, index).read(knot_times(model).size + 1)


def from_rest(model: Prepared, knots: int, realizations: int) -> Prepared:
    """The prepared scene from rest for a number of noise knots, without settling."""
    spacing = knot_spacing(model)
    changes = {
        "run.duration": knots * spacing,
        "run.settle": 0.0,
        "run.realizations": realizations,
        "excitation.knot_spacing": spacing,
    }
    return model.replace(changes)


def recorded(
    model: Prepared, engine: str, indices: Sequence[int], step: str | float, **options: Any
) -> list[Realization]:
    """Simulate some realizations with their whole waveforms.

    Parameters
    ----------
    **options
        Options of `harvester.simulate` that define the engine.
    """
    window = (0.0, 2.0 * model.scene.run.duration)
    return run(model, engine_of(engine, step=step, **options), indices, window, ignore)


def states_at_knots(model: Prepared, realizations: Sequence[Realization]) -> np.ndarray:
    """States at the knots, which are points of every engine, scaled.

    Returns
    -------
    ndarray, shape (realizations, knots, 3)
        States in the order of `STATES`.
    """
    times = knot_times(model)
    waveforms: Any = [realization.waveform for realization in realizations]
    states = [
        [np.interp(times, waveform.time, getattr(waveform, name)) for name in STATES]
        for waveform in waveforms
    ]
    return np.array(states).transpose(0, 2, 1)


def ignore(moments: object) -> None:
    """A progress callback that ignores its arguments."""
