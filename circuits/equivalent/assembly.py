"""Converts a scene to a PySpice circuit with only the elements that it needs."""

from __future__ import annotations

import hashlib
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from circuits.equivalent import compact_model, elements
from circuits.netlist import part_values
from circuits.netlist.elements import ramped
from circuits.netlist.expression import ExpressionError, check
from circuits.netlist.load_notes import check_turn
from circuits.netlist.load_watch import NOTHING as UNWATCHED
from circuits.netlist.load_watch import Watch, may_jump, watch_of
from circuits.netlist.measurement import NOTHING, Measurement, measurement_of
from circuits.netlist.source_schedule import SourceSchedule
from circuits.netlist.writer import run_text
from harvester.base.errors import NetlistError
from harvester.device import timescales
from harvester.device.system import held_impact_speed
from harvester.excitation.prescribed import PrescribedDisplacement
from harvester.scene.paths import start_state
from harvester.scene.steps import knot_spacing, steps_per_sample, stop_time

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from harvester.scene.prepared import Prepared

# Name of the device's sub-circuit: no sub-circuit of a load begins with a digit.
DEVICE = "0device"
# Options for externally prescribed steps: a tight Newton tolerance, and none for the local error
# (trtol).
FIXED_STEP = "reltol=1e-10 vntol=1e-11 trtol=1e9"
# ngspice's names of the integrators.
INTEGRATORS = {"trapezoidal": "trap", "gear": "gear"}
# Newton's tolerance with diodes. A diode that turns on needs many iterations; a failed step is
# repeated with an eighth of its length, where rounding of a large capacitor's current is eight
# times larger.
RECTIFIER_NEWTON = 1e-6
RECTIFIER_STEP = f"reltol={RECTIFIER_NEWTON!r} trtol=1e9 itl4=100"
# Switching loads have short steps, in which rounding of a large capacitor's current moves nodes
# with only stray capacitances. Newton's tolerance is ROUNDING_MARGIN times this rounding error, at
# least RECTIFIER_NEWTON and at most GREATEST_NEWTON.
ROUNDING_MARGIN, GREATEST_NEWTON = 10.0, 1e-4
# Tolerance of the local error for loads with jumps.
LOAD_TOLERANCE = 1e-5
# ngspice's default relative tolerance.
OWN_TOLERANCE = 1e-3
# Smallest charge (C) whose error counts in a self-oscillating load: a third of ngspice's
# default.
OWN_CHARGE = 3e-15
# Fewest steps of a run. ngspice 46 does not end a shorter one: its smallest step, 1e-11 of the
# longest, then exceeds its tolerance for the end time.
SHORTEST_RUN = 1000
# Length of ngspice's first steps as a share of the usual step: they are backward Euler, which takes
# energy from a moving mass. The printing interval is as long, since ngspice returns to first order
# at the end of that interval.
FIRST_ORDER_SHARE = 1e-3
# Voltages of the load below this share of one scaled volt do not shorten a step.
SMALL_VOLTAGE = 1e-3


def own_steps(tolerance: float) -> str:
    """Options for ngspice's step control by the local error with this relative tolerance."""
    return f"reltol={tolerance!r} trtol=7"


def step_options(
    ready: Prepared, step: str | float = "default", tolerance: float | None = None
) -> tuple[str, bool]:
    """Options for steps on a grid, and whether the local error shortens them.

    Parameters
    ----------
    ready : Prepared
    step : str or float
        See `harvester.scene.steps.steps_per_sample`.
    tolerance : float or None
        Relative tolerance of the local error. None: no control, except for loads with jumps, whose
        tolerance depends on `step`, since ngspice's trapezoidal steps grow as the tolerance's
        square root.
    """
    load = ready.scene.load.circuit
    if load is None or load.linear:
        return (own_steps(tolerance), True) if tolerance else (FIXED_STEP, False)
    if not load.switches and not tolerance:
        return RECTIFIER_STEP, False
    if not may_jump(load) and not tolerance:
        return f"reltol={_switched_newton(ready)!r} trtol=1e9 itl4=100", False
    refinement = steps_per_sample(ready, step) / steps_per_sample(ready)
    tolerance = tolerance or LOAD_TOLERANCE / refinement**2
    trust = 7.0 * tolerance / GREATEST_NEWTON
    return f"reltol={GREATEST_NEWTON!r} trtol={trust!r} itl4=100", True


def _switched_newton(ready):
    """Newton's tolerance for a load whose switches and coils set the steps."""
    load = ready.scene.load.circuit
    stray = elements.STRAY_SHARE * ready.network.reference_capacitance
    largest = max(
        (size for size, coil in watch_of(load, {pin: pin for pin in load.pins}).stores if not coil),
        default=0.0,
    )
    rounding = ROUNDING_MARGIN * sys.float_info.epsilon * largest / stray
    return min(max(rounding, RECTIFIER_NEWTON), GREATEST_NEWTON)


