"""Frequency and impedance of a one-port Touchstone file (.s1p), read by scikit-rf."""

from __future__ import annotations

import io
import re

from harvester.base.libraries import optional_library
from harvester.records.table import (
    LARGEST_TEXT,
    Format,
    Table,
    Unreadable,
    broken_file,
    table_of,
)


def read(content: bytes) -> Table:
    """Columns of the frequency (Hz) and the complex impedance (Ω).

    Raises Unreadable if it is not such a file.
    """
    skrf = optional_library("skrf", "a Touchstone file", "analyser")
    text, scale = content.decode("utf-8", errors="replace"), 1.0
    option = re.search(r"^[ \t]*#[^!\n]*", text, re.MULTILINE)
    if not option:
        raise Unreadable("it has no option line: write its first line as # Hz S RI R 50")
    words = option[0].upper().split()
    with broken_file("Touchstone file of one port", "export it as .csv"):
        if "Y" in words and "[version]" not in text.lower():
            # Version 1 divides Y by the reference conductance, while scikit-rf 2.2 multiplies by
            # it. A reference of 1 ohm avoids the difference.
            index = words.index("R") if "R" in words else len(words)
            scale = float([*words, "R", "50"][index + 1])
            line = " ".join([*words[:index], *words[index + 2 :], "R", "1"])
            text = f"{text[: option.start()]}{line}\n{text[option.end() :]}"
        stream = io.StringIO(text)
        stream.name = "impedance.s1p"
        network = skrf.Network()
        network.read_touchstone(stream)
        columns = [network.f, scale * network.z[:, 0, 0]]
    table = table_of(columns, ["frequency", "impedance"], ["Hz", "ohm"])
    table.complexes = [1]
    return table


FORMAT = Format(read, largest=LARGEST_TEXT)
