"""Where the elements of a load stand in its files, found again by the names that ngspice gives."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from circuits.loads.subcircuits import LoadCircuit

# Matches ngspice's flat names: letters and calls, as in "d.xload.d.xbridge.dupper". The name of a
# model follows a colon, as in "xload:ideal".
_FLAT = re.compile(
    r"(?<![\w.])(?:[a-z]\.)*(?:xcopy\d+[.:])?xload[.:]([^\s,;()\"]*[^\s,;:.()\"])(\"?)"
)
# Matches the nodes at a load's pins and the current into it.
_PIN = re.compile(r'"(?:load_(out|ref)|load_\w+|vload#branch)"')
# Letters of elements, those first that Newton's iterations fail at most often.
_LETTERS = "bmqjdswegfhvilcr"
# At most so many elements at a node are named.
NAMED = 2


def with_places(message: str, load: LoadCircuit | None) -> str:
    """A message of ngspice's with the names of a load's elements as its files give them."""
    if load is None:
        return message
    told = _PIN.sub(lambda pin: f'"xload.{pin.group(1) or "p"}"', message)
    told = _FLAT.sub(lambda match: _named(match.group(1), match.group(2), load), told)
    if any(each.where in told for each in load.elements):
        return told
    return f"{told} (the load is {load.file})"


def _named(flat, quote, load):
    """ "dupper (bridge.lib:24)", or the bare name of what is no element, as a node."""
    path = re.split("[.:]", flat.removesuffix("#branch"))
    # The element's letter is repeated between the calls.
    full = ".".join(part for k, part in enumerate(path) if len(part) > 1 or k == len(path) - 1)
    places = {each.name: each.where for each in load.elements}
    if full in places:
        return f"{path[-1]}{quote} ({places[full]})"
    near = [each for each in load.elements if full in each.nodes]
    near.sort(key=lambda each: _LETTERS.find(each.letter))
    names = " and ".join(f"{each.name} ({each.where})" for each in near[:NAMED])
    return f"{path[-1]}{quote} of the load" + (f", at {names}" if names else "")
