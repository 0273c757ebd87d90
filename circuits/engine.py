"""The circuit engine: scene → netlist → ngspice, as `harvester.realization` calls it."""

import importlib
import re

from circuits.assembly import assemble, step_options
from circuits.session import session
from harvester.parameters import scale, steps_per_knot


def prepare():
    """Load libraries and compiled code, so that they do not count as simulation."""
    importlib.import_module("PySpice.Spice.Netlist")
    session().prepare()


def run_realization(
    scene,
    path,
    right,
    observers,
    step,
    source,
    scheme="trapezoidal",
    tolerance=None,
    output=None,
):
    """Run one realization through ngspice.

    Parameters
    ----------
    scene : Scene
    path : NoisePath
    right : bool
        Start in the right well.
    observers : sequence of objects with `add(record)`
    step : str or float
        See `harvester.parameters.steps_per_knot`.
    source : str
        "external", or "pwl" for a PWL source in the netlist with ngspice's own steps.
    scheme : str
        "trapezoidal" or "gear".
    tolerance : float or None
        ngspice's relative tolerance for the local error of a step, which then shortens the
        steps; None: fixed steps, or ngspice's default for "pwl", and for a load that switches
        `circuits.assembly.LOAD_TOLERANCE`.
    output : harvester.output_moments.OutputMoments or None
        For a load that has an output side.

    Returns
    -------
    dict
        steps, engine_version, netlist_sha256.

    Raises
    ------
    SimulationError, NetlistError, EngineNotFound
    """
    parameters, _ = scale(scene)
    engine = session()
    if source == "pwl":
        from circuits.export import stand_alone

        netlist = stand_alone(scene, path, right, step, tolerance, scheme, save=())
        steps = engine.run(netlist, parameters, None, observers, 0, output=output)
    else:
        options, by_error = step_options(scene, step, tolerance)
        netlist = assemble(scene, step, right, options=options, integrator=scheme)
        fixed = steps_per_knot(scene, step)
        steps = engine.run(netlist, parameters, path, observers, fixed, by_error, output)
    return {
        "steps": steps,
        "engine_version": version(engine),
        "netlist_sha256": netlist.sha256,
    }


def version(engine):
    """ngspice's name and number, "ngspice-39"."""
    match = re.search(r"ngspice-[\w.+-]+", engine.version_text)
    return match.group(0) if match else "ngspice"


def describe(report):
    """What was found: a dictionary for `harvester engine` (called in a worker)."""
    engine = session()
    text = engine.version_text
    return {
        "library": engine.library_path,
        "version": version(engine),
        "xspice": "xspice" in text.lower(),
        "cider": "cider" in text.lower(),
        "osdi": "osdi" in text.lower(),
        "klu": "klu" in text.lower(),
    }
