"""Steps and knots: how finely an engine resolves a scene's motion, noise and contacts."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from circuits.netlist.load_watch import may_jump
from harvester.base.errors import HarvesterError, SceneError
from harvester.device import timescales
from harvester.excitation.ornstein_uhlenbeck import KNOTS_PER_CORRELATION_TIME, OrnsteinUhlenbeck
from harvester.scene import lines
from harvester.scene.passband import misplacement
from harvester.scene.prepared import Prepared, prepared
from harvester.scene.stepped_response import steady_error
from harvester.scene.units import longest_spacing

if TYPE_CHECKING:
    from harvester.excitation.base import ExcitationPath
    from harvester.scene.model import Scene

# Steps per period of the fastest oscillation. The trapezoidal rule is of order two, Runge–Kutta of
# order four; as `accuracy` shows, each then biases the means by less than 1 %.
STEPS_PER_PERIOD = {"circuit": 80, "monte-carlo": 40}
# Fewest steps from the beginning of a contact to its end, at the default step and longer ones.
STEPS_PER_CONTACT = 30
# Fewest steps per contact of Runge–Kutta. Between two knots they are equal, and 26 equal steps are
# as accurate as 30 others.
EVEN_STEPS_PER_CONTACT = 26
# Steps by name, as divisions of the default one.
STEP_LEVELS = {"default": 1, "fine": 4, "finest": 32}
# Relative error of a frequency ω, constant · (ω h)^order, of Runge–Kutta, TR-BDF2 and the
# trapezoidal rule where they are not made exact at a line. It follows from their stability
# functions.
FREQUENCY_ERRORS = {
    "runge-kutta": (1.0 / 120.0, 4),
    "monte-carlo": (0.0404, 2),
    "circuit": (1.0 / 12.0, 2),
}
# Relative error of a load's power over the frequency's. It was at most 4 with bridges and
# doublers. In Monte Carlo SSHI cost 0.16 %, five times as much. In the circuit it cost up to 0.8 %
# at 80 steps a period, and a twentieth of that at steps four times shorter.
LOAD_ERRORS, SWITCHED_LOAD_ERRORS = 4.0, 16.0
# Relative error of a power with contacts, times the square of the steps per contact. One stopper
# under noise cost 0.04 to 0.07 % at 26 steps, and a sixteenth of that at 104.
CONTACT_ERROR = 0.7
# A netlist's power below this share of the apparent power ω C V² is a small difference of large
# ones: steps cost it more, by the root of how far it is below. A doubler off its resonance at 1/130
# of it was wrong by five times the usual error, at 1/26 by three times.
FAINT_SHARE = 0.2
# Steps become finer for a line by at most this factor.
FINER_NEAR_LINES = 3.0
# Share of a power that default steps may cost by misplaced frequencies of noise and records. A band
# at five to ten times the resonance cost the circuit 5 % at the steps of the resonance.
NOISE_ERROR = 0.005
# Below this share the error at the resonance itself is used.
NOTED_ERROR = 0.0005
# A run that needs more than 6 s of processor time for less than a thousandth of its longest step is
# given up: it would not end.
PATIENCE, CRAWL = 6.0, 1e-3
STALLED = f"it stalls: {PATIENCE:g} s of work went into less than a thousandth of a step"
# A run whose load passes this voltage (V, or scaled) is given up: the load feeds energy in, and its
# growth would take ever shorter steps.
LARGEST_VOLTAGE = 1e9
RUNAWAY = (
    f"the load's voltage grows beyond {LARGEST_VOLTAGE:g} V, since the load feeds energy in; take "
    "sources, negative parts and gains that feed back out of its netlist"
)
# Shortest step in units of the knot spacing; a run with shorter steps would not end.
SHORTEST_STEP = 1e-9
# If ngspice controls the local error, it rejects steps, and takes one of first order after each
# rejection. With steps divided by 4 that costs the motion less than 0.1 % of its energy; undivided
# it costs 1 %.
REJECTING_STEPS = 4
# If the load decays within a knot, Monte Carlo's scheme has order three, not four: steps are
# halved.
STEPS_OF_FAST_LOADS = 2
# Above this `timescales.base_share` a step is no longer than the decay time: two steps for 25 decay
# times cost 3 % of a power.
BASE_SHARE = 0.1
# If the damper acts within a knot, the velocity follows the straight lines of the noise. The mean
# of its square needs points between the knots; four steps reduce the loss by interpolation sixteen
# times.
STEPS_OF_SLAVED_VELOCITY = 4


def has_own_knots(scene: Scene) -> bool:
    """Whether the excitation itself fixes its knots, such as a record between smooth samples."""
    excitation: Any = scene.excitation
    smooth = getattr(excitation, "interpolation", "linear") == "smooth"
    return smooth or not hasattr(excitation, "knot_spacing")


def knot_spacing(ready: Prepared) -> float:
    """Spacing of the excitation's knots (s): the scene's, else what its kind chooses.

    Raises SceneError if the scene's own does not fit its noise, or the run is shorter than it.
    """
    scene, system = ready.scene, ready.system
    spacing, duration = scene.excitation.spacing(longest_spacing(system)), scene.run.duration
    if spacing > duration:
        explicit = getattr(scene.excitation, "knot_spacing", None) is not None
        name = "one knot_spacing" if explicit else "the time between two knots of the excitation"
        raise SceneError(
            f"{scene.name}: run.duration = {duration:g}: must be at least {name}, {spacing:.4g} s"
        )
    return spacing


def spacing_of(scene: Scene) -> float:
    """Spacing of the knots of a scene that is not prepared yet (s)."""
    return knot_spacing(prepared(scene))


def with_knots(scene: Scene) -> Scene:
    """The scene with its knot spacing made explicit, so that changed copies keep it and thus
    the same noise."""
    return scene.replace({"excitation.knot_spacing": spacing_of(scene)})


def resolving(scene: Scene) -> Scene:
    """The scene with knots close enough for its noise.

    Without this, a sweep over τ1 would keep the scene's spacing where τ1 needs a shorter one.
    """
    spacing = getattr(scene.excitation, "knot_spacing", None) or spacing_of(scene)
    if isinstance(scene.excitation, OrnsteinUhlenbeck):
        spacing = min(spacing, scene.excitation.correlation_time / KNOTS_PER_CORRELATION_TIME)
    return scene.replace({"excitation.knot_spacing": spacing})


def steps_per_sample(
    ready: Prepared, step: str | float = "default", engine: str = "circuit"
) -> int:
    """Steps of an engine between two samples of the noise, away from the stoppers.

    `step`: a name in `STEP_LEVELS`, or the longest step in s. `engine`: a key of
    `STEPS_PER_PERIOD`. Raises HarvesterError for a step so short that no run of it ends.
    """
    scene, system = ready.scene, ready.system
    spacing = knot_spacing(ready)
    if not isinstance(step, str):
        if step < SHORTEST_STEP * spacing:
            raise HarvesterError(
                f"step {step:g}: is less than {SHORTEST_STEP:g} of the {spacing:.3g} s between two "
                "knots of the noise; choose a longer one"
            )
        return max(1, math.ceil(spacing / step - 1e-9))
    if scene.excitation.prescribes_displacement:
        return STEP_LEVELS[step]
    load = scene.load.circuit
    longest = (
        2.0 * math.pi / timescales.fastest_angular_frequency(system) / STEPS_PER_PERIOD[engine]
    )
    longest = _near_lines(ready, engine, longest)
    error, order = _noise_error(ready, engine, longest)
    if error > NOISE_ERROR:
        longest *= (NOISE_ERROR / error) ** (1.0 / order)
    finer = REJECTING_STEPS if engine == "circuit" and load and may_jump(load) else 1
    decays = system.transducer.decay_rate() * spacing
    if engine == "monte-carlo" and decays > 1.0:
        based = timescales.base_share(system, spacing) > BASE_SHARE
        finer *= max(STEPS_OF_FAST_LOADS, math.ceil(decays) if based else 1)
    if system.damper.damping * spacing > 1.0:
        finer = max(finer, STEPS_OF_SLAVED_VELOCITY)
    return max(1, math.ceil(spacing / longest - 1e-9)) * STEP_LEVELS[step] * finer


def step_error(ready: Prepared, step: str | float = "default", engine: str = "circuit") -> float:
    """Share of a mean power that the steps may cost, from the methods' stability functions.

    For the linear device: the remaining shift of the resonance on its flank, where the power
    changes most, and a few times the frequency's own error for what the load does in a period, its
    switches included. Contacts add their own.

    `ready`, `step`, `engine`: see `steps_per_sample`.
    """
    scene, system = ready.scene, ready.system
    omega = lines.line_frequency(ready) or timescales.angular_frequency(system)
    period = scene.excitation.period
    if scene.excitation.prescribes_displacement and period is not None:
        omega = 2.0 * math.pi / period
    constant, order, left = _frequency_error(ready, engine)
    length = knot_spacing(ready) / steps_per_sample(ready, step, engine)
    error = constant * (omega * length) ** order
    if order == 4:
        # Runge–Kutta displaces the poles by (ω0 h)⁴/120, however slow the line is; overtones meet
        # the resonance of a stiffer well.
        error *= max(timescales.angular_frequency(system) / omega, 1.0) ** order
    # Without damping the resonance has no width, and the whole power may be missed.
    flank = left * error / max(lines.half_width(ready), error) if left > 0.0 else 0.0
    load = scene.load.circuit
    switched = load is not None and load.switches
    period_error = (SWITCHED_LOAD_ERRORS if switched else LOAD_ERRORS) * error
    if system.contacts:
        period_error += CONTACT_ERROR / steps_per_contact(ready, step, engine) ** 2
    misplaced, _ = _noise_error(ready, engine, length)
    if misplaced > NOTED_ERROR:
        period_error = max(period_error, misplaced)
    cost = flank + period_error
    if order == 4 and scene.excitation.lines and not scene.excitation.prescribes_displacement:
        # Samples of the base's charge and a decay within a step have separate errors.
        steps = steps_per_sample(ready, step, engine)
        cost = max(cost, steady_error(ready, knot_spacing(ready), steps))
    return cost


def susceptance(ready: Prepared) -> float:
    """Apparent power over the mean-square voltage (scaled) of a netlist under sines.

    0 for a resistor, and without sines.
    """
    omega, network = lines.line_frequency(ready), ready.network
    if ready.scene.load.is_resistor or not ready.scene.excitation.lines:
        return 0.0
    unit = network.power_unit * ready.scales.voltage**2
    return omega * network.reference_capacitance * unit


def faintness(apparent: float, power: float) -> float:
    """Factor by which steps cost a power more than `step_error`, from 1 on; see `FAINT_SHARE`."""
    return math.sqrt(max(FAINT_SHARE * apparent / power, 1.0)) if power > 0.0 else 1.0


def _noise_error(ready, engine, length):
    """Share of a power that steps of a length cost noise and records, and the error's order."""
    constant, order, _ = _frequency_error(ready, engine)
    if ready.scene.excitation.prescribes_displacement:
        return 0.0, order
    return constant * misplacement(ready, knot_spacing(ready), order) * length**order, order


