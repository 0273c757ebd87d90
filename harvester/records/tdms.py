"""Columns of a TDMS file, written by LabVIEW and other programs of National Instruments."""

from __future__ import annotations

import importlib
import io
import logging

import numpy as np

from harvester.base.libraries import optional_library
from harvester.records.table import (
    REAL_KINDS,
    Format,
    Table,
    Unreadable,
    broken_file,
    table_of_longest,
)


def read(content: bytes) -> Table:
    """Channels as columns, with the file's scaling; names are `group/channel`.

    Raises Unreadable if it contains no numeric channel, or the longest ones have several rates.
    """
    nptdms = optional_library("nptdms", "a TDMS record", "loggers")
    # The library would log the error again on the console.
    importlib.import_module("nptdms.log").log_manager.set_level(logging.ERROR)
    broken = broken_file("TDMS file", "save the samples as .csv")
    with broken, nptdms.TdmsFile.open(io.BytesIO(content)) as file:
        table = _table(file, len(content))
        if file.file_status.incomplete_final_segment:
            table.remarks = ("the file's last segment is incomplete",)
    return table


def _table(file, most):
    groups = file.groups()
    channels = {
        channel.name if len(groups) == 1 else f"{group.name}/{channel.name}": channel
        for group in groups
        for channel in group.channels()
    }
    # Samples are not compressed, so there cannot be more of them than bytes.
    if any(len(channel) > most for channel in channels.values()):
        raise Unreadable("it claims more samples than it contains: it is truncated")
    channels = {
        name: channel
        for name, channel in channels.items()
        if channel.dtype is not None and channel.dtype.kind in REAL_KINDS + "M" and len(channel)
    }
    units = {
        name: "s" if channel.dtype.kind == "M" else str(channel.properties.get("unit_string", ""))
        for name, channel in channels.items()
    }

    def load(names):
        return {name: _numbers(channels[name][:]) for name in names}

    def steps(longest):
        step = {name: channels[name].properties.get("wf_increment", 0.0) for name in longest}
        return {f"{name}/wf_increment": float(step[name]) for name in longest}

    shapes = {name: (len(channel),) for name, channel in channels.items()}
    return table_of_longest(shapes, load, units, steps)


def _numbers(values):
    """Samples as numbers; time stamps become seconds after the first."""
    values = np.asarray(values)
    if values.dtype.kind != "M":
        return values
    return (values - values[0]) / np.timedelta64(1, "s")


FORMAT = Format(read, (b"TDSm",))
