"""Steps and noise samples: how finely an engine resolves motion, excitation and contacts."""

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
# order four. According to `accuracy` both change means by less than 1 % at these numbers.
STEPS_PER_PERIOD = {"circuit": 80, "monte-carlo": 40}
# Minimum number of steps in one contact, at the default step and longer ones.
STEPS_PER_CONTACT = 30
# The same minimum for Runge–Kutta, whose steps between two knots are equal: 26 equal steps are as
# accurate as 30 unequal ones.
EVEN_STEPS_PER_CONTACT = 26
# Named steps, as divisors of the default step.
STEP_LEVELS = {"default": 1, "fine": 4, "finest": 32}
# Relative error of a frequency ω, constant · (ω h)^order, of Runge–Kutta, TR-BDF2 and the
# trapezoidal rule, unless they are made exact at a line. It follows from their stability functions.
FREQUENCY_ERRORS = {
    "runge-kutta": (1.0 / 120.0, 4),
    "monte-carlo": (0.0404, 2),
    "circuit": (1.0 / 12.0, 2),
}
# Relative error of a load's power, in units of the frequency error. It was at most 4 for bridges
# and doublers. With SSHI the error was 0.16 % in Monte Carlo, five times as large. In the circuit
# it was up to 0.8 % at 80 steps per period, and a twentieth of this at four times shorter steps.
LOAD_ERRORS, SWITCHED_LOAD_ERRORS = 4.0, 16.0
# Relative error of a power with contacts, times the square of the steps per contact. For one
# stopper under noise the error was 0.04 to 0.07 % at 26 steps, and a sixteenth of that at 104.
CONTACT_ERROR = 0.7
# A netlist's power below this share of the apparent power ω C V² is a small difference of large
# powers. Its step error grows with the square root of the deficit. For a doubler off resonance the
# error was five times the usual one at 1/130 of the apparent power, and three times at 1/26.
FAINT_SHARE = 0.2
# Near lines, steps are shortened by at most this factor.
FINER_NEAR_LINES = 3.0
# Largest relative error of a power by the frequency shift of default steps under noise and records.
# With steps for the resonance, a band at five to ten times its frequency gave 5 % in the circuit.
NOISE_ERROR = 0.005
# An error under noise below this share is ignored; only the error at the resonance is then used.
NOTED_ERROR = 0.0005
# A run stops with an error if it needs more than 6 s of processor time for less than a thousandth
# of its longest step, since it would not end.
PATIENCE, CRAWL = 6.0, 1e-3
STALLED = f"it stalls: {PATIENCE:g} s of work went into less than a thousandth of a step"
# A run stops with an error if its load exceeds this voltage (V, or scaled): the load feeds energy
# in, and the growing voltage would need ever shorter steps.
LARGEST_VOLTAGE = 1e9
RUNAWAY = (
    f"the load's voltage grows beyond {LARGEST_VOLTAGE:g} V, since the load feeds energy in; "
    "remove sources, negative parts and gains with feedback from its netlist"
)
# Shortest step in units of the knot spacing; a run with shorter steps would not end.
SHORTEST_STEP = 1e-9
# If ngspice controls the local error, it rejects steps, and takes a first-order step after each
# rejection. Then the motion loses 1 % of its energy, or less than 0.1 % with steps divided by 4.
REJECTING_STEPS = 4
# If the load decays within a knot spacing, Monte Carlo's scheme has order three, not four, and
# steps are halved.
STEPS_OF_FAST_LOADS = 2
# Above this `timescales.base_share`, no step exceeds the decay time: with two steps for 25 decay
# times the error of a power was 3 %.
BASE_SHARE = 0.1
# If the damper acts within a knot spacing, the velocity follows the noise's linear interpolation.
# Its mean square needs points between the knots: four steps reduce the interpolation loss
# sixteenfold.
STEPS_OF_SLAVED_VELOCITY = 4


def fixes_knots(scene: Scene) -> bool:
    """Whether the excitation itself determines its knots, such as a record with smooth
    interpolation.
    """
    excitation: Any = scene.excitation
    smooth = getattr(excitation, "interpolation", "linear") == "smooth"
    return smooth or not hasattr(excitation, "knot_spacing")


