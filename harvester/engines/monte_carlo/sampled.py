"""States of a device at the samples of a measured excitation, in windows with separate starts.

The steps are chosen as in Monte Carlo: on the samples, on the beginnings and ends of contacts, and
resolving a contact more finely.
"""

from __future__ import annotations

import numpy as np

from harvester.base.compilation import compiled
from harvester.device import contact, system
from harvester.device.schemes import one_step, scheme_of
from harvester.device.system import System
from harvester.device.zones import crossing, overshoots

# Steps per contact, four times as many as in Monte Carlo: an error in the time of contact would
# bias the identified values of a stopper.
STEPS_PER_CONTACT = 120
# A trial device whose scaled displacement, velocity or voltage exceeds this has diverged.
LARGEST_STATE = 1e9


def states_at_samples(
    s: System,
    eta: np.ndarray,
    spacing: float,
    every: int,
    edges: np.ndarray,
    starts: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Integrate Eq. 4 through each window from its own start.

    Parameters
    ----------
    eta : ndarray, shape (every (n − 1) + 1,)
        The excitation at its knots, linear between them.
    spacing : float
        Time between knots (s).
    every : int
        Number of knots per sample.
    edges : ndarray of int, shape (windows + 1,)
        Samples at which windows begin, ascending, followed by the end of the last window.
    starts : ndarray, shape (windows, 3)
        X, X' and the transducer's state at each window's first sample, scaled; a window with NaN is
        left out.

    Returns
    -------
    ndarray, shape (samples, 3)
        From the first window's first sample on; NaN after a solution has diverged.
    ndarray, shape (windows, 3)
        State at the first sample after each window; at the record's end at its last sample.
    """
    states = np.full((edges[-1] - edges[0], 3), np.nan)
    ends = np.full((edges.size - 1, 3), np.nan)
    zones = np.array(contact.edges(s.contacts))
    scheme = scheme_of(s, "runge-kutta", spacing)
    _run(scheme.argument, s, zones, eta, spacing, every, edges, starts, states, ends)
    return states, ends


# Python's lock is released, so that the columns of a Jacobian are integrated in parallel.
@compiled(nogil=True)
def _run(scheme, s, zones, eta, spacing, every, edges, starts, states, ends):
    """Integrate each window: fill `states` at the samples and `ends` at the windows' ends."""
    final = eta.size - 1
    for window in range(edges.size - 1):
        x, v, voltage = starts[window, 0], starts[window, 1], starts[window, 2]
        if np.isnan(x + v + voltage):
            continue
        held, phase = abs(v), 0.0
        zone = 0
        for edge in zones[1:-1]:
            if x > edge or (x == edge and edge < 0.0):
                zone += 1
        low, high = zones[zone], zones[zone + 1]
        touching = not low < 0.0 < high
        knot, stop = edges[window] * every, min(edges[window + 1] * every, final)
        sample = edges[window] - edges[0]
        states[sample, 0], states[sample, 1], states[sample, 2] = x, v, voltage
        while knot < stop:
            slope = (eta[knot + 1] - eta[knot]) / spacing
            noise = eta[knot] + slope * phase
            length = spacing - phase
            x1, v1, voltage1 = x, v, voltage
            smooth = not touching
            if smooth:
                x1, v1, voltage1 = one_step(
                    scheme, s, False, low, high, 0.0, x, v, voltage, noise, slope, length, 0.0
                )
                smooth = low <= x1 <= high and not (
                    v * v1 < 0.0 and overshoots(low, high, x, v, x1, v1, length)
                )
            if smooth:
                x, v, voltage, phase = x1, v1, voltage1, spacing
            else:
                piece, entered, held, x, v, voltage = _contact_piece(
                    scheme, s, touching, low, high, held, x, v, voltage, noise, slope, length,
                    STEPS_PER_CONTACT,
                )  # fmt: skip
                if entered != 0:
                    zone += entered
                    low, high = zones[zone], zones[zone + 1]
                    touching = not low < 0.0 < high
                phase = spacing if piece >= length else phase + piece
            if not abs(x) + abs(v) * spacing + abs(voltage) < LARGEST_STATE:
                break
            if phase > spacing * (1.0 - 1e-9):
                phase = 0.0
                knot += 1
                if knot % every == 0 and knot < edges[window + 1] * every:
                    sample = knot // every - edges[0]
                    states[sample, 0], states[sample, 1], states[sample, 2] = x, v, voltage
        if knot >= stop:
            ends[window, 0], ends[window, 1], ends[window, 2] = x, v, voltage


@compiled
def _contact_piece(
    scheme, s, touching, low, high, held, x, v, voltage, noise, slope, longest, steps_per_contact
):
    """Take a step within a zone, or up to the zone's edge `low` or `high`.

    Returns its length, by how many zones the mass has moved (−1, 0, 1), the held speed and the
    new state.
    """
    length = longest
    if touching:
        # The other forces press a mass at rest into the stopper.
        speed = abs(v) + abs(system.push(s, x, v, voltage, noise)) * longest
        length = contact.step(s.contacts, x, speed * speed, longest, steps_per_contact)
    reaction = system.contact_force(s, x, v, held, low, high) if touching else 0.0
    x1, v1, voltage1 = one_step(
        scheme, s, touching, low, high, held, x, v, voltage, noise, slope, length, reaction
    )
    entered = 0
    if x1 > high or x1 < low:
        entered = 1 if x1 > high else -1
    elif v * v1 < 0.0 and overshoots(low, high, x, v, x1, v1, length):
        entered = 1 if v > 0.0 else -1
    if entered != 0:
        edge = high if entered == 1 else low
        length = crossing(edge, entered, x, v, x1, v1, length)
        x1, v1, voltage1 = one_step(
            scheme, s, touching, low, high, held, x, v, voltage, noise, slope, length, reaction
        )
        if not touching:
            held = abs(v1)
    return length, entered, held, x1, v1, voltage1
