"""Self-contained netlists: a `.cir` file with a PWL source for plain `ngspice -b -r FILE.raw`."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from shlex import quote
from typing import TYPE_CHECKING, Any

from circuits.equivalent import elements
from circuits.equivalent.assembly import (
    LOAD_TOLERANCE,
    OWN_TOLERANCE,
    assemble,
    own_steps,
    step_options,
)
from circuits.equivalent.ltspice import DIFFERENCES, to_ltspice
from circuits.netlist.load_watch import may_jump
from harvester.base.errors import NetlistError
from harvester.base.writing import LICENCE
from harvester.device import timescales
from harvester.device.piezo import BASE
from harvester.scene.steps import REJECTING_STEPS, knot_spacing, steps_per_sample

if TYPE_CHECKING:
    from circuits.equivalent.assembly import Netlist
    from harvester.device.system import System
    from harvester.excitation.base import ExcitationPath
    from harvester.scene.prepared import Prepared

POINTS_PER_LINE = 4
FEWEST_STEPS_PER_CONTACT = 10
# Most noise points in a netlist: about 40 MB, and half a millisecond per step of ngspice.
MOST_KNOTS = 1_000_000


def stand_alone(
    ready: Prepared,
    path: ExcitationPath,
    start: tuple[float, float, float] | None = None,
    step: str | float = "default",
    tolerance: float | None = None,
    integrator: str = "trapezoidal",
    save: Sequence[str] | None = None,
) -> Netlist:
    """Netlist of a scene with the noise as a PWL source and ngspice's own step control.

    Parameters
    ----------
    ready : Prepared
    path : ExcitationPath
        Path of the noise, unread; its knots are written to the netlist.
    start : (float, float, float) or None
        Initial X, X' and transducer's state, scaled; None: the start of the first realization.
    step : str or float
        Longest step, see `harvester.scene.steps.steps_per_sample`.
    tolerance : float or None
        Relative tolerance of ngspice's step control; None: ngspice's default, or the tolerance that
        a load with diodes needs.
    integrator : str
        See `circuits.equivalent.assembly.assemble`.
    save : sequence of str
        Vectors to store, in addition to the load's output; empty stores nothing (for a run that
        streams), None: motion, terminal voltage and noise.

    Raises
    ------
    NetlistError
        The longest step does not resolve the contact: ngspice's step control would skip it.
    """
    netlist, scales, points = _assembled(ready, path, start, step, tolerance, integrator, save)
    scene = ready.scene
    if points is None:
        return dataclasses.replace(netlist, text=_header(netlist.text, scene, netlist, scales))
    lines = "".join(
        f"+ {' '.join(points[start : start + POINTS_PER_LINE])}\n"
        for start in range(0, len(points), POINTS_PER_LINE)
    )
    source = f"Inoise 0 {elements.excited_node(ready.network)} PWL"
    before, after = netlist.text.split(source, 1)
    text = f"{_header(before, scene, netlist, scales)}{source}(\n{lines}+ ){after}"
    return dataclasses.replace(netlist, text=text)


def for_ltspice(
    ready: Prepared,
    path: ExcitationPath,
    noise_file: str,
    start: Any = None,
    step: str | float = "default",
) -> tuple[str, str | None]:
    """The netlist of `stand_alone` in LTspice's syntax, with the noise in a separate file.

    Parameters
    ----------
    ready, path, start, step
        See `stand_alone`.
    noise_file : str
        Name of the noise file in the netlist.

    Returns
    -------
    str, str or None
        The netlist, and the noise file's text: time (s) and value, or None for a prescribed motion.

    Raises
    ------
    NetlistError
        See `stand_alone`; or an expression without an equivalent in LTspice.
    """
    netlist, scales, points = _assembled(ready, path, start, step)
    scene, text = ready.scene, netlist.text
    if points is not None:
        source = f"Inoise 0 {elements.excited_node(ready.network)} PWL"
        text = text.replace(source, f'{source} file="{noise_file}"', 1)
    header = [
        f"harvester scene {scene.name}, for LTspice: harvester netlist writes it for ngspice",
        *LICENCE,
        *_reading(scene, netlist, scales),
        f"I(Inoise): {_noise_unit(scene, netlist)}",
        "Differences from ngspice:",
        *DIFFERENCES,
    ]
    # LTspice may read a file in a one-byte encoding.
    comments = "".join(f"* {line}\n" for line in header).replace("η", "eta")
    noise = None if points is None else "\n".join(points) + "\n"
    return comments + to_ltspice(text) + ".end\n", noise


def _assembled(ready, path, start, step, tolerance=None, integrator="trapezoidal", save=None):
    """Netlist without noise points, scales, and the points "time value" or None."""
    scene, system, scales = ready.scene, ready.system, ready.scales
    load = scene.load.circuit
    if load is None or load.linear:
        options = own_steps(tolerance or OWN_TOLERANCE)
    else:
        options, _ = step_options(ready, step, tolerance or LOAD_TOLERANCE)
        if load.switches and not may_jump(load):
            step = knot_spacing(ready) / steps_per_sample(ready, step) / REJECTING_STEPS
    if save is None:
        nodes = (elements.DISPLACEMENT, elements.VELOCITY, ready.network.terminal)
        save = (*(f"v({node})" for node in nodes), "@inoise[current]")
    if save and load and load.has_output:
        save = (*save, f"v({elements.OUTPUT})", f"v({elements.REFERENCE})")
    netlist = assemble(
        ready, step, [start] if start else None, "PWL", options, integrator, save, named=True
    )
    if scene.excitation.prescribes_displacement:
        return netlist, scales, None
    _check_step(system, netlist.step)
    knots = round(netlist.stop / path.spacing) + 1
    _check_size(knots, netlist.stop, path.spacing)
    values = path.read(knots) / netlist.rate**2
    points = [f"{k * path.spacing!r} {float(value)!r}" for k, value in enumerate(values)]
    return netlist, scales, points


def _check_size(knots, stop, spacing):
    if knots > MOST_KNOTS:
        raise NetlistError(
            f"run.settle + run.duration = {stop:.4g} s with a sample of the noise every "
            f"{spacing:.3g} s are {knots:.3g} points in the netlist, and at most {MOST_KNOTS} are "
            f"written: shorten the run to {MOST_KNOTS * spacing:.3g} s"
        )


def longest_in_contact(system: System) -> float:
    """Longest step of a netlist with ngspice's own steps (s); inf without contacts."""
    return timescales.contact_time(system) / FEWEST_STEPS_PER_CONTACT


