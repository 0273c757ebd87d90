"""Scene to PySpice circuit: only the elements that the scene needs."""

import hashlib
from dataclasses import dataclass

from circuits import elements
from circuits.loads.expressions import check_netlist
from circuits.ngspice import compiled_device
from harvester.device import timescales
from harvester.device.system import speed_held
from harvester.engines.realization import start_state
from harvester.engines.steps import knot_spacing, steps_per_knot, stop_time
from harvester.scene.units import load_resistance, scale

# Steps set from outside: a tight tolerance for Newton, none for the local error (trtol).
FIXED_STEP = "reltol=1e-10 vntol=1e-11 trtol=1e9"
# Integrators by name, as ngspice calls them.
INTEGRATORS = {"trapezoidal": "trap", "gear": "gear"}
# With diodes Newton needs many iterations where one turns on: a step that it gives up is tried
# again at an eighth, where the rounding of a large capacitor's current is eight times worse.
RECTIFIER_STEP = "reltol=1e-6 trtol=1e9 itl4=100"
# A load that switches: its local error, and Newton's own tolerance, which rounding does not reach.
LOAD_TOLERANCE = 1e-5
LOAD_NEWTON = 1e-4
# ngspice's own relative tolerance.
OWN_TOLERANCE = 1e-3
# Steps. ngspice 46 never ends a shorter run: its least step, 1e-11 of the longest one, is then more
# than what it takes for equal at the end.
SHORTEST_RUN = 1000


def own_steps(tolerance):
    """Options for ngspice's own step control by the local error at this relative tolerance."""
    return f"reltol={tolerance!r} trtol=7"


def step_options(scene, step="default", tolerance=None):
    """Options for steps on a grid, and whether the local error shortens them.

    Parameters
    ----------
    scene : Scene
    step : str or float
        See `harvester.engines.steps.steps_per_knot`.
    tolerance : float or None
        Relative tolerance of the local error; None: none, or for a load that switches one that
        goes with the step, because ngspice's trapezoidal steps grow as its square root.

    Returns
    -------
    str, bool
    """
    load = scene.electrical_load.circuit
    if load is None or load.linear:
        return (own_steps(tolerance), True) if tolerance else (FIXED_STEP, False)
    if not load.switches and not tolerance:
        return RECTIFIER_STEP, False
    refinement = steps_per_knot(scene, step) / steps_per_knot(scene)
    tolerance = tolerance or LOAD_TOLERANCE / refinement**2
    return f"reltol={LOAD_NEWTON!r} trtol={7.0 * tolerance / LOAD_NEWTON!r} itl4=100", True


@dataclass(frozen=True)
class Netlist:
    """A circuit ready to run, and how its nodes read.

    Attributes
    ----------
    text : str
    rate : float
        ω: X' over the velocity node, and the root of η over the noise node (1/s).
    voltage_scale : float
        Volts per scaled volt.
    step : float
        Longest step (s).
    stop : float
        End of what is of interest (s); the text may run on.
    prefixes : tuple of str
        In front of the nodes' names, one for each copy of the device.
    terminal : str
        Node that carries the transducer's terminal voltage.
    scaled_ampere : float
        Scaled current of a coil for one ampere at the load's ammeter; 0 for a piezo.
    per_power : float
        Scaled power per watt at the load's ammeter; 0 without one.
    output_resistors, storage : tuple of str
        ngspice's names of the resistors and capacitors across the load's output.
    """

    text: str
    rate: float
    voltage_scale: float
    step: float
    stop: float
    prefixes: tuple = ("",)
    terminal: str = elements.PIEZO
    scaled_ampere: float = 0.0
    per_power: float = 0.0
    output_resistors: tuple = ()
    storage: tuple = ()

    @property
    def sha256(self):
        """Digest of the text."""
        return hashlib.sha256(self.text.encode()).hexdigest()


