"""Words that somebody else chose (names of files, keys, messages), made safe to show and to write.

What is shown goes through `one_line`; what becomes part of netlists, figures, tables and names of
files is made a name by `name` where it enters; JSON keeps every character, by `json_text`.
"""

import json
import re

# What ngspice, LTspice, shells, TeX or file systems read as more than a letter.
_MEANT = re.compile(r"""[$\\{}"'`<>|*?:;/!^]""")
# Bytes in UTF-8: leaves room in a file's name (255 bytes) for what is written behind it.
LONGEST_NAME = 150


def one_line(text):
    """Printable text on one line.

    Blanks of every kind become a space, and what cannot be printed (control characters, marks that
    turn the direction of writing, undecodable bytes) its escape.

    Examples
    --------
    >>> one_line("two\\nlines \\x1b[1m")
    'two lines \\\\x1b[1m'
    """
    text = str(text)
    return text if text.isprintable() else "".join(map(_shown, text))


def _shown(letter):
    if letter.isprintable():
        return letter
    return " " if letter.isspace() else letter.encode("unicode_escape").decode()


def name(text):
    """A name for netlists, figures, tables and files; `_` stands for what has a meaning there.

    Examples
    --------
    >>> name("run\\n.control $x{1}")
    'run_.control _x_1_'
    """
    letters = (letter if letter.isprintable() else "_" for letter in str(text))
    kept = _MEANT.sub("_", "".join(letters)).strip()
    # A first sign of these is an option, a formula or a continued line somewhere.
    kept = re.sub(r"^[-+=@.]", "_", kept)
    return kept.encode()[:LONGEST_NAME].decode(errors="ignore") or "_"


def json_text(content, indent=None):
    """JSON whose text is printable; no character is lost.

    Raises
    ------
    ValueError
        A number that is not finite.
    """
    text = json.dumps(content, indent=indent, ensure_ascii=False, allow_nan=False)
    return "".join(
        letter if letter.isprintable() or letter == "\n" else json.dumps(letter)[1:-1]
        for letter in text
    )
