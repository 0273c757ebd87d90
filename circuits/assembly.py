"""Scene to PySpice circuit: only the elements that the scene needs."""

import hashlib
from dataclasses import dataclass

from circuits import compiled_device, elements
from circuits.checks import check_netlist
from harvester.parameters import knot_spacing, scale, steps_per_knot, stop_time

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
        See `harvester.parameters.steps_per_knot`.
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
    starts=(True,),
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
        See `harvester.parameters.steps_per_knot`.
    starts : sequence of bool
        For each copy of the device in the netlist: it starts in the right well, else in the left.
    waveform : str
        Of the noise source: `external`, or a PWL.
    options : str
        ngspice's tolerances.
    integrator : str
        A name in `INTEGRATORS`.
    save : sequence of str
        Vectors that ngspice keeps in its memory; what streams out needs none.
    compiled : bool
        The mechanics and the piezo are one compiled device each, see `circuits.compiled_device`.

    Returns
    -------
    Netlist

    Raises
    ------
    NetlistError
        An expression is not well-formed.
    """
    from PySpice.Spice.Netlist import Circuit, SubCircuit

    p, scales = scale(scene)
    rate = p.angular_frequency
    length = knot_spacing(scene) / steps_per_knot(scene, step)
    electrical = _electrical(scene, p, scales)
    circuit = Circuit(f"harvester scene {scene.name}")
    rests = [elements.number(p.rest if right else -p.rest) for right in starts]
    load = scene.electrical_load.circuit

    def add_device(place, start):
        if scene.excitation.prescribes_displacement:
            elements.add_prescribed_displacement(place, p, rate, scene.excitation, scales)
            elements.add_piezo(place, p, rate, electrical)
        else:
            if compiled:
                compiled_device.add_device(place)
            else:
                _add_behavioural(place, p, rate, electrical, length, start)
            elements.add_excitation(place, waveform)
        if load:
            elements.add_load(place, load, electrical)
        else:
            elements.add_resistor(place, electrical)

    if len(rests) == 1:
        add_device(circuit, rests[0])
        prefixes = ("",)
    else:
        device = SubCircuit("device", "ground", start=elements.number(0.0))
        add_device(device, "{start}")
        circuit.subcircuit(device)
        for copy, rest in enumerate(rests):
            circuit.X(f"copy{copy}", "device", circuit.gnd, start=rest)
        prefixes = tuple(f"xcopy{copy}." for copy in range(len(rests)))
    if compiled:
        compiled_device.add_model(circuit, p, rate, electrical)
        compiled_device.add_starts(circuit, zip(prefixes, rests, strict=True))
    text = str(circuit)
    check_netlist(text)
    measured = ()
    if load and load.resistance is None:
        # No step is to follow a stray capacitance's charge or what rings on in an idle coil.
        charge = elements.STRAY_SHARE * electrical.capacitance * electrical.voltage_scale
        options += (
            f" chgtol={elements.number(3.0 * charge)} abstol={elements.number(charge * rate)}"
        )
        measured = (electrical.power_factor(p), load.output_resistors, load.storage)
    # The load was vetted when the scene was read.
    text += load.text if load else ""
    stop = stop_time(scene)
    shortest = SHORTEST_RUN * length if waveform == "external" else 0.0
    text += _analysis(length, max(stop, shortest), options, integrator, save)
    return Netlist(text, rate, electrical.voltage_scale, length, stop, prefixes, *measured)


def _add_behavioural(circuit, p, rate, electrical, step, start):
    """Mechanics and piezo as elements, only those that the scene needs."""
    elements.add_oscillator(circuit, p, rate, start)
    if p.cubic_stiffness > 0.0:
        elements.add_cubic(circuit, p, rate)
    if p.has_stoppers:
        elements.add_stoppers(circuit, p, rate)
        if p.held_impact_velocity and p.damping_factor > 0.0:
            elements.add_speed_hold(circuit, p, rate, step)
    elements.add_piezo(circuit, p, rate, electrical)


def _electrical(scene, p, scales):
    if scene.units == "SI":
        return elements.Electrical(
            charge_per_length=scene.piezo.coupling * scales.displacement,
            capacitance=scene.piezo.capacitance,
            resistance=scene.electrical_load.resistance,
            voltage_scale=scales.voltage,
        )
    resistance = 1.0 / p.decay_rate if p.decay_rate else None
    return elements.Electrical(1.0, 1.0, resistance, 1.0)


def _analysis(step, stop, options, integrator, save):
    saved = " ".join(save) or "none"
    return (
        f".save {saved}\n"
        f".options method={INTEGRATORS[integrator]} {options}\n"
        f".tran {elements.number(step)} {elements.number(stop)} 0 {elements.number(step)} uic\n"
    )