@dataclass(frozen=True)
class Netlist:
    """A complete netlist, with the units of its node voltages.

    Attributes
    ----------
    text : str
    rate : float
        ω: ratio of X' to the velocity node, and root of the ratio of η to the noise node (1/s).
    voltage_scale : float
        Volts per scaled volt.
    step : float
        Longest step (s).
    stop : float
        End of the evaluated time (s); the netlist may run longer.
    prefixes : tuple of str
        Prefixes of the nodes' names, one for each copy of the device.
    terminal : str
        Node that carries the transducer's terminal voltage.
    state : str
        ngspice's vector of the transducer's state; empty without one.
    state_unit : float
        Volts or amperes per scaled state.
    current_per_ampere : float
        The transducer's scaled current for one ampere at the load's ammeter, if it is used.
    per_power : float
        Scaled power per watt at the load's ammeter; 0 without one.
    conductance : float
        Conductance across the load's output (S).
    drives_current : bool
        Whether an inductance of the transducer carries the load's current.
    measurement : circuits.netlist.measurement.Measurement
        Measures of the load.
    watch : circuits.netlist.load_watch.Watch
        The load's unknowns that limit the step.
    watched_energy : (float, float)
        Twice the energy per squared terminal voltage (F), and twice the negligible energy (J).
    pace : float
        Pre-warping factor of the motion's time; the excitation must be divided by it.
    line : float
        Angular frequency at which shortened steps are also exact (rad/s); 0: none.
    schedule : circuits.netlist.source_schedule.SourceSchedule or None
        Sources and expressions of the load that depend on time alone.
    """

    text: str
    rate: float
    voltage_scale: float
    step: float
    stop: float
    prefixes: tuple = ("",)
    terminal: str = "piezo"
    state: str = "piezo"
    state_unit: float = 1.0
    current_per_ampere: float = 0.0
    per_power: float = 0.0
    conductance: float = 0.0
    drives_current: bool = False
    measurement: Measurement = NOTHING
    watch: Watch = UNWATCHED
    watched_energy: tuple[float, float] = (0.0, 0.0)
    pace: float = 1.0
    line: float = 0.0
    schedule: SourceSchedule | None = None

    @property
    def sha256(self) -> str:
        """Digest of the text."""
        return hashlib.sha256(self.text.encode()).hexdigest()


