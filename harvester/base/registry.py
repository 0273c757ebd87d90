"""Registry of parts of one kind by name: built-in parts, and parts of installed packages.

A package registers a part by an entry point of the kind's group in its pyproject.toml:

    [project.entry-points."harvester.contact_laws"]
    dashpot = "my_package.dashpot:made"
"""

from __future__ import annotations

import functools
import sys
from collections import UserDict
from collections.abc import Mapping
from typing import Any, TypeVar

Part = TypeVar("Part")


class Registry(UserDict[str, Part]):
    """Parts by name: the built-in ones, and the entry points of a group.

    Entry points are looked up only for a name that is not built in: reading their list takes some
    hundredths of a second, and loading one imports another package.
    """

    def __init__(self, group: str, built_in: Mapping[str, Part]) -> None:
        super().__init__(built_in)
        self._group = group

    def __missing__(self, name: Any) -> Part:
        if isinstance(name, str):
            for point in _entry_points(group=self._group, name=name):
                self.data[name] = point.load()
        if name not in self.data:
            raise KeyError(name)
        return self.data[name]

    def __contains__(self, name: object) -> bool:
        try:
            self[name]  # type: ignore[index]
        except (KeyError, TypeError):
            return False
        return True

    def load_all(self) -> None:
        """Load the parts of all installed packages."""
        for point in _entry_points(group=self._group):
            self[point.name]

    def name_of(self, part: Part) -> str:
        """Return the name of a registered part; load it in this process if necessary.

        Raises
        ------
        KeyError
            No package registers it.
        """
        if not any(registered is part for registered in self.data.values()):
            self.load_all()
        for name, registered in self.data.items():
            if registered is part:
                return name
        raise KeyError(f"{part!r} is no entry point of {self._group}")


def _entry_points(**selected):
    return _installed(tuple(sys.path), **selected)


@functools.cache
def _installed(path, **selected):
    """Entry points of the packages on the import path, cached: reading takes half a second."""
    # Imported here: it takes 10 % of the time of `harvester COMMAND --help`.
    from importlib import metadata

    return metadata.entry_points(**selected)