def _frequency_error(ready, engine):
    """Constant and order of an integrator's error of frequency, and the share left near lines."""
    method = "runge-kutta" if engine == "monte-carlo" and ready.scene.load.is_resistor else engine
    left = lines.spread(ready)
    if method == "runge-kutta" and lines.line_frequency(ready) > 0.0:
        left = 1.0
    return *FREQUENCY_ERRORS[method], left


def _near_lines(ready, engine, longest):
    """Longest step that shifts a resonance little enough for an excitation with lines."""
    constant, order, left = _frequency_error(ready, engine)
    if left == 0.0:
        return longest
    omega = lines.line_frequency(ready)
    allowed = lines.SHARE_OF_HALF_WIDTH * lines.half_width(ready)
    if left * constant * (omega * longest) ** order <= allowed:
        return longest
    step = (allowed / (constant * left)) ** (1.0 / order) / omega
    return max(step, longest / FINER_NEAR_LINES)


def steps_per_contact(
    ready: Prepared, step: str | float = "default", engine: str = "circuit"
) -> int:
    """Fewest steps of an engine in a contact: a shorter step makes these as much shorter.

    `ready`, `step`, `engine`: see `steps_per_sample`.
    """
    even = engine == "monte-carlo" and ready.scene.load.is_resistor
    fewest = EVEN_STEPS_PER_CONTACT if even else STEPS_PER_CONTACT
    finer = steps_per_sample(ready, step, engine) / steps_per_sample(ready, engine=engine)
    return math.ceil(fewest * max(finer, 1.0))


def stop_time(ready: Prepared) -> float:
    """End of a realization: settle and duration, in whole knots (s)."""
    spacing = knot_spacing(ready)
    run = ready.scene.run
    total = run.settle + run.duration
    return math.ceil(total / spacing - 1e-9) * spacing


def knot_blocks(path: ExcitationPath, stop: float, most: int) -> Iterator[tuple[int, np.ndarray]]:
    """The noise from the beginning to the first knot at or after the end, in blocks.

    `stop`: end time (s). `most`: segments between knots in a block.

    Yields
    ------
    int, ndarray
        Number of the block's first knot, and the noise at its knots: one more than segments, the
        last of a block being the first of the next; overwritten by the next.
    """
    knots = int(np.ceil(stop / path.spacing - 1e-9))
    block = np.empty(most + 1)
    block[0] = path.read(1)[0]
    for first in range(0, knots, most):
        count = min(most, knots - first)
        block[1 : count + 1] = path.read(count)
        yield first, block[: count + 1]
        block[0] = block[count]
