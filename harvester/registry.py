"""Parts of one kind by name: this program's own, and those that installed packages add.

A package adds a part by an entry point of the kind's group, in its pyproject.toml:

    [project.entry-points."harvester.contact_laws"]
    dashpot = "my_package.dashpot:made"
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, MutableMapping
from importlib import metadata
from typing import TypeVar

Part = TypeVar("Part")


class Registry(MutableMapping[str, Part]):
    """Parts by name.

    Entry points are looked up when a name is asked for that is not there: reading their list takes
    some hundredths of a second, and loading one imports another package.

    Parameters
    ----------
    group : str
        The entry points' group.
    own : mapping
        This program's parts.
    """

    def __init__(self, group: str, own: Mapping[str, Part]) -> None:
        self._group = group
        self._parts = dict(own)

    def __getitem__(self, name: str) -> Part:
        if name not in self._parts and isinstance(name, str):
            for point in metadata.entry_points(group=self._group, name=name):
                self._parts[name] = point.load()
        return self._parts[name]

    def __contains__(self, name: object) -> bool:
        try:
            self[name]  # type: ignore[index]
        except (KeyError, TypeError):
            return False
        return True

    def __setitem__(self, name: str, part: Part) -> None:
        self._parts[name] = part

    def __delitem__(self, name: str) -> None:
        del self._parts[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)

    def name_of(self, part: Part) -> str:
        """The name under which a part stands here; a process that was handed it may not know yet.

        Raises
        ------
        KeyError
            No package registers it.
        """
        for name, registered in self._parts.items():
            if registered is part:
                return name
        for point in metadata.entry_points(group=self._group):
            if self[point.name] is part:
                return point.name
        raise KeyError(f"{part!r} is no entry point of {self._group}")
