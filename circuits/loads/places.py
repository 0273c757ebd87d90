"""Where the elements of a load stand in its files, found again by the names that ngspice gives."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

from circuits.loads.reader import NEEDS

# ngspice's flat name: letters and the calls on the way, "d.xload.xbridge.dupper"; a model's name
# follows a colon, "xload:xbridge:ideal".
_FLAT = re.compile(r"(?<![\w.])(?:[a-z]\.)*(?:xcopy\d+[.:])?xload([.:])([^\s,;()]*[^\s,;:.()])")


class Place(NamedTuple):
    """An element, a model or a need, the sub-circuit it stands in, and what it calls."""

    owner: str
    name: str
    called: str
    where: str


def places(cards: Any) -> Any:
    """Places of all elements, models and needs; a need has its text for a name.

    Parameters
    ----------
    cards : sequence of circuits.loads.reader.Card

    Returns
    -------
    tuple of Place
    """
    found, owners = [], [""]
    for card in cards:
        words = [word for word in card.text.split() if "=" not in word]
        if words[0] == ".subckt" and len(words) > 1:
            owners.append(words[1])
        elif words[0] == ".ends" and len(owners) > 1:
            owners.pop()
        elif words[0] == ".model" and len(words) > 1:
            found.append(Place(owners[-1], words[1], "", card.where))
        elif words[0] == NEEDS:
            found.append(Place(owners[-1], card.text, "", card.where))
        elif not words[0].startswith((".", "*")):
            called = words[-1] if words[0].startswith("x") else ""
            found.append(Place(owners[-1], words[0], called, card.where))
    return tuple(found)


def lines_of(load: Any) -> dict[tuple[str, str], str]:
    """Where each of a load's places stands, "file:line" by sub-circuit and name."""
    return {(each.owner, each.name): each.where for each in load.places}


def with_places(message: str, load: Any) -> str:
    """A message of ngspice's with the names of a load's elements as its files give them.

    Parameters
    ----------
    message : str
    load : circuits.loads.subcircuits.LoadCircuit or None
    """
    if load is None or not load.places:
        return message
    told = _FLAT.sub(lambda match: _named(match.group(2), load), message)
    if any(place.where in told for place in load.places):
        return told
    return f"{told} (the load is {file_of(load)})"


def file_of(load: Any) -> str:
    """The file that holds a load's own sub-circuit."""
    own = next(each for each in load.places if each.owner == load.name)
    return own.where.rpartition(":")[0]


def _named(flat, load):
    """ "dupper (bridge.lib:24)", or the bare name of what has no card of its own, as a node."""
    path = re.split("[.:]", flat.removesuffix("#branch"))
    # Between the calls stands the element's letter again.
    *calls, name = [part for k, part in enumerate(path) if len(part) > 1 or k == len(path) - 1]
    owner, found = load.name, {(place.owner, place.name): place for place in load.places}
    for call in calls:
        owner = found[owner, call].called if (owner, call) in found else None
    place = found.get((owner, name))
    return f"{name} ({place.where})" if place else f"{name} of the load"
