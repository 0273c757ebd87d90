"""Columns of an .IDE file, written by vibration loggers of enDAQ and Mide."""

from __future__ import annotations

import io
import logging
import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from harvester.base.libraries import optional_library
from harvester.records.table import Format, Table, Unreadable, broken_file, table_of_longest

SCHEMA = "mide_ide.xml"
# The library evaluates these elements of the file, so only numbers and ratios are allowed.
EVALUATED = ("SampleRate", "TimeCodeScale", "ValuePrecision")
NUMBER = re.compile(rb"\s*[\d.]{1,30}(e[+-]?\d{1,3})?\s*(/\s*[\d.]{1,30}\s*)?")
ACCELERATION, MICROSECONDS = "Acceleration", 1e-6


def read(content: bytes) -> Table:
    """The acceleration channel with the most samples: times, axes and their units.

    `content`: the whole file, with its calibration applied. Raises Unreadable if it contains no
    acceleration.
    """
    importer = optional_library("idelib.importer", "an .IDE record", "loggers")
    logger = logging.getLogger("idelib")
    # The level also applies to the library's child loggers.
    level = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        with broken_file(".IDE file", "export it as .csv"):
            _refuse_expressions(content)
            data = importer.openFile(io.BytesIO(content), quiet=True)
            importer.readData(data)
            return _table(data)
    finally:
        logger.setLevel(level)


def _table(data):
    sessions = {}
    for channel in data.channels.values():
        if any(_kind(axis.units)[0] == ACCELERATION for axis in channel.subchannels):
            events = channel.getSession()
            sessions[channel.name] = len(events), events, channel
    if not sessions:
        raise Unreadable("it contains no acceleration channel: name another file")
    chosen = max(sessions, key=lambda name: sessions[name][0])
    count, events, channel = sessions.pop(chosen)
    names = ["time", *(axis.name for axis in channel.subchannels)]
    units = ["s", *(_kind(axis.units)[1] for axis in channel.subchannels)]

    def load(names):
        times, *axes = events.arraySlice() if names else [np.empty(0)]
        return dict(zip(names, [MICROSECONDS * times, *axes], strict=bool(names)))

    table = table_of_longest(
        dict.fromkeys(names, (count,)), load, dict(zip(names, units, strict=True))
    )
    if sessions:
        others = ", ".join(sessions)
        table.remarks = (f"channel {chosen} is read, {others} of the same file are ignored",)
    return table


def _kind(units):
    """(quantity, unit) of an axis."""
    return units if isinstance(units, tuple) else ("", "")


def _refuse_expressions(content):
    """Raise Unreadable if an element that the library evaluates is not a number."""
    core = optional_library("ebmlite", "an .IDE record", "loggers")
    document = core.loadSchema(SCHEMA).load(io.BytesIO(content))
    for name, value in _texts(document):
        if not NUMBER.fullmatch(value):
            raise Unreadable(f"its {name} is not a number: export it as .csv")


def _texts(document: Any) -> Iterator[tuple[str, bytes]]:
    """Yield (name, text) of all elements that the library evaluates."""
    pending = [part for part in document if part.name == "RecordingProperties"]
    while pending:
        element = pending.pop()
        if element.name in EVALUATED:
            text = element.value
            yield element.name, text.encode() if isinstance(text, str) else bytes(text)
        elif isinstance(element.value, list):
            pending.extend(element.value)


FORMAT = Format(read, (b"\x1aE\xdf\xa3",))
