"""Optional libraries, imported when a command needs them."""

import importlib
from types import ModuleType

from harvester.base.errors import MissingLibrary


def install_command(extra: str) -> str:
    """Return the command that installs an extra of the distribution that holds this package.

    Another project's distribution may be called `harvester`, so the name is read from the metadata
    of the distribution that installs our command. A clone without metadata has the name ".".
    """
    from importlib.metadata import entry_points

    commands = entry_points(group="console_scripts", name="harvester")
    ours = (command.dist for command in commands if command.value == "harvester.__main__:main")
    name = next((distribution.name for distribution in ours if distribution), ".")
    return f"pip install '{name}[{extra}]'"


def optional_library(name: str, purpose: str, extra: str) -> ModuleType:
    """Import a library of an extra of this project.

    `purpose`: purpose of the library, for the message. `extra`: name of the extra in pyproject.toml
    that installs it. Raises MissingLibrary, with the command to install it, if it is missing.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise MissingLibrary(f"{purpose} needs {name}: {install_command(extra)}") from None
