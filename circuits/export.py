"""Stand-alone netlists: a `.cir` with its own PWL source that plain `ngspice -b` runs."""

import dataclasses

from circuits import elements
from circuits.assembly import LOAD_TOLERANCE, OWN_TOLERANCE, assemble, own_steps, step_options
from harvester.errors import NetlistError
from harvester.parameters import scale

PER_LINE = 4
FEWEST_STEPS_PER_CONTACT = 10
SAVED = (
    f"v({elements.DISPLACEMENT})",
    f"v({elements.VELOCITY})",
    f"v({elements.PIEZO})",
    "@inoise[current]",
)


def stand_alone(
    scene,
    path,
    right=True,
    step="default",
    tolerance=None,
    integrator="trapezoidal",
    save=SAVED,
):
    """Netlist of a scene with the noise as a PWL source and ngspice's own step control.

    Parameters
    ----------
    scene : Scene
    path : NoisePath
        At its beginning; its knots are written out.
    right : bool
        Start in the right well.
    step : str or float
        Longest step, see `harvester.parameters.steps_per_knot`.
    tolerance : float or None
        Relative tolerance of ngspice's step control; None: its own default, or what a load
        with diodes needs.
    integrator : str
        See `circuits.assembly.assemble`.
    save : sequence of str
        Vectors to keep, those of the load's output with them; none keeps nothing (for a run that
        streams).

    Returns
    -------
    circuits.assembly.Netlist

    Raises
    ------
    NetlistError
        The longest step does not resolve the contact: ngspice's own control passes over it.
    """
    parameters, scales = scale(scene)
    load = scene.electrical_load.circuit
    if load is None or load.linear:
        options = own_steps(tolerance or OWN_TOLERANCE)
    else:
        options, _ = step_options(scene, step, tolerance or LOAD_TOLERANCE)
    if save and load and load.has_output:
        save = (*save, f"v({elements.OUTPUT})", f"v({elements.REFERENCE})")
    netlist = assemble(scene, step, (right,), "PWL", options, integrator, save)
    if scene.excitation.prescribes_displacement:
        return dataclasses.replace(netlist, text=_header(netlist.text, scene, netlist, scales))
    _check_step(parameters, netlist.step)
    knots = round(netlist.stop / path.spacing) + 1
    values = path.read(knots) / netlist.rate**2
    points = [f"{k * path.spacing!r} {float(value)!r}" for k, value in enumerate(values)]
    lines = [
        "+ " + " ".join(points[start : start + PER_LINE])
        for start in range(0, len(points), PER_LINE)
    ]
    source = f"Inoise 0 {elements.VELOCITY} PWL"
    before, after = netlist.text.split(source, 1)
    text = "".join(
        [
            _header(before, scene, netlist, scales),
            f"{source}(\n",
            "\n".join(lines),
            "\n+ )",
            after,
        ]
    )
    return dataclasses.replace(netlist, text=text)


def _check_step(parameters, step):
    largest = parameters.contact_time / FEWEST_STEPS_PER_CONTACT
    if step > largest:
        raise NetlistError(
            f"step {step:.3g} s does not resolve a contact of {parameters.contact_time:.3g} s at "
            "the rms speed, and ngspice's own steps pass over it: choose --step "
            f"{largest:.2g} or less"
        )


def _header(before, scene, netlist, scales):
    """The netlist's first part, with what a reader by hand needs to know."""
    title, rest = before.split("\n", 1)
    return (
        f"{title}\n"
        f"* Run it with: ngspice -b -r {scene.name}.raw {scene.name}.cir\n"
        f"* v(displacement): X in units of {scales.displacement:g} "
        f"{'m' if scene.units == 'SI' else '(scaled)'}\n"
        f"* v(velocity): X' over {netlist.rate!r} per second\n"
        f"* i(@inoise[current]): η, minus the base acceleration, over {netlist.rate**2!r} "
        f"per second squared\n"
        f"* v(piezo): terminal voltage, {'volts' if scene.units == 'SI' else 'scaled'}\n"
        f"{rest}"
    )
