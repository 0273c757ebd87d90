"""Reads netlist files into cards: comments, continuation lines and includes are resolved.

Reads netlists of LTspice and ngspice. Loads are untrusted data: an include must be within the
folder of the user's file, or one of this project's files, named without a folder.
"""

from __future__ import annotations

import codecs
import contextlib
import re
from importlib import resources
from pathlib import Path
from typing import NamedTuple

from harvester.base.errors import NetlistError

# Limits of a load with all includes: far above real loads and far below the machine's memory.
MOST_BYTES = 1_000_000
MOST_FILES = 100
DEEPEST_INCLUDE = 16
MOST_CARDS = 20_000
# Longest statement with its continuation lines, in characters.
LONGEST_CARD = 20_000

INCLUDES = (".include", ".inc", ".lib")
IGNORED = (".end", ".backanno")
_COMMENT = re.compile(r";|//|(?:^|(?<=[\s,]))\$(?=\s|$)")
# Comments with a meaning here: measures, conditions on parameters, the dialect.
_SAID = re.compile(r"\*\s*(measure|needs|dialect)\s*:", re.IGNORECASE)
MEASURE, NEEDS, DIALECT = "*measure:", "*needs:", "*dialect:"


class Card(NamedTuple):
    """One statement in lower case, and its location "file.lib:12"."""

    text: str
    where: str


def read_cards(path: Path, text: str | None = None) -> list[Card]:
    """Cards of a netlist file and of its includes, in order.

    Parameters
    ----------
    path : Path
    text : str, optional
        Content of the file; the file is then not read.

    Raises
    ------
    NetlistError
        A file is unreadable or not regular, an include is outside the folder or recursive, or a
        limit is exceeded.
    """
    path = Path(path)
    with _named(path):
        folder = path.resolve().parent
    return _Reader(folder).cards(path, path, (), text)


@contextlib.contextmanager
def _named(shown_place):
    """Convert system errors about a file to a NetlistError that names it."""
    try:
        yield
    except (OSError, RuntimeError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise NetlistError(f"{shown_place}: cannot be read: {reason}") from None


def read_text(path: Path) -> str:
    """Contents of a netlist file in any usual encoding.

    Raises
    ------
    NetlistError
    """
    return _Reader(path.parent)._text(path, path)


class _Reader:
    """Reads one load's files, with common limits on number and size."""

    def __init__(self, folder):
        self._folder = folder
        self._files = self._bytes = self._cards = 0

    def cards(self, path, shown_place, including, text=None):
        """Cards of a file, or of its `text`; `including`: the chain of files."""
        with _named(shown_place):
            real = path.resolve()
        if real in including:
            raise NetlistError(f"{shown_place}: includes itself; remove the .include")
        if len(including) >= DEEPEST_INCLUDE:
            raise NetlistError(
                f"{shown_place}: includes nest deeper than {DEEPEST_INCLUDE} files: nest fewer"
            )
        cards = []
        for card in statements(text or self._text(path, shown_place), path.name):
            if len(card.text) > LONGEST_CARD:
                raise NetlistError(
                    f"{card.where}: a statement of {len(card.text)} characters: shorten it to "
                    f"{LONGEST_CARD}"
                )
            self._cards += 1
            if self._cards > MOST_CARDS:
                raise NetlistError(
                    f"{card.where}: more than {MOST_CARDS} statements, too many for a load: remove "
                    "some"
                )
            first, _, remainder = card.text.partition(" ")
            if first.lower() in INCLUDES:
                where = f"{card.where}: {first}"
                included = _included(remainder.strip(), path.parent, self._folder, where)
                cards += self.cards(included, f"{where} {included.name}", (*including, real))
            elif first.lower() not in IGNORED:
                cards.append(Card(card.text.lower(), card.where))
        return cards

    def _text(self, path, shown_place):
        """Contents of a file in any usual encoding."""
        self._files += 1
        if self._files > MOST_FILES:
            raise NetlistError(
                f"{shown_place}: more than {MOST_FILES} files are included: include fewer"
            )
        with _named(shown_place):
            if not path.is_file():
                raise NetlistError(f"{shown_place}: is not a regular file: name a netlist file")
            # Reads at most the file's size: a file with the reported size 0 may be endless.
            size = min(path.stat().st_size, MOST_BYTES - self._bytes + 1)
            with path.open("rb") as file:
                content = file.read(size)
        self._bytes += len(content)
        if self._bytes > MOST_BYTES:
            raise NetlistError(
                f"{shown_place}: more than {MOST_BYTES // 1000} kB with its includes: shorten it"
            )
        return _decoded(content)


def _included(argument, folder_of_file, folder, where):
    """The file of an include: within `folder`, with links resolved, or in netlists/."""
    quoted = re.fullmatch(r"\"([^\"]+)\"|'([^']+)'", argument)
    name = quoted.group(1) or quoted.group(2) if quoted else argument
    if not name or (not quoted and len(name.split()) != 1):
        raise NetlistError(f"{where} {argument[:80]}: takes one file name (no library section)")
    outside = re.match(r"[/\\~]|[a-z]:", name, re.IGNORECASE) or ".." in re.split(r"[/\\]", name)
    # Windows separates folders by a backslash.
    path, shown_place = folder_of_file / name.replace("\\", "/"), f"{where} {name[:80]}"
    with _named(shown_place):
        outside = outside or not path.resolve().is_relative_to(folder)
        missing = not path.exists()
        # Files that the project's netlists include are in the same folder.
        packaged = Path(str(resources.files("netlists"))) / name
        bare = re.fullmatch(r"[\w.]+\.lib", name)
        if bare and (missing or packaged.parent == folder_of_file) and packaged.is_file():
            return packaged
    if outside:
        raise NetlistError(f"{shown_place}: is outside the load's folder: copy it into this folder")
    if missing:
        raise NetlistError(f"{shown_place}: no such file in the load's folder: check the name")
    return path


def _decoded(content):
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", errors="replace")
    if content[1:2] == b"\0":
        return content.decode("utf-16-le", errors="replace")
    # In concatenated files a byte-order mark may precede text of another encoding.
    content = content.removeprefix(codecs.BOM_UTF8)
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


def statements(text: str, name: str) -> list[Card]:
    """Statements of a netlist: comments removed, continuation lines joined, white space reduced.

    Comments "* measure: …", "* needs: …" and "* dialect: …" become one-line statements "*measure:
    …" and so on.

    Parameters
    ----------
    text : str
    name : str
        Name of the file, for messages.

    Raises
    ------
    NetlistError
    """
    cards, last = [], None
    for index, line in enumerate(re.split(r"\r\n|\r|\n", text), start=1):
        where = f"{name}:{index}"
        stripped = line.strip()
        directive = _SAID.match(stripped)
        if directive:
            stripped = f"*{directive.group(1).lower()}: {stripped[directive.end() :]}"
        elif stripped.startswith("*"):
            continue
        comment = _COMMENT.search(stripped)
        if comment:
            stripped = stripped[: comment.start()]
        stripped = " ".join(stripped.replace("µ", "u").replace("μ", "u").split())
        if not stripped:
            continue
        if not stripped.startswith("+"):
            cards.append(([stripped], where))
            last = last if directive else cards[-1]
        elif last is None:
            raise NetlistError(
                f"{where}: a line begins with + but continues no statement: remove the +"
            )
        elif stripped != "+":
            last[0].append(stripped[1:].strip())
    return [Card(" ".join(lines), where) for lines, where in cards]