def assemble(
    scene,
    step="default",
    starts=None,
    waveform="external",
    options=FIXED_STEP,
    integrator="trapezoidal",
    save=(),
    compiled=False,
):
    """Build the equivalent circuit of a scene with PySpice.

    Parameters
    ----------
    scene : Scene
    step : str or float
        See `harvester.engines.steps.steps_per_knot`.
    starts : sequence of (float, float, float) or None
        For each copy of the device in the netlist its X, X' and transducer's state, scaled; None:
        one copy, as the first realization starts.
    waveform : str
        Of the noise source: `external`, or a PWL.
    options : str
        ngspice's tolerances.
    integrator : str
        A name in `INTEGRATORS`.
    save : sequence of str
        Vectors that ngspice keeps in its memory; what streams out needs none.
    compiled : bool
        The mechanics and the piezo are one compiled device each, see
        `circuits.ngspice.compiled_device`.

    Returns
    -------
    Netlist

    Raises
    ------
    NetlistError
        An expression is not well-formed.
    """
    from PySpice.Spice.Netlist import Circuit, SubCircuit

    system, scales = scale(scene)
    rate = timescales.angular_frequency(system)
    length = knot_spacing(scene) / steps_per_knot(scene, step)
    electrical = _electrical(scene, scales)
    circuit = Circuit(f"harvester scene {scene.name}")
    starts = [_start(system, start, rate, scales) for start in starts or [start_state(scene, 0)]]
    load = scene.electrical_load.circuit

    def add_device(place, start):
        if scene.excitation.prescribes_displacement:
            elements.add_prescribed_displacement(
                place, system, rate, scene.excitation, scales, electrical
            )
            _add_transducer(place, system, rate, electrical, start[2])
        else:
            if compiled:
                compiled_device.add_device(place)
                elements.add_leak(place, system, electrical)
            else:
                _add_mechanics(place, system, rate, length, start)
                _add_transducer(place, system, rate, electrical, start[2])
            elements.add_excitation(place, waveform)
        if load:
            elements.add_load(place, load, electrical)
        else:
            elements.add_resistor(place, electrical)

    if len(starts) == 1:
        add_device(circuit, starts[0])
        prefixes = ("",)
    else:
        # The wells differ in where they lie and in how far they press a mass onto a stopper.
        own = {"start": 0, "held": 3} if elements.holding(system) else {"start": 0}
        device = SubCircuit("device", "ground", **dict.fromkeys(own, elements.number(0.0)))
        add_device(device, ("{start}", *starts[0][1:3], "{held}"))
        circuit.subcircuit(device)
        for copy, start in enumerate(starts):
            values = {name: start[place] for name, place in own.items()}
            circuit.X(f"copy{copy}", "device", circuit.gnd, **values)
        prefixes = tuple(f"xcopy{copy}." for copy in range(len(starts)))
    if compiled:
        compiled_device.add_model(circuit, system, rate, electrical)
        compiled_device.add_starts(circuit, zip(prefixes, starts, strict=True))
    text = str(circuit)
    check_netlist(text)
    measured = (electrical.power_factor,) if scene.coil else ()
    if load and load.resistance is None:
        # No step is to follow a stray capacitance's charge or what rings on in an idle coil.
        stray = elements.STRAY_SHARE * electrical.reference_capacitance
        charge = stray * electrical.voltage_scale
        options += (
            f" chgtol={elements.number(3.0 * charge)} abstol={elements.number(charge * rate)}"
        )
        measured = (electrical.power_factor, load.output_resistors, load.storage)
    # The load was vetted when the scene was read.
    text += load.text if load else ""
    stop = stop_time(scene)
    shortest = SHORTEST_RUN * length if waveform == "external" else 0.0
    text += _analysis(length, max(stop, shortest), options, integrator, save)
    return Netlist(
        text,
        rate,
        electrical.voltage_scale,
        length,
        stop,
        prefixes,
        electrical.terminal,
        electrical.scaled_ampere,
        *measured,
    )


def _start(system, start, rate, scales):
    """Initial displacement, velocity over rate, terminal volts, held speed over rate, as text."""
    x, v, state = start
    values = (x, v / rate, state * scales.voltage, speed_held(system, x, v) / rate)
    return tuple(elements.number(value) for value in values)


def _add_mechanics(circuit, system, rate, step, start):
    """Mass, spring, damper and contacts as elements, only those that the scene needs."""
    elements.add_oscillator(circuit, system, rate, start)
    elements.add_nonlinear_spring(circuit, system, rate)
    elements.add_drag(circuit, system)
    elements.add_contacts(circuit, system, rate)
    if elements.holding(system):
        elements.add_speed_hold(circuit, system, rate, step, start[3])


def _add_transducer(circuit, system, rate, electrical, start):
    if electrical.terminal == elements.COIL:
        elements.add_coil(circuit, rate, electrical)
    else:
        elements.add_piezo(circuit, system, rate, electrical, start)
        elements.add_leak(circuit, system, electrical)


def _electrical(scene, scales):
    """The electrical side: of a coil, of a piezo in SI units, or scaled."""
    system, _ = scale(scene)
    resistance = load_resistance(scene)
    if scene.coil:
        return _of_coil(scene, scales, system, resistance)
    coupling = system.transducer.coupling
    if scene.units == "SI":
        capacitance, volts = scene.piezo.capacitance, scales.voltage
        return elements.Electrical(
            terminal=elements.PIEZO,
            resistance=resistance,
            voltage_scale=volts,
            power_factor=coupling / (capacitance * volts**2),
            reference_capacitance=capacitance,
            charge_per_length=scene.piezo.coupling * scales.displacement,
            capacitance=capacitance,
        )
    rate = system.transducer.load_rate
    return elements.Electrical(
        terminal=elements.PIEZO,
        resistance=1.0 / rate if rate else None,
        voltage_scale=1.0,
        power_factor=coupling,
        reference_capacitance=1.0,
        charge_per_length=1.0,
        capacitance=1.0,
    )


def _of_coil(scene, scales, system, resistance):
    coil, mass = scene.coil, scene.oscillator.mass
    impedance = coil.inductance or coil.resistance
    return elements.Electrical(
        terminal=elements.COIL,
        resistance=resistance,
        voltage_scale=scales.voltage,
        power_factor=1.0 / scales.power,
        # One that passes as little as the winding at the motion's own frequency.
        reference_capacitance=1.0 / (timescales.angular_frequency(system) * coil.resistance),
        volts_per_speed=coil.coupling * scales.displacement,
        winding_resistance=coil.resistance,
        inductance=coil.inductance,
        acceleration_per_ampere=coil.coupling / (mass * scales.displacement),
        scaled_ampere=impedance / (coil.coupling * scales.displacement),
    )


def _analysis(step, stop, options, integrator, save):
    saved = " ".join(save) or "none"
    return (
        f".save {saved}\n"
        f".options method={INTEGRATORS[integrator]} {options}\n"
        f".tran {elements.number(step)} {elements.number(stop)} 0 {elements.number(step)} uic\n"
    )
