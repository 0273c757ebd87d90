"""What judges the program: closed forms, other integrators, the source paper, the program."""

import importlib
import sys
import warnings
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec

# Modules under the names that they had before; importing one warns, and works for one release.
FORMER_NAMES = {
    "work_precision": "accuracy",
    "work_precision.diagram": "accuracy.work_precision",
    "work_precision.measurement": "accuracy.work_precision",
    "work_precision.methods": "accuracy.methods",
    "work_precision.reference_path": "exact_paths",
    "work_precision.throughput": "accuracy.throughput",
    "work_precision.time_to_accuracy": "accuracy.time_to_accuracy",
}


class _FormerNames(MetaPathFinder, Loader):
    """Imports a former name as a module that hands on what the new one holds."""

    def find_spec(self, fullname, path=None, target=None):
        if fullname.removeprefix(f"{__name__}.") in FORMER_NAMES:
            return ModuleSpec(fullname, self, is_package=True)
        return None

    def create_module(self, spec):
        return None

    def exec_module(self, module):
        new = f"{__name__}.{FORMER_NAMES[module.__name__.removeprefix(f'{__name__}.')]}"
        warnings.warn(f"{module.__name__} is now {new}", DeprecationWarning, stacklevel=2)
        module.__getattr__ = lambda name: getattr(importlib.import_module(new), name)


sys.meta_path.append(_FormerNames())
