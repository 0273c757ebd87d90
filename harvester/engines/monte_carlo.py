"""Monte Carlo reference: the equations themselves on the given noise path, no ngspice.

A resistor as load: Runge–Kutta of fourth order, here. A netlist: `circuits.kernel`.

Steps land on the noise's knots and on the moments at which a contact begins or ends, so that
the scheme keeps its order where the force is smooth; in contact the step resolves the contact
time. One order remains at the first step of a contact, where the force starts as d^1.5.

A damper or a load that decays within a step takes a scheme of third order with that decay exact.
Heun's scheme of second order takes the same steps; it is there for work-precision diagrams.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.compilation import compiled, numba
from harvester.device import contact, system
from harvester.engines import circuit
from harvester.engines.schemes import one_step
from harvester.engines.steps import (
    STEPS_PER_CONTACT,
    knot_blocks,
    steps_per_contact,
    steps_per_knot,
    stop_time,
)
from harvester.engines.zones import crossing, overshoots
from harvester.errors import LoadError, SolutionDiverged
from harvester.record.record import empty_record, fill, part
from harvester.scene.units import require_mass, scale

if TYPE_CHECKING:
    from harvester.device.system import System
    from harvester.engines.realization import Reporter
    from harvester.excitation.ornstein_uhlenbeck import NoisePath
    from harvester.record.moments import Moments
    from harvester.record.record import Record
    from harvester.scene.model import Scene

CHUNK = 4096
# Decay of V or X' by load or damper, as an exponent, in a step of an explicit scheme: those are
# stable up to 2 (Heun) and 2.78 (Runge–Kutta). Beyond it the decay is taken exactly.
LARGEST_DECAY = 1.0
SCHEMES = {"runge-kutta": "Runge-Kutta 4", "heun": "Heun 2"}
EXACT_DECAY = "exact decay, order 3"

# Places in the state vector.
TIME, DISPLACEMENT, VELOCITY, TRANSDUCER, HELD_SPEED, ZONE, PHASE = range(7)


def check(scene: Scene) -> None:
    """Refuse what Monte Carlo does not take: a motion prescribed, some elements of a load.

    Raises
    ------
    LoadError
    """
    require_mass(scene, "Monte Carlo")
    if not scene.load.is_resistor:
        circuit.check_compiled(scene)


def prepare(scene: Scene) -> None:
    """Load the compiled code for a scene's parts, so that it does not count as simulation."""
    if not scene.load.is_resistor:
        circuit.prepare_compiled(scene)
        return
    s, _ = scale(scene)
    record = empty_record(1)
    state = initial_state(s, (0.0, 0.0, 0.0))
    edges = np.array(contact.edges(s.contacts))
    _advance(s, edges, np.zeros(2), 0, 0, 0, 1.0, 1, 1, None, state, record)


def run_realizations(
    scene: Scene,
    paths: list[NoisePath],
    starts: list[tuple[float, float, float]],
    observers: list[list[Reporter | Moments]],
    step: str | float,
    source: str,
    scheme: str = "runge-kutta",
    tolerance: float | None = None,
    device: str | None = None,
    outputs: Any = None,
) -> dict[str, str | None]:
    """Integrate realizations one by one; see `circuits.ngspice.engine.run_realizations`.

    `scheme` is "runge-kutta" or "heun", for a resistor as load. `source`, `tolerance` and `device`
    are not used: the path is taken as it is, in fixed steps or those that a netlist needs.

    Returns
    -------
    dict
        engine_version, netlist_sha256 (None).

    Raises
    ------
    SolutionDiverged
    LoadError
        Heun's scheme is asked for and the load is a netlist.
    """
    if not scene.load.is_resistor:
        if scheme != "runge-kutta":
            raise LoadError(
                f"{scene.name}: --scheme {scheme} is for a resistor as load; leave it out"
            )
        return circuit.run_compiled(scene, paths, starts, observers, step, outputs)
    s, _ = scale(scene)
    fixed = steps_per_knot(scene, step, "monte-carlo")
    in_contact = steps_per_contact(scene, step, "monte-carlo")
    for path, start, watching in zip(paths, starts, observers, strict=True):
        state = initial_state(s, start)
        for record in integrate(s, path, state, stop_time(scene), fixed, scheme, in_contact):
            if not np.isfinite(state).all():
                raise SolutionDiverged(
                    f"Monte Carlo left the finite numbers before t = {state[TIME]:g}; "
                    "choose a shorter --step"
                )
            for observer in watching:
                observer.add(record)
    exact = scheme_of(s, scheme, paths[0].spacing / fixed) is False
    return {
        "engine_version": f"{EXACT_DECAY if exact else SCHEMES[scheme]}, numba {numba.__version__}",
        "netlist_sha256": None,
    }


def initial_state(s: System, start: tuple[float, float, float]) -> np.ndarray:
    """The state of the integrator at the beginning: float64 of shape (7,).

    Parameters
    ----------
    s : harvester.device.system.System
    start : (float, float, float)
        X, X' and the transducer's state, scaled.
    """
    state = np.zeros(7)
    state[DISPLACEMENT], state[VELOCITY], state[TRANSDUCER] = start
    state[HELD_SPEED] = system.speed_held(s, state[DISPLACEMENT], state[VELOCITY])
    inner = contact.edges(s.contacts)[1:-1]
    x = state[DISPLACEMENT]
    state[ZONE] = sum(x > edge if edge > 0.0 else x >= edge for edge in inner)
    return state


