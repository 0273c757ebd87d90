"""Text from outside (names of files, keys, messages), made safe to show and to write.

Displayed text goes through `one_line`, values and keys in messages through `shown` and `named`;
text that becomes part of netlists, figures, tables and names of files is made a name by `name`
where it enters; JSON keeps every character, by `json_text`.
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
# Longest name in bytes of UTF-8. A file's name has 255, so that there is room for an ending.
LONGEST_NAME = 150
# Longest name or value shown in a message, in characters.
LONGEST_NAMED = 300
LONGEST_SHOWN = 80
# Longer whole numbers are shown by their number of digits. Python itself refuses to print very long
# ones.
LONGEST_NUMBER_BITS = 128
# Limits on the words that are compared: the time is proportional to the product of their lengths.
LONGEST_MISSPELT, MOST_COMPARED = 100, 1000
# Share of common letters from which on a valid word is suggested.
LEAST_COMMON_SHARE = 0.5


def one_line(text: object) -> str:
    """Printable text on one line.

    Blanks of every kind become a space, and unprintable characters (control characters, marks that
    turn the direction of writing, undecodable bytes) its escape.

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
    # A name that begins so would be an option, a formula or a continued line somewhere.
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
    """A value as Python writes it, shortened to one printable line.

    >>> shown(10**400), shown([1, "a\\nb"])
    ('a whole number of about 401 digits', "[1, 'a\\\\nb']")
    """
    text = " ".join(_SHORT.repr(value).split())
    return text if text.isprintable() else ascii(text)


def named(name: object) -> str:
    """A key, a file's name or a reason without quotes where it is short and printable.

    >>> named("run.seed"), named("run.\\x1b[31m")
    ('run.seed', "'run.\\\\x1b[31m'")
    """
    text = name if isinstance(name, str) else str(name)
    return text if text.isprintable() and 0 < len(text) <= LONGEST_NAMED else shown(text)


def nearest(word: object, known: Iterable[str]) -> str:
    """Say " (did you mean …?)" with a space in front where a known word is close, else nothing.

    A dotted key is near by its last part too.

    >>> nearest("resistanze", ["resistance", "decay_rate"]), nearest("seed", ["run.seed", "scheme"])
    (' (did you mean resistance?)', ' (did you mean run.seed?)')
    """
    if not isinstance(word, str) or len(word) > LONGEST_MISSPELT:
        return ""
    near = [candidate for candidate in known if len(candidate) <= 2 * LONGEST_MISSPELT]
    near = near[:MOST_COMPARED]
    meant = {candidate.rpartition(".")[2]: candidate for candidate in reversed(near)}
    meant |= {candidate: candidate for candidate in near}
    close = difflib.get_close_matches(word, meant, n=1, cutoff=LEAST_COMMON_SHARE)
    return f" (did you mean {named(meant[close[0]][:LONGEST_SHOWN])}?)" if close else ""
