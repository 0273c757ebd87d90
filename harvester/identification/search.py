"""The fit from several starts: short windows first, then longer ones from the best."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from harvester.identification.linear_start import starts_from
from harvester.identification.reconstruction import frequencies
from harvester.identification.shooting import Fit, Shooting
from harvester.identification.window_states import (
    measured_motion,
    placed,
    reach_of,
    repaired,
    states_of,
)
from harvester.identification.windows import (
    LARGEST_GROWTH,
    equal_windows,
    lengthened,
    shortened,
)

if TYPE_CHECKING:
    from harvester.identification.measurement import Measurement
    from harvester.identification.response import Responses
    from harvester.identification.unknowns import Unknown

SHORT_PERIODS = 2.0
# Iterations with short windows, at each length, and at the end.
FIRST, ON_THE_WAY, LAST = 12, 6, 40
# Relative fall of the cost below which a fit is done, on the way and at its end.
COARSE, FINE = 1e-3, 1e-6
# Share of an output's rms that its noise is taken for at first.
FIRST_NOISE = 0.05
MOST_FIRST_WINDOWS = 2000
# Mean square of a window's residuals over that of the others from which on its start is in doubt.
DOUBTFUL = 4.0
MENDINGS = 4
# Cost, over that of a model beside it, from which on a model is not worth following further.
HOPELESS = 1.25


def searched(
    responses: Responses, unknowns: Sequence[Unknown], lengths: Sequence[int]
) -> tuple[Shooting, Fit] | None:
    """The best fit; None where no start gives one.

    Parameters
    ----------
    responses : Responses
    unknowns : sequence of Unknown
    lengths : sequence of int
        Samples of each experiment, from its first, that are fitted to.
    """
    values = np.array([each.start for each in unknowns])
    best = None
    for start in starts_from(responses, values):
        tried = _short(responses, unknowns, start, lengths)
        if tried and (best is None or tried[1].cost < best[1].cost):
            best = tried
    if best is None:
        return None
    shooting, fit = best
    fit = followed(shooting, fit, lengths)
    return (shooting, fit) if fit.grams else None


def _short(responses, unknowns, start, lengths):
    """A fit with short windows."""
    sizes = [
        np.array([np.std(each.x), np.std(each.v), np.std(each.state)]) for each in start.motions
    ]
    sized = [each.begun(float(value)) for each, value in zip(unknowns, start.values, strict=True)]
    shooting = Shooting(responses, sized, sizes)
    edges, noise, begun = [], [], []
    for each, length, motion in zip(responses.experiments, lengths, start.motions, strict=True):
        cut = short_windows(each.measurement, 0, length)
        edges.append(cut)
        begun.append(states_of(motion, cut[:-1]))
        noise.append(
            np.array([FIRST_NOISE * np.std(values) for values in each.measurement.outputs.values()])
        )
    fit = repaired(shooting, Fit(start.values.copy(), edges, begun, noise))
    fit = shooting.minimized(fit, FIRST, COARSE)
    return (shooting, fit) if fit.grams else None


def followed(
    shooting: Shooting,
    fit: Fit,
    longest: Sequence[int],
    rival: float = np.inf,
) -> Fit:
    """Fit with windows that double in length while errors stay small in them, to the end.

    Longer windows do not make a fit better: one that is hopeless in short ones stays in them.

    Parameters
    ----------
    shooting : Shooting
    fit : Fit
        With short windows, linearized.
    longest : sequence of int
        Samples of each experiment.
    rival : float
        Cost of a model beside it.
    """
    fit = shooting.minimized(mended(shooting, fit), ON_THE_WAY, COARSE)
    most, hopeless = [int(np.diff(edges).max()) for edges in fit.edges], HOPELESS * rival
    while fit.cost < hopeless and any(m < n for m, n in zip(most, longest, strict=True)):
        most = [2 * m for m in most]
        longer = lengthened(fit, most)
        if longer is None:
            continue
        longer = shooting.minimized(longer, ON_THE_WAY, COARSE)
        if not longer.grams:
            break
        fit = shooting.minimized(mended(shooting, longer), ON_THE_WAY, COARSE)
    for _ in range(MENDINGS):
        hopeful = fit.grams and fit.cost < hopeless
        if not hopeful or not any(each.any() for each in _doubtful(fit)):
            break
        mending = shooting.minimized(mended(shooting, fit), ON_THE_WAY, COARSE)
        fit = mending if mending.grams else fit
    if not fit.cost < hopeless:
        return fit
    return shooting.minimized(shooting.reweighted(fit), ON_THE_WAY, FINE)


def settle_windows(shooting: Shooting, fit: Fit, stretches: Sequence[tuple[int, int]]) -> Fit:
    """Windows of other stretches and their starts, the device's values being as they are.

    Parameters
    ----------
    shooting : Shooting
        Without unknowns.
    fit : Fit
        Of the values and the noise.
    stretches : sequence of (int, int)
        First sample of each experiment, and that behind the last.
    """
    edges, begun = [], []
    for number, (first, last) in enumerate(stretches):
        measurement = shooting.responses.experiments[number].measurement
        cut = short_windows(measurement, first, last)
        seen = measured_motion(shooting, number, fit.values)
        edges.append(cut)
        begun.append(states_of(seen, cut[:-1]))
    reaches = [_visited(shooting, fit, number) for number in range(len(fit.edges))]
    begun_fit = Fit(fit.values, edges, begun, fit.noise)
    for number, reach in enumerate(reaches):
        seen = measured_motion(shooting, number, fit.values)
        begun_fit.starts[number], _ = placed(shooting, number, begun_fit, seen, reach)
    if not shooting.linearized(begun_fit):
        return begun_fit
    return followed(shooting, begun_fit, [last - first for first, last in stretches])


def _visited(shooting, fit, number):
    """Displacements between which the fitted motion stays."""
    states, _, _ = shooting.responses.states(
        number, fit.values, fit.edges[number], fit.starts[number]
    )
    return reach_of(states[:, 0])


def short_windows(measurement: Measurement, first: int, last: int) -> np.ndarray:
    """Edges of the shortest windows from one sample to another."""
    period = measurement.sampling_rate / frequencies(measurement)[0]
    width = max(SHORT_PERIODS * period, (last - first) / MOST_FIRST_WINDOWS)
    return first + equal_windows(last - first, width)


def opened(shooting: Shooting, fit: Fit) -> Fit:
    """The fit in the shortest windows, which begin on its own motion."""
    edges, starts = [], []
    for number, old in enumerate(fit.edges):
        states, _, _ = shooting.responses.states(number, fit.values, old, fit.starts[number])
        cut = short_windows(shooting.responses.experiments[number].measurement, old[0], old[-1])
        edges.append(cut)
        starts.append(states[cut[:-1] - old[0]])
    return Fit(fit.values, edges, starts, fit.noise)


def followed_anew(shooting: Shooting, begun: Fit, rival: float) -> Fit | None:
    """A fit that begins in short windows, to the end; None where no motion follows."""
    fit = shooting.minimized(begun, ON_THE_WAY, COARSE)
    if fit.grams:
        longest = [int(edges[-1] - edges[0]) for edges in fit.edges]
        fit = followed(shooting, fit, longest, rival=rival)
    return fit if fit.grams else None


def mended(shooting: Shooting, fit: Fit) -> Fit:
    """The fit with better starts of windows in doubt, or with those cut in half.

    Windows in which an error at the start grows beyond what is allowed are cut, too.
    """
    doubtful = _doubtful(fit)
    if any(each.any() for each in doubtful):
        better = repaired(shooting, fit)
        if not shooting.linearized(better):
            return fit
        fit, doubtful = better, _doubtful(better)
    wild = [growth > 2.0 * LARGEST_GROWTH for growth in fit.growth]
    cut = [a | b for a, b in zip(doubtful, wild, strict=True)]
    if any(each.any() for each in cut):
        fit = shortened(shooting, fit, cut)
    return fit


def _doubtful(fit):
    """Windows whose residuals are far beyond those of the others."""
    found = []
    for grams, edges in zip(fit.grams, fit.edges, strict=True):
        mean_squares = grams[:, -1, -1] / np.diff(edges)
        found.append(mean_squares > DOUBTFUL * np.median(mean_squares))
    return found
