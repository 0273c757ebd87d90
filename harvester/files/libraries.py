"""Libraries that only some commands need, imported when they are."""

import importlib
from types import ModuleType

from harvester.errors import MissingLibrary


def optional_library(name: str, purpose: str, extra: str) -> ModuleType:
    """Import a library that belongs to an extra of this project, or say how to install it.

    Parameters
    ----------
    name : str
        Name of the module.
    purpose : str
        What the library is needed for, for the message.
    extra : str
        Name of the extra in pyproject.toml that installs it.

    Raises
    ------
    MissingLibrary
        It is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise MissingLibrary(f"{purpose} needs {name}: pip install 'harvester[{extra}]'") from None
