"""Monte Carlo reference: direct integration along a given noise path, without ngspice.

For a resistor as load, by Runge–Kutta of fourth order; `circuits.kernel` takes netlists.

Steps land on the noise's knots and on the moments at which a contact begins or ends, so that the
scheme keeps its order where the force is smooth; in contact the step resolves the contact time. The
first step of a contact is of first order, since the force starts as d^1.5. Realizations are
integrated in lockstep (`harvester.engines.monte_carlo.lockstep`).

If a damper or load decays within a step, a third-order scheme integrates that decay exactly. Heun's
second-order scheme takes the same steps, for work-precision diagrams.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from harvester.base import compilation
from harvester.base.errors import SolutionDiverged
from harvester.device import contact
from harvester.device.record import Observer, Record
from harvester.device.schemes import Scheme, scheme_of
from harvester.device.system import System
from harvester.engines.monte_carlo.lockstep import BatchWorkspace, advance
from harvester.excitation.base import ExcitationPath
from harvester.scene.prepared import Prepared
from harvester.scene.steps import (
    EVEN_STEPS_PER_CONTACT,
    steps_per_contact,
    steps_per_sample,
    stop_time,
)
from harvester.statistics.moments import Moments
from harvester.statistics.several import TOGETHER, SeveralMoments

# Number of realizations that are stepped together. Larger numbers are hardly faster.
MOST_TOGETHER = 64
# Segments between knots that are computed at a time, over all realizations. The noise and any kept
# points then fit into the processor's cache.
SEGMENTS, SEGMENTS_KEPT = 262144, 65536
NO_POINTS = Record(*np.empty((len(Record._fields), 0)))


def prepare(prepared_scene: Prepared) -> None:
    """Load the compiled code for a scene's parts, so that it does not count as simulation."""
    s = prepared_scene.system
    tally = SeveralMoments([_unwanted(0.0, 1.0)], 1.0).tally
    room, position = BatchWorkspace.of(s, [(0.0, 0.0, 0.0)], 0, 0), _beginning()
    noise = np.zeros((1, 1, TOGETHER))
    advance(Scheme.RUNGE_KUTTA.argument, s, _edges(s), noise, 0, 1.0, 1, 1, room, tally, position)


def run_realizations(
    engine: Any,
    prepared_scene: Prepared,
    paths: list[ExcitationPath],
    starts: list[tuple[float, float, float]],
    observers: list[list[Observer]],
    outputs: Any = None,
) -> dict[str, str | None]:
    """Integrate realizations in lockstep; see `harvester.engines.methods.Engine`.

    `outputs` is not used: a resistor has no output side.
    """
    s = prepared_scene.system
    fixed = steps_per_sample(prepared_scene, engine.step, "monte-carlo")
    in_contact = steps_per_contact(prepared_scene, engine.step, "monte-carlo")
    for first in range(0, len(paths), MOST_TOGETHER):
        some = slice(first, first + MOST_TOGETHER)
        moments = [
            observer
            for observer in itertools.chain(*observers[some])
            if isinstance(observer, Moments)
        ]
        others = [
            (k, observer)
            for k, watching in enumerate(observers[some])
            for observer in watching
            if not isinstance(observer, Moments)
        ]
        readers = [1 + k for k, observer in others if getattr(observer, "reads_points", True)]
        chunks = integrate(
            s, paths[some], starts[some], stop_time(prepared_scene), fixed, engine.scheme,
            in_contact, moments, max(readers, default=0),
        )  # fmt: skip
        for columns, points in chunks:
            for k, other in others:
                other.add(record_of(columns, points, k))
    chosen = scheme_of(s, engine.scheme, paths[0].spacing / fixed)
    return {
        "engine_version": f"{chosen.value}, numba {compilation.numba.__version__}",
        "netlist_sha256": None,
    }


def record_of(columns: np.ndarray, points: np.ndarray, k: int) -> Record:
    """The points of realization k in a chunk from `integrate`; empty if they are not kept."""
    return Record(*columns[k, :, : points[k]]) if k < len(columns) else NO_POINTS


def integrate(
    s: System,
    paths: Sequence[ExcitationPath],
    starts: Sequence[tuple[float, float, float]],
    stop: float,
    steps_per_sample: int = 1,
    scheme: str = "runge-kutta",
    steps_per_contact: int = EVEN_STEPS_PER_CONTACT,
    moments: Sequence[Moments] = (),
    keep: int | None = None,
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Integrate Eq. 4 along several noise paths in lockstep.

    Parameters
    ----------
    paths : sequence of harvester.excitation.base.ExcitationPath
        All with the same knot spacing.
    starts : sequence of (float, float, float)
        X, X' and the transducer's state, scaled.
    stop : float
        End time (s), rounded up to a whole number of knots.
    steps_per_sample, steps_per_contact : int
        Steps between two samples away from contacts; fewest steps in a contact.
    scheme : str
        A name in `harvester.device.schemes.NAMED`.
    moments : sequence of Moments
        One for each path, empty at first; points are added to them. Empty: none are recorded.
    keep : int or None
        The points of that many realizations are kept, of the first ones; None: of all.

    Yields
    ------
    ndarray, shape (keep, 9, ·)
        Accepted points in order, without the initial point: the columns of a `Record` for each
        path. The next chunk overwrites this array.
    ndarray of int64, shape (len(paths),)
        Number of points of each path.

    Raises
    ------
    SolutionDiverged
    """
    spacing, edges = paths[0].spacing, _edges(s)
    chosen = scheme_of(s, scheme, spacing / steps_per_sample)
    knots = math.ceil(stop / spacing - 1e-9)
    keep = len(paths) if keep is None else keep
    most = min(SEGMENTS // len(paths), SEGMENTS_KEPT // max(keep, 1))
    first_knots = [float(path.read(1)[0]) for path in paths]
    # If the base already moves at t = 0, it has already displaced charge.
    begun = [
        (x, v, state - s.transducer.kept_state(0.0, eta))
        for (x, v, state), eta in zip(starts, first_knots, strict=True)
    ]
    room, position = BatchWorkspace.of(s, begun, keep, _points(most)), _beginning()
    several = SeveralMoments(moments or [_unwanted(stop, spacing) for _ in paths], spacing)
    noise = np.zeros((most + 1, len(room.states), TOGETHER))
    samples = noise.reshape(most + 1, -1)
    samples[0, : len(paths)] = first_knots
    for first in range(0, knots, most):
        count = min(most, knots - first)
        for k, path in enumerate(paths):
            samples[1 : count + 1, k] = path.read(count)
        position[:3] = 0
        while position[0] < count:
            room.points[:] = 0
            advance(
                chosen.argument, s, edges, noise[: count + 1], first, spacing,
                steps_per_sample, steps_per_contact, room, several.tally, position,
            )  # fmt: skip
            several.collect(room.points)
            if several.diverged is not None:
                raise SolutionDiverged(
                    "Monte Carlo diverged (values that are not finite) before t = "
                    f"{several.diverged:g}; choose a shorter step"
                )
            yield room.columns, room.points
        noise[0] = noise[count]


def _beginning():
    """Initial position of `advance`: first segment and step, before the first batch."""
    return np.array([0, 0, 0, -1])


def _unwanted(stop, spacing):
    """A placeholder for moments that are not recorded."""
    return Moments.empty(0.0, stop, (-math.inf, math.inf), (), False, 1, 1, spacing)


def _points(segments):
    """Memory for points per realization: 1.5 per segment, in an odd number of cache lines."""
    return (segments * 3 // 32 * 2 + 1) * 8


def _edges(s):
    return np.array(contact.edges(s.contacts))
