"""The circuit engine: scene → netlist → ngspice; called by `harvester.engines.realization`."""

from __future__ import annotations

import copy
import importlib
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from circuits.equivalent.assembly import assemble, step_options
from circuits.ngspice import compiled_device
from circuits.ngspice.session import session
from harvester.base.errors import CompiledDeviceUnavailable
from harvester.scene.lines import line_frequency
from harvester.scene.model import Scene
from harvester.scene.prepared import Prepared, prepared
from harvester.scene.steps import steps_per_contact, steps_per_sample

if TYPE_CHECKING:
    from circuits.ngspice.session import Session
    from harvester.excitation.base import ExcitationPath


def prepare(ready: Prepared) -> None:
    """Load libraries and compiled code, so that they do not count as simulation."""
    importlib.import_module("PySpice.Spice.Netlist")
    session().prepare(ready.system)


def run_realizations(
    circuit: Any,
    ready: Prepared,
    paths: list[ExcitationPath],
    starts: list[tuple[float, float, float]],
    observers: list[Any],
    outputs: Any = None,
) -> dict[str, str]:
    """Run realizations in one netlist through ngspice, with common steps; see `Engine`.

    `circuit` is a `harvester.engines.methods.Circuit`. A PWL source supports one realization.
    """
    scene, system = ready.scene, ready.system
    engine = session()
    engine.circuit_load = scene.load.circuit
    if circuit.source == "pwl":
        from circuits.equivalent.export import stand_alone

        written = copy.deepcopy(paths[0])
        netlist = stand_alone(
            ready, written, starts[0], circuit.step, circuit.tolerance, circuit.scheme, save=()
        )
        engine.run(netlist, system, paths, observers, 0, outputs=outputs)
    else:
        options, by_error = step_options(ready, circuit.step, circuit.tolerance)
        for name in ("gmin", "cshunt"):
            value = getattr(circuit, name)
            options += f" {name}={value!r}" if value else ""
        exact = circuit.scheme == "trapezoidal" and circuit.tolerance is None
        netlist = assemble(
            ready, circuit.step, starts, options=options, integrator=circuit.scheme,
            compiled=_compiled(engine, ready, circuit.device),
            line=line_frequency(ready) if exact else 0.0, ramp=circuit.ramp,
        )  # fmt: skip
        steps = steps_per_sample(ready, circuit.step), steps_per_contact(ready, circuit.step)
        refinement = steps[0] / steps_per_sample(ready)
        engine.run(netlist, system, paths, observers, *steps, by_error, refinement, outputs)
    return {"engine_version": version(engine), "netlist_sha256": netlist.sha256}


def device_used(ready: Prepared, device: str, report: Callable) -> str:
    """Device model that a run with the option `device` uses: "compiled" or "behavioural".

    Called in a worker process, since it opens ngspice.
    """
    compiled = _compiled(session(), ready, device)
    return "compiled" if compiled else "behavioural"


def _compiled(engine, ready, device):
    """Whether the compiled device is used.

    Raises
    ------
    CompiledDeviceUnavailable
        The compiled device was requested but is unavailable, or lacks parts of the scene.
    """
    if device == "behavioural" or ready.scene.excitation.prescribes_displacement:
        return False
    reason = engine.compiled_device_is_off(ready.system)
    if reason and device == "compiled":
        raise CompiledDeviceUnavailable(f"{reason}; or choose device automatic")
    return not reason


def version(engine: Session) -> str:
    """ngspice's name and version, "ngspice-39"."""
    match = re.search(r"ngspice-[\w.+-]+", engine.version_text)
    return match.group(0) if match else "ngspice"


def describe(report: Callable) -> dict[str, Any]:
    """Library, version and features of ngspice, for `harvester engine` (called in a worker)."""
    engine = session()
    text = engine.version_text
    return {
        "library": engine.library_path,
        "version": version(engine),
        "xspice": "xspice" in text.lower(),
        "cider": "cider" in text.lower(),
        "osdi": compiled_device.has_osdi(engine),
        "klu": "klu" in text.lower(),
        "compiled_device_off": engine.compiled_device_is_off(prepared(Scene.read("paper")).system),
    }