def integrate(
    s: System,
    path: NoisePath,
    state: np.ndarray,
    stop: float,
    steps_per_knot: int = 1,
    scheme: str = "runge-kutta",
    steps_per_contact: int = STEPS_PER_CONTACT,
) -> Iterator[Record]:
    """Integrate Eq. 4 along a noise path.

    Parameters
    ----------
    s : harvester.device.system.System
    path : harvester.excitation.NoisePath
    state : ndarray, shape (7,)
        From `initial_state`; changed in place.
    stop : float
        End time (s), rounded up to a whole number of knots.
    steps_per_knot : int
        Steps between two knots where no contact asks for more.
    scheme : str
        A name in `SCHEMES`.
    steps_per_contact : int
        Fewest steps from the beginning of a contact to its end.

    Yields
    ------
    Record
        Chunks of accepted points in order, without the initial one; overwritten by the next.
    """
    edges = np.array(contact.edges(s.contacts))
    heun = scheme_of(s, scheme, path.spacing / steps_per_knot)
    record = empty_record(CHUNK)
    for done, block in knot_blocks(path, stop, CHUNK):
        segment, count = 0, block.size - 1
        while segment < count:
            segment, points = _advance(
                s,
                edges,
                block,
                segment,
                count,
                done,
                path.spacing,
                steps_per_knot,
                steps_per_contact,
                heun,
                state,
                record,
            )
            yield part(record, 0, points)


def scheme_of(s: System, name: str, step: float) -> bool | None:
    """None for Runge–Kutta, True for Heun, False for exact decay where it is faster than a step."""
    damping = s.damper.damping + s.transducer.damping()
    if max(s.transducer.decay_rate(), damping) * step > LARGEST_DECAY:
        return False
    return None if name == "runge-kutta" else True


@compiled
def _advance(
    s,
    edges,
    block,
    segment,
    count,
    first_knot,
    spacing,
    steps_per_knot,
    steps_per_contact,
    heun,
    state,
    record,
):
    """Fill the record from `segment` on; returns the segment reached and the points written.

    `edges` are those of the zones. The state's phase is the time since the segment's first knot.
    """
    step = spacing / steps_per_knot
    points = 0
    capacity = record.time.size
    x, v, voltage = state[DISPLACEMENT], state[VELOCITY], state[TRANSDUCER]
    held, zone, phase = state[HELD_SPEED], int(state[ZONE]), state[PHASE]
    low, high = edges[zone], edges[zone + 1]
    touching = not low < 0.0 < high
    free = np.searchsorted(edges, 0.0)
    left, right = edges[free - 1], edges[free]
    while segment < count and points < capacity:
        slope = (block[segment + 1] - block[segment]) / spacing
        noise = block[segment] + slope * phase
        end = spacing
        if steps_per_knot > 1:
            end = (np.floor(phase / step + 1e-9) + 1.0) * step
        length = end - phase
        x1, v1, voltage1 = x, v, voltage
        smooth = not touching
        if smooth:
            x1, v1, voltage1 = one_step(
                heun, s, False, low, high, 0.0, x, v, voltage, noise, slope, length
            )
            smooth = low <= x1 <= high and not (
                v * v1 < 0.0 and overshoots(low, high, x, v, x1, v1, length)
            )
        if smooth:
            x, v, voltage, phase = x1, v1, voltage1, end
        else:
            piece, entered, held, x, v, voltage = contact_piece(
                heun,
                s,
                touching,
                low,
                high,
                held,
                x,
                v,
                voltage,
                noise,
                slope,
                length,
                steps_per_contact,
            )
            if entered != 0:
                zone += entered
                low, high = edges[zone], edges[zone + 1]
                touching = not low < 0.0 < high
            phase = end if piece >= length else phase + piece
        noise = block[segment] + slope * phase
        if phase > spacing * (1.0 - 1e-9):
            phase = 0.0
            segment += 1
            noise = block[segment]
        time = (first_knot + segment) * spacing + phase
        loss = system.loss_power(s, x, v, held, x < left or x > right)
        terminal = system.terminal_voltage(s.transducer, v, voltage)
        current = system.load_current(s.transducer, v, voltage)
        own = system.own_loss(s.transducer, v, voltage, current)
        power = system.load_power(s.transducer, v, voltage)
        fill(record, points, time, x, v, terminal, power, noise * v, loss, own, voltage)
        points += 1
    state[TIME] = (first_knot + segment) * spacing + phase
    state[DISPLACEMENT], state[VELOCITY], state[TRANSDUCER] = x, v, voltage
    state[HELD_SPEED], state[ZONE], state[PHASE] = held, zone, phase
    return segment, points


@compiled
def contact_piece(
    heun: bool | None,
    s: System,
    touching: bool,
    low: float,
    high: float,
    held: float,
    x: float,
    v: float,
    voltage: float,
    noise: float,
    slope: float,
    longest: float,
    steps_per_contact: int,
) -> tuple[float, int, float, float, float, float]:
    """A step within a zone, or up to its edge, `low` or `high`.

    Returns its length, by how many zones the mass has moved (−1, 0, 1), the held speed and the
    new state.
    """
    length = longest
    if touching:
        # A mass at rest on the stopper is pressed in by what else acts.
        speed = abs(v) + abs(system.push(s, x, v, voltage, noise)) * longest
        length = contact.step(s.contacts, x, speed * speed, longest, steps_per_contact)
    x1, v1, voltage1 = one_step(
        heun, s, touching, low, high, held, x, v, voltage, noise, slope, length
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
            heun, s, touching, low, high, held, x, v, voltage, noise, slope, length
        )
        if not touching:
            held = abs(v1)
    return length, entered, held, x1, v1, voltage1