def knot_spacing(prepared_scene: Prepared) -> float:
    """Spacing of the excitation's knots (s): the scene's, else the default of the excitation's
    kind.

    Raises SceneError if the scene's spacing does not suit its noise, or exceeds the run's duration.
    """
    scene, system = prepared_scene.scene, prepared_scene.system
    spacing, duration = scene.excitation.spacing(longest_spacing(system)), scene.run.duration
    if spacing > duration:
        explicit = getattr(scene.excitation, "knot_spacing", None) is not None
        name = "one knot_spacing" if explicit else "the time between two samples of the excitation"
        raise SceneError(
            f"{scene.name}: run.duration = {duration:g}: must be at least {name}, {spacing:.4g} s"
        )
    return spacing


def spacing_of(scene: Scene) -> float:
    """Spacing of the knots of a scene that is not yet prepared (s)."""
    return knot_spacing(prepared(scene))


def with_knots(scene: Scene) -> Scene:
    """The scene with explicit knot spacing, so that changed copies have the same noise."""
    return scene.replace({"excitation.knot_spacing": spacing_of(scene)})


def resolving(scene: Scene) -> Scene:
    """The scene with a knot spacing that resolves its noise.

    Otherwise a sweep over τ1 would keep the scene's spacing even if τ1 needs a shorter one.
    """
    spacing = getattr(scene.excitation, "knot_spacing", None) or spacing_of(scene)
    if isinstance(scene.excitation, OrnsteinUhlenbeck):
        spacing = min(spacing, scene.excitation.correlation_time / KNOTS_PER_CORRELATION_TIME)
    return scene.replace({"excitation.knot_spacing": spacing})


def steps_per_sample(
    prepared_scene: Prepared, step: str | float = "default", engine: str = "circuit"
) -> int:
    """Steps of an engine between two samples of the noise, outside contacts.

    `step`: a name in `STEP_LEVELS`, or the longest step in s. `engine`: a key of
    `STEPS_PER_PERIOD`. Raises HarvesterError if the step is too short for a run to end.
    """
    scene, system = prepared_scene.scene, prepared_scene.system
    spacing = knot_spacing(prepared_scene)
    if not isinstance(step, str):
        if step < SHORTEST_STEP * spacing:
            raise HarvesterError(
                f"step {step:g}: is less than {SHORTEST_STEP:g} of the {spacing:.3g} s between two "
                "samples of the noise; choose a longer one"
            )
        return max(1, math.ceil(spacing / step - 1e-9))
    if scene.excitation.prescribes_displacement:
        return STEP_LEVELS[step]
    load = scene.load.circuit
    longest = (
        2.0 * math.pi / timescales.fastest_angular_frequency(system) / STEPS_PER_PERIOD[engine]
    )
    longest = _near_lines(prepared_scene, engine, longest)
    error, order = _noise_error(prepared_scene, engine, longest)
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


def step_error(
    prepared_scene: Prepared, step: str | float = "default", engine: str = "circuit"
) -> float:
    """Relative error of a mean power due to the step, from the methods' stability functions.

    The error is a sum. The resonance's remaining shift counts on the flank of the resonance, where
    it changes the power most. A load and its switches add a multiple of the frequency error, and
    contacts their share.

    `prepared_scene`, `step`, `engine`: see `steps_per_sample`.
    """
    scene, system = prepared_scene.scene, prepared_scene.system
    omega = lines.line_frequency(prepared_scene) or timescales.angular_frequency(system)
    period = scene.excitation.period
    if scene.excitation.prescribes_displacement and period is not None:
        omega = 2.0 * math.pi / period
    constant, order, share = _frequency_error(prepared_scene, engine)
    length = knot_spacing(prepared_scene) / steps_per_sample(prepared_scene, step, engine)
    error = constant * (omega * length) ** order
    if order == 4:
        # Runge–Kutta shifts the poles by (ω0 h)⁴/120 even under a slow line, and overtones reach
        # the resonance of a stiffer well.
        error *= max(timescales.angular_frequency(system) / omega, 1.0) ** order
    # Without damping the resonance has no width, and the error may be as large as the power.
    flank = share * error / max(lines.half_width(prepared_scene), error) if share > 0.0 else 0.0
    load = scene.load.circuit
    switched = load is not None and load.switches
    period_error = (SWITCHED_LOAD_ERRORS if switched else LOAD_ERRORS) * error
    if system.contacts:
        period_error += CONTACT_ERROR / steps_per_contact(prepared_scene, step, engine) ** 2
    misplaced, _ = _noise_error(prepared_scene, engine, length)
    if misplaced > NOTED_ERROR:
        period_error = max(period_error, misplaced)
    cost = flank + period_error
    if order == 4 and scene.excitation.lines and not scene.excitation.prescribes_displacement:
        # The base's sampled charge and a decay within a step have separate errors.
        steps = steps_per_sample(prepared_scene, step, engine)
        cost = max(cost, steady_error(prepared_scene, knot_spacing(prepared_scene), steps))
    return cost


