"""Values and names as messages show them: short, printable, on one line."""

import math
import reprlib

LONGEST_NAME = 300
LONGEST_VALUE = 80
# Longer whole numbers are told by their length: Python itself refuses to print the longest.
LONGEST_NUMBER_BITS = 128


class _Short(reprlib.Repr):
    def __init__(self):
        super().__init__()
        self.maxlevel = 3
        self.maxstring = self.maxother = LONGEST_VALUE

    def repr_int(self, value, level):
        bits = value.bit_length()
        if bits > LONGEST_NUMBER_BITS:
            return f"a whole number of about {math.ceil(bits * math.log10(2.0))} digits"
        return repr(value)


_SHORT = _Short()


def shown(value):
    """A value as Python writes it, shortened to one printable line.

    >>> shown(10**400), shown([1, "a\\nb"])
    ('a whole number of about 401 digits', "[1, 'a\\\\nb']")
    """
    text = " ".join(_SHORT.repr(value).split())
    return text if text.isprintable() else ascii(text)


def named(name):
    """A key, a file's name or a reason without quotes where it is short and printable.

    >>> named("run.seed"), named("run.\\x1b[31m")
    ('run.seed', "'run.\\\\x1b[31m'")
    """
    text = name if isinstance(name, str) else str(name)
    return text if text.isprintable() and 0 < len(text) <= LONGEST_NAME else shown(text)