def _check_step(system, step):
    largest = longest_in_contact(system)
    if step > largest:
        contact = timescales.contact_time(system)
        raise NetlistError(
            f"step {step:.3g} s does not resolve a contact of {contact:.3g} s at "
            "the rms speed, so ngspice would skip the contact: choose step = "
            f"{largest:.2g} or less"
        )


def _header(before, scene, netlist, scales):
    """The netlist's first part, with notes for users."""
    title, remainder = before.split("\n", 1)
    lines = [
        f"Run it with: ngspice -b -r {quote(scene.name + '.raw')} {quote(scene.name + '.cir')}",
        "If this file has another name, write that name after the .raw file.",
        "ngspice searches all points of the PWL source at every step: its time grows with the",
        "square of run.duration, unlike the time of harvester simulate --method circuit.",
        *LICENCE,
        *_reading(scene, netlist, scales),
        f"i(@inoise[current]): {_noise_unit(scene, netlist)}",
    ]
    return f"{title}\n" + "".join(f"* {line}\n" for line in lines) + remainder


def _reading(scene, netlist, scales):
    """Lines that give quantity and unit of each node."""
    si = scene.units == "SI"
    volts = "volts" if si else "scaled"
    shaken = f"v({BASE}): voltage of the base's acceleration in series with the piezo, {volts}"
    return [
        f"v(displacement): X in units of {scales.displacement:g} {'m' if si else '(scaled)'}",
        f"v(velocity): X' over {netlist.rate!r} per second",
        f"v({netlist.terminal}): terminal voltage, {volts}",
        *([shaken] if "\nHbase_charge " in netlist.text else []),
    ]


def _noise_unit(scene, netlist):
    factor = scene.oscillator.base_factor
    times = "" if factor == 1.0 else f"{factor!r} times "
    return f"η, minus {times}the base acceleration, over {netlist.rate**2!r} per second squared"
