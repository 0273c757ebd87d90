"""Modules under the names that they had in release 0.1; importing one warns, for one release."""

from __future__ import annotations

import importlib
import os
import sys
import warnings
from importlib.machinery import ModuleSpec

# Former and present modules, both without "harvester." in front.
_MOVED = {
    "engines": "simulation",
    "engines.circuit": "simulation.methods",
    "engines.decay": "device.decay",
    "engines.isolation": "workers.isolation",
    "engines.lines": "prepared.lines",
    "engines.lockstep": "monte_carlo.lockstep",
    "engines.monte_carlo": "monte_carlo.engine",
    "engines.pools": "workers.pools",
    "engines.protocol": "simulation.methods",
    "engines.realization": "simulation.realization",
    "engines.sampled": "monte_carlo.sampled",
    "engines.schemes": "monte_carlo.schemes",
    "engines.side_by_side": "simulation.side_by_side",
    "engines.steps": "prepared.steps",
    "engines.worker": "workers.worker",
    "engines.workers": "workers.process",
    "engines.zones": "device.zones",
    "estimates.paired": "results.paired",
    "estimates.residual_cause": "results.residual_cause",
    "result_dataset": "results.dataset",
    "result_reading": "results.result",
    "scene.keys": "device.keys",
    "show.accuracy_figure": "verification.accuracy.drawing",
    "show.citations": "commands.citations",
    "show.console": "commands.console",
    "show.explorer": "explorer.explorer",
    "show.explorer_figure": "explorer.drawing",
    "show.explorer_widget": "explorer.widget",
    "show.frequency_figure": "studies.frequency_response",
    "show.joint_figure": "results.joint_drawing",
    "show.quiet": "commands.quiet",
    "show.shown": "commands.shown",
    "show.sketch": "commands.sketch",
    "show.verdicts": "studies.comparison.verdicts",
    "studies.axis": "studies.optimum.axis",
    "studies.comparison_drawing": "studies.comparison.drawing",
    "studies.comparison_report": "studies.comparison.report",
    "studies.comparison_verdicts": "studies.comparison.verdicts",
    "studies.curves": "studies.loads.curves",
    "studies.dataset": "studies.former",
    "studies.devices": "studies.sensitivity.devices",
    "studies.drawing": "studies.loads.drawing",
    "studies.effects": "studies.sensitivity.effects",
    "studies.evaluation": "studies.loads.evaluation",
    "studies.files": "studies.loads.study",
    "studies.flat_region": "studies.optimum.flat_region",
    "studies.frequency_drawing": "studies.frequency_response",
    "studies.joint_tolerance": "studies.sensitivity.joint_tolerance",
    "studies.objective": "studies.optimum.objective",
    "studies.optimum_drawing": "studies.optimum.drawing",
    "studies.optimum_of_several": "studies.former",
    "studies.optimum_search": "studies.optimum.line",
    "studies.outcome": "studies.former",
    "studies.point": "studies.loads.evaluation",
    "studies.population": "studies.sensitivity.population",
    "studies.proof": "studies.loads.proof",
    "studies.proposals": "studies.optimum.proposals",
    "studies.sensitivity_drawing": "studies.sensitivity.drawing",
    "studies.sobol": "studies.sensitivity.sobol",
    "studies.study": "studies.loads.study",
    "studies.tolerances": "studies.sensitivity.tolerances",
    "verification.work_precision": "verification.accuracy",
    "verification.work_precision.diagram": "verification.accuracy.work_precision",
    "verification.work_precision.measurement": "verification.accuracy.work_precision",
    "verification.work_precision.methods": "verification.accuracy.methods",
    "verification.work_precision.reference_path": "verification.exact_paths",
    "verification.work_precision.throughput": "verification.accuracy.throughput",
    "verification.work_precision.time_to_accuracy": "verification.accuracy.time_to_accuracy",
}
FORMER_NAMES = {f"harvester.{old}": f"harvester.{new}" for old, new in _MOVED.items()}


class _Finder:
    """Imports a former name as a module that hands on what the new one holds."""

    def find_spec(self, fullname, path=None, target=None):
        if fullname in FORMER_NAMES:
            return ModuleSpec(fullname, self, is_package=True)  # type: ignore[arg-type]
        return None

    def create_module(self, spec):
        return None

    def exec_module(self, module):
        new = FORMER_NAMES[module.__name__]
        warnings.warn(f"{module.__name__} is now {new}", DeprecationWarning, stacklevel=2)
        module.__getattr__ = lambda name: getattr(importlib.import_module(new), name)


def install() -> None:
    """Let Python find modules by their former names; after all others."""
    sys.meta_path.append(_Finder())


def handed_on(package: str, module: str, name: str) -> object:
    """An object under its former path, from the module that holds it now.

    Raises
    ------
    AttributeError
    """
    folders = getattr(sys.modules[package], "__path__", ())
    if name.startswith("__") or any(os.path.exists(f"{each}/{name}.py") for each in folders):
        # Python asks here for a submodule before it imports it.
        raise AttributeError(f"module {package!r} has no attribute {name!r}")
    found = getattr(importlib.import_module(module), name)
    warnings.warn(f"{package}.{name} is now {module}.{name}", DeprecationWarning, stacklevel=3)
    return found
