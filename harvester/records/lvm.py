"""Columns of a LabVIEW measurement file (.lvm)."""

from __future__ import annotations

import re

from harvester.records import text
from harvester.records.table import LARGEST_TEXT, Format, Table

END_OF_HEADER = b"***End_of_Header***"
# Maximum number of headers: one of the file and one of its segment.
MOST_HEADERS = 2
SEPARATORS = {"Comma": ","}
COMMENT = "comment"


def read(content: bytes) -> Table:
    """Samples by column; names, units and time step are read from the file's headers.

    Raises ValueError if a header has no end, or there are several segments.
    """
    parts = content.split(END_OF_HEADER)
    if len(parts) == 1:
        raise ValueError("it has no line ***End_of_Header***: save it again as an .lvm file")
    if len(parts) > MOST_HEADERS + 1:
        raise ValueError(
            f"it has {len(parts) - 2} segments, but only one can be read: save each in its own file"
        )
    # Names and samples follow the last header.
    names_line, _, samples = parts[-1].partition(b"\n")[2].lstrip(b"\r\n").partition(b"\n")
    table = text.read(samples)
    header = b"\n".join(parts[:-1]).decode("utf-8", errors="replace")
    separator = SEPARATORS.get(_value(header, "Separator", r"\s+") or "", "\t")
    names = names_line.decode("utf-8", errors="replace").strip("\r\n").split(separator)
    names = [name.strip() for name in names if name.strip().lower() != COMMENT]
    width = len(table.names)
    table.names = (names + [""] * width)[:width]
    units = (_value(header, "Y_Unit_Label", separator) or "").split(separator)
    axes = sum(name.lower().startswith("x_value") for name in table.names)
    if axes == 1 and len(units) < width:
        units = ["s", *(unit.strip() for unit in units)]
        table.units = (units + [""] * width)[:width]
    steps = (_value(header, "Delta_X", separator) or "").replace(",", ".").split()
    if _value(header, "X_Columns", separator) == "No" and steps and float(steps[0]) > 0.0:
        table.rate = 1.0 / float(steps[0])
    return table


def _value(header, key, separator):
    """Value of a header's key; None if there is no such key."""
    match = re.search(rf"^{key}{separator}(.*?)\s*$", header, re.MULTILINE)
    return match[1] if match else None


FORMAT = Format(read, (b"LabVIEW Measurement",), LARGEST_TEXT)