def susceptance(prepared_scene: Prepared) -> float:
    """Apparent power over the mean-square voltage (scaled) of a netlist under sines.

    Returns 0 for a resistor or without sines.
    """
    omega, network = lines.line_frequency(prepared_scene), prepared_scene.network
    if prepared_scene.scene.load.is_resistor or not prepared_scene.scene.excitation.lines:
        return 0.0
    unit = network.power_unit * prepared_scene.scales.voltage**2
    return omega * network.reference_capacitance * unit


def faintness(apparent: float, power: float) -> float:
    """Factor (≥ 1) by which the error of a power exceeds `step_error`; see `FAINT_SHARE`."""
    return math.sqrt(max(FAINT_SHARE * apparent / power, 1.0)) if power > 0.0 else 1.0


def _noise_error(prepared_scene, engine, length):
    """Relative error of a power by steps of `length` under noise and records, and the error's
    order.
    """
    constant, order, _ = _frequency_error(prepared_scene, engine)
    if prepared_scene.scene.excitation.prescribes_displacement:
        return 0.0, order
    return constant * misplacement(
        prepared_scene, knot_spacing(prepared_scene), order
    ) * length**order, order


def _frequency_error(prepared_scene, engine):
    """Constant and order of an integrator's frequency error, and its remaining share near lines."""
    method = (
        "runge-kutta"
        if engine == "monte-carlo" and prepared_scene.scene.load.is_resistor
        else engine
    )
    share = lines.spread(prepared_scene)
    if method == "runge-kutta" and lines.line_frequency(prepared_scene) > 0.0:
        share = 1.0
    return *FREQUENCY_ERRORS[method], share


def _near_lines(prepared_scene, engine, longest):
    """Longest step whose shift of the resonance is acceptable for an excitation with lines."""
    constant, order, share = _frequency_error(prepared_scene, engine)
    if share == 0.0:
        return longest
    omega = lines.line_frequency(prepared_scene)
    allowed = lines.SHARE_OF_HALF_WIDTH * lines.half_width(prepared_scene)
    if share * constant * (omega * longest) ** order <= allowed:
        return longest
    step = (allowed / (constant * share)) ** (1.0 / order) / omega
    return max(step, longest / FINER_NEAR_LINES)


def steps_per_contact(
    prepared_scene: Prepared, step: str | float = "default", engine: str = "circuit"
) -> int:
    """Minimum number of an engine's steps in a contact; it grows as steps become shorter.

    `prepared_scene`, `step`, `engine`: see `steps_per_sample`.
    """
    even = engine == "monte-carlo" and prepared_scene.scene.load.is_resistor
    fewest = EVEN_STEPS_PER_CONTACT if even else STEPS_PER_CONTACT
    finer = steps_per_sample(prepared_scene, step, engine) / steps_per_sample(
        prepared_scene, engine=engine
    )
    return math.ceil(fewest * max(finer, 1.0))


def stop_time(prepared_scene: Prepared) -> float:
    """End time of a realization: settle and duration, in whole knot spacings (s)."""
    spacing = knot_spacing(prepared_scene)
    run = prepared_scene.scene.run
    total = run.settle + run.duration
    return math.ceil(total / spacing - 1e-9) * spacing


def knot_blocks(path: ExcitationPath, stop: float, most: int) -> Iterator[tuple[int, np.ndarray]]:
    """The noise from the beginning to the first knot at or after the end, in blocks.

    `stop`: end time (s). `most`: maximum number of segments between knots in a block.

    Yields
    ------
    int, ndarray
        Number of the block's first knot, and the noise at its knots. The last knot of a block is
        the first of the next. The next block overwrites the array.
    """
    knots = int(np.ceil(stop / path.spacing - 1e-9))
    block = np.empty(most + 1)
    block[0] = path.read(1)[0]
    for first in range(0, knots, most):
        count = min(most, knots - first)
        block[1 : count + 1] = path.read(count)
        yield first, block[: count + 1]
        block[0] = block[count]
