"""A file format of a test: the rate in a line, then whole numbers of two bytes in mg."""

import numpy as np

from harvester.records.table import Format, table_of


def read(content):
    rate, _, samples = content.partition(b"\n")
    table = table_of([np.frombuffer(samples, "<i2")], ["acceleration"], ["mg"])
    table.rate = float(rate)
    return table


FORMAT = Format(read)
