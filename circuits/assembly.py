"""Scene to PySpice circuit: only the elements that the scene needs."""

import hashlib
from dataclasses import dataclass

from circuits import elements
from circuits.checks import check_netlist
from harvester.parameters import knot_spacing, scale, steps_per_knot, stop_time

# Steps set from outside: a tight tolerance for Newton, none for the local error (trtol).
FIXED_STEP = "reltol=1e-9 vntol=1e-9 trtol=1e9"
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
        End time (s).
    per_power : float
        Scaled power per watt at the load's ammeters; 0 without ammeters.
    output_resistors, storage : tuple of str
        ngspice's names of the resistors and capacitors across the load's output.
    """

    text: str
    rate: float
    voltage_scale: float
    step: float
    stop: float
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
    right=True,
    waveform="external",
    options=FIXED_STEP,
    integrator="trapezoidal",
    save=(),
):
    """Build the equivalent circuit of a scene with PySpice.

    Parameters
    ----------
    scene : Scene
    step : str or float
        See `harvester.parameters.steps_per_knot`.
    right : bool
        Start in the right well, else in the left one.
    waveform : str
        Of the noise source: `external`, or a PWL.
    options : str
        ngspice's tolerances.
    integrator : str
        A name in `INTEGRATORS`.
    save : sequence of str
        Nodes that ngspice keeps in its memory; what streams out needs none.

    Returns
    -------
    Netlist

    Raises
    ------
    NetlistError
        An expression is not well-formed.
    """
    from PySpice.Spice.Netlist import Circuit

    p, scales = scale(scene)
    rate = p.angular_frequency
    length = knot_spacing(scene) / steps_per_knot(scene, step)
    electrical = _electrical(scene, p, scales)
    circuit = Circuit(f"harvester scene {scene.name}")
    excitation = scene.excitation
    if excitation.prescribes_displacement:
        amplitude = excitation.amplitude / scales.displacement
        elements.add_prescribed_displacement(
            circuit, p, rate, amplitude, excitation.frequency, electrical
        )
    else:
        elements.add_oscillator(circuit, p, rate, p.rest if right else -p.rest)
        elements.add_excitation(circuit, waveform)
    if p.cubic_stiffness > 0.0:
        elements.add_cubic(circuit, p, rate)
    if p.has_stoppers:
        elements.add_stoppers(circuit, p, rate)
        if p.held_impact_velocity and p.damping_factor > 0.0:
            elements.add_speed_hold(circuit, p, rate, length)
    elements.add_piezo(circuit, p, rate, electrical)
    load = scene.electrical_load.circuit
    if load:
        elements.add_load(circuit, load, electrical)
    else:
        elements.add_resistor(circuit, electrical)
    device = str(circuit)
    check_netlist(device)
    stop = stop_time(scene)
    measured = ()
    if load and load.resistance is None:
        # No step is to follow a stray capacitance's charge or what rings on in an idle coil.
        charge = elements.STRAY_SHARE * electrical.capacitance * electrical.voltage_scale
        options += (
            f" chgtol={elements.number(3.0 * charge)} abstol={elements.number(charge * rate)}"
        )
        measured = (electrical.power_factor(p), load.output_resistors, load.storage)
    # The load was vetted when the scene was read.
    text = device + (load.text if load else "")
    text += _analysis(length, stop, options, integrator, save)
    return Netlist(text, rate, electrical.voltage_scale, length, stop, *measured)


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
    saved = " ".join(f"v({node})" for node in save) or "none"
    return (
        f".save {saved}\n"
        f".options method={INTEGRATORS[integrator]} {options}\n"
        f".tran {elements.number(step)} {elements.number(stop)} 0 {elements.number(step)} uic\n"
    )
