"""Columns of an HDF5 file (.h5, .hdf5, .mat of version 7.3, .nc of version 4)."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any

import numpy as np

from harvester.base.libraries import optional_library
from harvester.records.table import (
    NUMBER_KINDS,
    REAL_KINDS,
    Format,
    Table,
    Unreadable,
    broken_file,
    table_of_longest,
)

# Built-in filters of HDF5 and h5py (deflate, shuffle, Fletcher's sum, szip, nbit, scale-offset,
# LZF). For others HDF5 would load a plug-in, which is executable code.
FILTERS = {1, 2, 3, 4, 5, 6, 32000}
# Largest number of objects in a file.
MOST_OBJECTS = 10_000
FILL_VALUES = {"_FillValue", "missing_value"}
PACKING = FILL_VALUES | {"scale_factor", "add_offset", "valid_range", "valid_min", "valid_max"}
UNITS = ("units", "unit", "unit_string", "Units", "Unit")
# MATLAB stores an array's class in this attribute, and internal data in these groups.
MATLAB_CLASS, MATLAB_GROUPS = "MATLAB_class", ("#refs#", "#subsystem#")
MATLAB_COMPLEX = ("real", "imag")
NUMBER_CLASSES = ("double", "single", "int", "uint")


def read(content: bytes) -> Table:
    """Samples by column; names are the data sets' paths, `path.field` for compound types.

    A unit is the data set's attribute `units`; a sampling rate is an attribute or a data set of one
    number named `fs`, `dt` or similar. Packed numbers and gaps follow the CF conventions
    (`scale_factor`, `add_offset`, `_FillValue`, `missing_value`, `valid_range`).

    `content`: the whole file; external links, external data and plug-ins are rejected. Raises
    Unreadable if it contains no such array, or refers to other files.
    """
    h5py = optional_library("h5py", "an HDF5 record", "loggers")
    broken = broken_file("HDF5 file of numbers", "save the samples as .csv or .npy")
    with broken, h5py.File(io.BytesIO(content), "r") as file:
        return _table(h5py, file)


def _table(h5py, file):
    arrays = {
        f"{path}.{field}" if field else path: (dataset, field)
        for path, dataset in _datasets(h5py, file)
        for field in _number_fields(dataset)
    }
    shapes = {n: dataset.shape for n, (dataset, _) in arrays.items() if 0 not in dataset.shape}
    # "seconds since 2026-03-01" is read as seconds.
    units = {
        name: _text_attribute(dataset, UNITS).partition(" since ")[0]
        for name, (dataset, _) in arrays.items()
    }

    def load(names):
        return {name: _decoded(name, *arrays[name]) for name in names}

    def numbers(longest):
        single = {name: _values(*array) for name, array in arrays.items() if array[0].size == 1}
        attributes = {name: float(np.ravel(v)[0]) for name, v in single.items() if np.isrealobj(v)}
        for name in longest:
            attributes |= _number_attributes(arrays[name][0], f"{name}/")
        return attributes | _number_attributes(file)

    return table_of_longest(shapes, load, units, numbers)


def _number_fields(dataset):
    """Names of a data set's numeric fields; "" for the data set itself."""
    # MATLAB's attribute distinguishes numbers from text.
    sort = _text_attribute(dataset, (MATLAB_CLASS,))
    if len(dataset.shape) > 2 or (sort and not sort.startswith(NUMBER_CLASSES)):
        return []
    # MATLAB stores a complex number as two fields; h5py has a type for it.
    names = dataset.dtype.names
    if names == MATLAB_COMPLEX:
        return [""]
    kinds = {name: dataset.dtype[name] for name in names} if names else {"": dataset.dtype}
    return [
        field
        for field, kind in kinds.items()
        if kind.names == MATLAB_COMPLEX or kind.kind in NUMBER_KINDS
    ]


def _values(dataset, field):
    values = dataset[field] if field else dataset[()]
    return values["real"] + 1j * values["imag"] if values.dtype.names == MATLAB_COMPLEX else values


def _decoded(name, dataset, field):
    """Values scaled by a data set's attributes, with NaN for missing values."""
    values, attributes = _values(dataset, field), dataset.attrs
    if "true" in str(attributes.get("_Unsigned", "")).lower():
        raise Unreadable(f"{name}: _Unsigned changes the numbers' type: save them with that type")
    packing = {key: np.ravel(attributes[key]).astype(float) for key in PACKING & {*attributes}}
    if not packing:
        return values
    for key, count in (("scale_factor", 1), ("add_offset", 1), ("valid_range", 2)):
        size = packing.get(key, np.zeros(count)).size
        if size != count:
            raise Unreadable(f"{name}: {key} has {size} numbers instead of {count}: correct it")
    low, high = packing.get("valid_range", (-np.inf, np.inf))
    missing = (values < packing.get("valid_min", low)) | (values > packing.get("valid_max", high))
    for key in FILL_VALUES & {*packing}:
        missing |= np.isin(values, packing[key])
    scaled = values * packing.get("scale_factor", 1.0) + packing.get("add_offset", 0.0)
    return np.where(missing, np.nan, scaled)


def _datasets(h5py: Any, file: Any) -> Iterator[tuple[str, Any]]:
    """Yield (path, data set) of all data sets stored in the file itself."""
    seen, pending = set(), [("", file)]
    while pending:
        path, group = pending.pop()
        for name in group:
            where = f"{path}/{name}" if path else name
            link = group.get(name, getlink=True)
            if isinstance(link, h5py.ExternalLink):
                raise Unreadable(f"{where} is a link to another file: copy its data into this one")
            # Only hard links are followed, since a soft link repeats an object or leads out of the
            # file.
            if not isinstance(link, h5py.HardLink) or name in MATLAB_GROUPS:
                continue
            entry = group[name]
            address = h5py.h5o.get_info(entry.id).addr
            if address in seen:
                continue
            seen.add(address)
            if len(seen) > MOST_OBJECTS:
                raise Unreadable(f"it contains more than {MOST_OBJECTS} objects: shorten it")
            if isinstance(entry, h5py.Group):
                pending.append((where, entry))
            elif isinstance(entry, h5py.Dataset):
                _refuse_outside(entry, where)
                yield where, entry


def _refuse_outside(dataset, where):
    """Raise if the data are in other files or need a plug-in."""
    if dataset.external or dataset.is_virtual:
        raise Unreadable(f"the data of {where} are in other files: copy them into this one")
    properties = dataset.id.get_create_plist()
    codes = {properties.get_filter(index)[0] for index in range(properties.get_nfilters())}
    if codes - FILTERS:
        raise Unreadable(
            f"{where} is packed by a filter that needs a plug-in ({min(codes - FILTERS)}): save it "
            "uncompressed, or with gzip"
        )


def _text_attribute(dataset, names):
    for name in names:
        value = dataset.attrs.get(name)
        value = value.decode(errors="replace") if isinstance(value, bytes) else value
        if isinstance(value, str):
            return value
    return ""


def _number_attributes(holder, path=""):
    """Attributes that are single numbers, by path and name."""
    attributes = {name: np.asarray(holder.attrs[name]) for name in holder.attrs}
    return {
        f"{path}{name}": float(value.ravel()[0])
        for name, value in attributes.items()
        if value.size == 1 and value.dtype.kind in REAL_KINDS
    }


FORMAT = Format(read, (b"\x89HDF\r\n\x1a\n", b"MATLAB 7.3 MAT-file"))
