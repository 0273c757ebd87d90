"""Netlist files as cards: comments, continuation lines and includes resolved, nothing judged yet.

Reads what LTspice and ngspice write. A load from elsewhere is data, so an include stays within the
folder of the file that the user named.
"""

import re
from pathlib import Path
from typing import NamedTuple

from harvester.errors import NetlistError

# Far above any load, far below what would exhaust a machine.
LARGEST_FILE = 1_000_000
DEEPEST_INCLUDE = 16

INCLUDES = (".include", ".inc", ".lib")
IGNORED = (".end", ".backanno")
_COMMENT = re.compile(r";|//|(?:^|(?<=[\s,]))\$(?=\s|$)")


class Card(NamedTuple):
    """One statement in lower case and where it begins, "file.lib:12"."""

    text: str
    where: str


def read_cards(path):
    """Cards of a netlist file and of what it includes, in order.

    Parameters
    ----------
    path : Path

    Returns
    -------
    list of Card

    Raises
    ------
    NetlistError
        A file that cannot be read, or an include that leaves its folder or includes itself.
    """
    path = Path(path)
    return _read(path, path.resolve().parent, ())


def _read(path, folder, including):
    real = path.resolve()
    if real in including:
        raise NetlistError(f"{path.name}: includes itself; take the .include out")
    if len(including) >= DEEPEST_INCLUDE:
        raise NetlistError(f"{path.name}: includes nest deeper than {DEEPEST_INCLUDE} files")
    cards = []
    for card in statements(_text(path), path.name):
        first, _, rest = card.text.partition(" ")
        if first.lower() in INCLUDES:
            included = _included(rest.strip(), path.parent, folder, f"{card.where}: {first}")
            cards += _read(included, folder, (*including, real))
        elif first.lower() not in IGNORED:
            cards.append(Card(card.text.lower(), card.where))
    return cards


def _included(argument, beside, folder, where):
    """The file of an include, inside `folder` even after symbolic links."""
    quoted = re.fullmatch(r"\"([^\"]+)\"|'([^']+)'", argument)
    name = quoted.group(1) or quoted.group(2) if quoted else argument
    if not name or (not quoted and len(name.split()) != 1):
        raise NetlistError(f"{where} {argument}: takes one file name (no section of a library)")
    outside = re.match(r"[/\\~]|[a-z]:", name, re.IGNORECASE) or ".." in re.split(r"[/\\]", name)
    path = beside / name
    if outside or not path.resolve().is_relative_to(folder):
        raise NetlistError(f"{where} {name}: lies outside the load's folder; copy it beside it")
    if not path.is_file():
        raise NetlistError(f"{where} {name}: no such file beside the load")
    return path


def _text(path):
    """Contents of a file in whatever encoding such files come."""
    try:
        if not path.is_file():
            raise NetlistError(f"{path}: no such netlist file")
        if path.stat().st_size > LARGEST_FILE:
            raise NetlistError(f"{path}: larger than {LARGEST_FILE // 1000} kB: no load's netlist")
        content = path.read_bytes()
    except OSError as error:
        raise NetlistError(f"{path}: cannot be read: {error.strerror}") from None
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", errors="replace")
    if content[1:2] == b"\0":
        return content.decode("utf-16-le", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


def statements(text, name):
    """Lines of a netlist without comments, continuations joined, blanks single.

    Parameters
    ----------
    text : str
    name : str
        Of the file, for messages.

    Returns
    -------
    list of Card

    Raises
    ------
    NetlistError
    """
    cards = []
    for index, line in enumerate(re.split(r"\r\n|\r|\n", text), start=1):
        where = f"{name}:{index}"
        stripped = line.strip()
        if stripped.startswith("*"):
            continue
        comment = _COMMENT.search(stripped)
        if comment:
            stripped = stripped[: comment.start()]
        stripped = " ".join(stripped.replace("µ", "u").replace("μ", "u").split())
        if not stripped:
            continue
        if not stripped.startswith("+"):
            cards.append(Card(stripped, where))
        elif not cards:
            raise NetlistError(f"{where}: a line begins with + and continues none")
        else:
            cards[-1] = Card(f"{cards[-1].text} {stripped[1:].strip()}", cards[-1].where)
    return cards
