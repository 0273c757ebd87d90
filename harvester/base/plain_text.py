"""Sanitizes external text (file names, keys, messages) for display and for files.

Displayed text passes through `one_line`, values and keys in messages through `shown` and `named`.
Text for netlists, figures, tables and file names is converted by `name` when it is read.
`json_text` keeps every character.
"""

from __future__ import annotations

import difflib
import json
import math
import re
import reprlib
from collections.abc import Iterable
from typing import Any

# Characters with a meaning in ngspice, LTspice, shells, TeX or file systems.
_MEANT = re.compile(r"""[$\\{}"'`<>|*?:;/!^]""")
# Longest name in bytes of UTF-8: file names may have 255, which leaves room for a suffix.
LONGEST_NAME = 150
# Longest name or value shown in a message, in characters.
LONGEST_NAMED = 300
LONGEST_SHOWN = 80
# Longer integers are shown by their number of digits: Python does not print very long ones.
LONGEST_NUMBER_BITS = 128
# Limits on compared words: the time is proportional to the product of their lengths.
LONGEST_MISSPELT, MOST_COMPARED = 100, 1000
# Smallest share of common letters for which a valid word is suggested.
LEAST_COMMON_SHARE = 0.6


def one_line(text: object) -> str:
    """Printable text on one line.

    White space becomes a space; unprintable characters (control characters, marks of the writing
    direction, undecodable bytes) become their escapes.

    Examples
    --------
    >>> one_line("two\\nlines \\x1b[1m")
    'two lines \\\\x1b[1m'
    """
    text = str(text)
    if text.isprintable():
        return text
    letters = (" " if letter.isspace() else letter for letter in text)
    return "".join(
        letter if letter.isprintable() else letter.encode("unicode_escape").decode()
        for letter in letters
    )


def name(text: object) -> str:
    """A name for netlists, figures, tables and files; `_` replaces special characters.

    Examples
    --------
    >>> name("run\\n.control $x{1}")
    'run_.control _x_1_'
    """
    letters = (letter if letter.isprintable() else "_" for letter in str(text))
    cleaned = _MEANT.sub("_", "".join(letters)).strip()
    # A name with such a first character could be read as an option, a formula or a continued line.
    cleaned = re.sub(r"^[-+=@.]", "_", cleaned)
    return cleaned.encode()[:LONGEST_NAME].decode(errors="ignore") or "_"


def json_text(content: Any, indent: int | None = None) -> str:
    """JSON whose text is printable; no character is lost.

    Raises ValueError for a number that is not finite.
    """
    text = json.dumps(content, indent=indent, ensure_ascii=False, allow_nan=False)
    return "".join(
        letter if letter.isprintable() or letter == "\n" else json.dumps(letter)[1:-1]
        for letter in text
    )


class _Short(reprlib.Repr):
    def __init__(self):
        super().__init__()
        self.maxlevel = 3
        self.maxstring = self.maxother = LONGEST_SHOWN

    def repr_int(self, value, level):
        bits = value.bit_length()
        if bits > LONGEST_NUMBER_BITS:
            return f"a whole number of about {math.ceil(bits * math.log10(2.0))} digits"
        return repr(value)


_SHORT = _Short()


def shown(value: Any) -> str:
    """A value in Python's notation, shortened to one printable line.

    >>> shown(10**400), shown([1, "a\\nb"])
    ('a whole number of about 401 digits', "[1, 'a\\\\nb']")
    """
    text = " ".join(_SHORT.repr(value).split())
    # Values in lists are shortened one by one.
    text = text if len(text) <= 2 * LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}…"
    return text if text.isprintable() else ascii(text)


def named(name: object) -> str:
    """A key, a file's name or a reason; quoted unless it is short and printable.

    >>> named("run.seed"), named("run.\\x1b[31m")
    ('run.seed', "'run.\\\\x1b[31m'")
    """
    text = name if isinstance(name, str) else str(name)
    return text if text.isprintable() and 0 < len(text) <= LONGEST_NAMED else shown(text)


def nearest(word: object, known: Iterable[str]) -> str:
    """ " (did you mean …?)" if a known word is similar, else "".

    The last part of a dotted key is also compared. The hyphens of options are not.

    >>> nearest("resistanze", ["resistance", "decay_rate"]), nearest("seed", ["run.seed", "scheme"])
    (' (did you mean resistance?)', ' (did you mean run.seed?)')
    >>> nearest("--st", ["--set"]), nearest("--set", ["--quiet"])
    (' (did you mean --set?)', '')
    """
    if not isinstance(word, str) or len(word) > LONGEST_MISSPELT:
        return ""
    near = [candidate for candidate in known if len(candidate) <= 2 * LONGEST_MISSPELT]
    near = near[:MOST_COMPARED]
    meant = {candidate.rpartition(".")[2]: candidate for candidate in reversed(near)}
    meant |= {candidate.lstrip("-"): candidate for candidate in near}
    word = word.lstrip("-")
    close = difflib.get_close_matches(word, meant, n=1, cutoff=LEAST_COMMON_SHARE)
    return f" (did you mean {named(meant[close[0]][:LONGEST_SHOWN])}?)" if close else ""