def assemble(
    ready: Prepared,
    step: str | float = "default",
    starts: Sequence[tuple[float, float, float]] | None = None,
    waveform: str = "external",
    options: str = FIXED_STEP,
    integrator: str = "trapezoidal",
    save: Iterable[str] = (),
    compiled: bool = False,
    line: float = 0.0,
    named: bool = False,
    ramp: float = 0.0,
) -> Netlist:
    """Build the equivalent circuit of a scene with PySpice.

    Parameters
    ----------
    ready : Prepared
    step : str or float
        See `harvester.scene.steps.steps_per_sample`.
    starts : sequence of (float, float, float) or None
        X, X' and transducer's state, scaled, of each copy of the device; None: one copy with the
        start of the first realization.
    waveform : str
        Waveform of the noise source: `external`, or a PWL.
    options : str
        ngspice's tolerances.
    integrator : str
        A name in `INTEGRATORS`.
    save : sequence of str
        Vectors that ngspice stores in memory; streamed ones are not stored.
    compiled : bool
        Whether mechanics and piezo are a compiled device; see `circuits.equivalent.compact_model`.
    line : float
        Angular frequency at which the motion is exact (rad/s); 0: none.
    named : bool
        Whether the load keeps its sub-circuits and parameter names, for readability, unless ngspice
        would misinterpret a name.
    ramp : float
        Time (s) in which the load's constant sources rise from 0.
    """
    from PySpice.Spice.Netlist import Circuit, SubCircuit

    scene, system, scales = ready.scene, ready.system, ready.scales
    rate = timescales.angular_frequency(system)
    length = knot_spacing(ready) / steps_per_sample(ready, step)
    pace = elements.trapezoidal_prewarp_factor(line * length)
    electrical = ready.network
    circuit = Circuit(f"harvester scene {scene.name}")
    starts = [
        _start(system, start, rate, electrical) for start in starts or [start_state(ready, 0)]
    ]
    load = scene.load.circuit
    if load:
        check_turn(load, length)
    slowed = line > 0.0 and load is not None and load.resistance is None

    def add_device(place, start):
        if isinstance(scene.excitation, PrescribedDisplacement):
            elements.add_prescribed_displacement(place, rate, scene.excitation, scales, electrical)
        elif compiled:
            compact_model.add_device(place, electrical)
        else:
            _add_mechanics(place, system, rate, length, start)
        parts = compact_model.left_out(electrical) if compiled else electrical.elements
        elements.add_transducer(place, parts, rate, scales, start[2], pace)
        if not scene.excitation.prescribes_displacement:
            elements.add_pace(place, rate, pace, start, slowed)
            elements.add_excitation(place, waveform, electrical)
        if load:
            elements.add_load(place, load, electrical, named and load.is_plain)
        else:
            # 1/λ in scaled scenes, whose capacitance is 1.
            table: Any = scene.load
            ohms = table.resistance or 1.0 / table.decay_rate
            elements.add_resistor(place, ohms, electrical)

    if len(starts) == 1:
        add_device(circuit, starts[0])
        prefixes: tuple[str, ...] = ("",)
    else:
        # Each copy has a separate start, and with held speeds a separate initial compression of a
        # stopper.
        arguments = {"start": 0, "held": 3} if elements.holding(system) else {"start": 0}
        device = SubCircuit(DEVICE, "ground", **dict.fromkeys(arguments, elements.number(0.0)))
        add_device(device, ("{start}", *starts[0][1:3], "{held}"))
        circuit.subcircuit(device)
        for copy, start in enumerate(starts):
            values = {name: start[index] for name, index in arguments.items()}
            circuit.X(f"copy{copy}", DEVICE, circuit.gnd, **values)
        prefixes = tuple(f"xcopy{copy}." for copy in range(len(starts)))
    if compiled:
        compact_model.add_model(circuit, system, rate, electrical, scales, pace)
        compact_model.add_starts(circuit, zip(prefixes, starts, strict=True))
    text = str(circuit)
    _check_expressions(text)
    measured: Any = (electrical.power_unit,) if electrical.current_per_ampere > 0.0 else ()
    pins, capacitance = elements.load_pins(electrical), electrical.reference_capacitance
    if load and load.resistance is None:
        # Charges and fluxes below this, as in stray capacitances and idle coils, do not shorten
        # steps.
        stray = elements.STRAY_SHARE * capacitance
        charge = stray * scales.voltage
        if load.self_oscillation.oscillates:
            # A self-oscillating load may have charges as small as OWN_CHARGE.
            charge = min(charge, OWN_CHARGE)
        options += (
            f" chgtol={elements.number(3.0 * charge)} abstol={elements.number(charge * rate)}"
        )
        measured = electrical.power_unit, part_values.conductance(load.across_output)
    # The load was checked when the scene was read.
    if load:
        run = run_text(load.name, load.pins, ramped(load.elements, ramp)) if ramp else load.run_text
        text += load.text if named and load.is_plain else run
    stop = stop_time(ready)
    first, shortest = length, 0.0
    if waveform == "external":
        first, shortest = FIRST_ORDER_SHARE * length, SHORTEST_RUN * length
    text += _analysis(first, max(stop, shortest), length, options, integrator, save)
    return Netlist(  # type: ignore[misc]
        text,
        rate,
        scales.voltage,
        length,
        stop,
        prefixes,
        electrical.terminal,
        f"v{electrical.state_current}#branch"
        if electrical.state_current
        else electrical.state_voltage,
        electrical.state_unit,
        electrical.current_per_ampere,
        *measured,
        drives_current=electrical.drives_current,
        measurement=measurement_of(load, pins) if load else NOTHING,
        watch=watch_of(load, pins) if load else UNWATCHED,
        watched_energy=(capacitance, capacitance * (SMALL_VOLTAGE * scales.voltage) ** 2),
        pace=pace,
        line=line if slowed else 0.0,
        schedule=SourceSchedule(load.elements) if load else None,
    )


def _check_expressions(text):
    """Raise for a formula of the device that would abort ngspice's process."""
    for line in text.splitlines():
        if line.startswith("B"):
            head, _, formula = line.partition("=")
            try:
                check(formula.strip("{}'\" "), (), {})
            except ExpressionError as fault:
                raise NetlistError(f"netlist: {head.split()[0]}: {fault}") from None


def _start(system, start, rate, electrical):
    """Initial displacement, velocity/rate, state (V or A) and held speed/rate, as text."""
    x, v, state = start
    values = (x, v / rate, state * electrical.state_unit, held_impact_speed(system, x, v) / rate)
    return tuple(elements.number(value) for value in values)


def _add_mechanics(circuit, system, rate, step, start):
    """Add mass, spring, damper and contacts, if the scene has them."""
    elements.add_oscillator(circuit, system, rate, start)
    elements.add_nonlinear_forces(circuit, system, rate)
    if elements.holding(system):
        elements.add_speed_hold(circuit, system, rate, step, start[3])


def _analysis(interval, stop, longest, options, integrator, save):
    interval, stop, longest = map(elements.number, (interval, stop, longest))
    return (
        f".save {' '.join(save) or 'none'}\n"
        f".options method={INTEGRATORS[integrator]} {options}\n"
        f".tran {interval} {stop} 0 {longest} uic\n"
    )
