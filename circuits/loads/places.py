"""Where the elements of a load stand in its files, found again by the names that ngspice gives."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from circuits.loads.subcircuits import LoadCircuit

# Matches ngspice's flat names: letters and calls, as in "d.xload.d.xbridge.dupper". The name of a
# model follows a colon, as in "xload:ideal".
_FLAT = re.compile(r"(?<![\w.])(?:[a-z]\.)*(?:xcopy\d+[.:])?xload([.:])([^\s,;()]*[^\s,;:.()])")


def with_places(message: str, load: LoadCircuit | None) -> str:
    """A message of ngspice's with the names of a load's elements as its files give them."""
    if load is None:
        return message
    placed = _FLAT.sub(lambda match: _named(match.group(2), load), message)
    if any(element.where in placed for element in load.elements):
        return placed
    return f"{placed} (the load is {load.file})"


def _named(flat, load):
    """ "dupper (bridge.lib:24)", or the bare name of what is no element, as a node."""
    path = re.split("[.:]", flat.removesuffix("#branch"))
    # The element's letter is repeated between the calls.
    full = ".".join(part for k, part in enumerate(path) if len(part) > 1 or k == len(path) - 1)
    places = {element.name: element.where for element in load.elements}
    return f"{path[-1]} ({places[full]})" if full in places else f"{path[-1]} of the load"
