"""Columns of a LabVIEW measurement file (.lvm)."""

from __future__ import annotations

import re

from harvester.records.text import TextTable

END_OF_HEADER = b"***End_of_Header***"
# Most headers: that of the file and that of its one segment.
MOST_HEADERS = 2
SEPARATORS = {"Comma": ","}
COMMENT = "comment"


class LvmTable(TextTable):
    """Samples by columns; names, units and time step are those of the file's headers.

    Raises ValueError if it has no end of a header, or several segments.
    """

    def __init__(self, content: bytes) -> None:
        parts = content.split(END_OF_HEADER)
        if not 1 < len(parts) <= MOST_HEADERS + 1:
            raise ValueError(
                f"it has {len(parts) - 1} headers, and one segment with its own is read: save each "
                "segment as a file"
            )
        # Behind the last header stand names and samples.
        last = parts[-1].partition(b"\n")[2].lstrip(b"\r\n")
        names_line, _, samples = last.partition(b"\n")
        super().__init__(samples)
        header = b"\n".join(parts[:-1]).decode("utf-8", errors="replace")
        separator = SEPARATORS.get(_value(header, "Separator", r"\s+") or "", "\t")
        names = names_line.decode("utf-8", errors="replace").strip("\r\n").split(separator)
        names = [name.strip() for name in names if name.strip().lower() != COMMENT]
        self.names = (names + [""] * self.width)[: self.width]
        units = (_value(header, "Y_Unit_Label", separator) or "").split(separator)
        axes = sum(name.lower().startswith("x_value") for name in self.names)
        without_time = self.width - len(units)
        self.units = [""] * self.width
        if axes == 1 and len(units) > 0 and without_time >= 1:
            self.units[1 : 1 + len(units)] = [unit.strip() for unit in units]
            self.units[0] = "s"
        steps = (_value(header, "Delta_X", separator) or "").replace(",", ".").split()
        if _value(header, "X_Columns", separator) == "No" and steps and float(steps[0]) > 0.0:
            self.rate = 1.0 / float(steps[0])


def _value(header, key, separator):
    """Value of a header's key, None if the header has no such key."""
    match = re.search(rf"^{key}{separator}(.*?)\s*$", header, re.MULTILINE)
    return match[1] if match else None
