"""Columns of a TDMS file, as LabVIEW and other programs of its maker write."""

from __future__ import annotations

import importlib
import io
import logging

import numpy as np

from harvester.base.libraries import optional_library
from harvester.records.arrays import REAL_KINDS, ArraysTable, rate_of
from harvester.records.table import Unreadable, broken_file


class TdmsTable(ArraysTable):
    """Channels as columns, scaled as the file says; names are `group/channel`.

    Raises Unreadable if it holds no channel of numbers, or the longest have several rates.
    """

    def __init__(self, content: bytes) -> None:
        nptdms = optional_library("nptdms", "a TDMS record", "loggers")
        # The library's log would repeat on the console what the error says.
        importlib.import_module("nptdms.log").log_manager.set_level(logging.ERROR)
        broken = broken_file("TDMS file", "save the samples as .csv")
        with broken, nptdms.TdmsFile.open(io.BytesIO(content)) as file:
            self._read(file, len(content))
            if file.file_status.incomplete_final_segment:
                self.remarks = ("the file ends within its last part",)

    def _read(self, file, most):
        groups = file.groups()
        channels = {
            channel.name if len(groups) == 1 else f"{group.name}/{channel.name}": channel
            for group in groups
            for channel in group.channels()
        }
        # Samples are not compressed: a file cannot hold more of them than bytes.
        if any(len(channel) > most for channel in channels.values()):
            raise Unreadable("it claims more samples than it holds: it is cut short")
        read = {
            name: channel
            for name, channel in channels.items()
            if channel.dtype is not None and channel.dtype.kind in REAL_KINDS + "M" and len(channel)
        }
        longest = max((len(channel) for channel in read.values()), default=0)
        steps = {
            name: float(channel.properties["wf_increment"])
            for name, channel in read.items()
            if len(channel) == longest and channel.properties.get("wf_increment", 0.0)
        }
        if len(set(steps.values())) > 1:
            raise Unreadable("its longest channels have several sampling rates: save one by itself")
        self.rate = rate_of({"wf_increment": next(iter(steps.values()), 0.0)})
        units = {
            name: str(channel.properties.get("unit_string", "")) for name, channel in read.items()
        }
        units |= {name: "s" for name, channel in read.items() if channel.dtype.kind == "M"}

        def load(names: list[str]) -> dict[str, np.ndarray]:
            return {name: _numbers(read[name][:]) for name in names}

        super().__init__({name: (len(channel),) for name, channel in read.items()}, load, units)


def _numbers(values):
    """Samples; time stamps as seconds after the first."""
    values = np.asarray(values)
    if values.dtype.kind != "M":
        return values
    return (values - values[0]) / np.timedelta64(1, "s")
