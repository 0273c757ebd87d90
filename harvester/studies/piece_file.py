"""A piece as bytes and back: nothing is unpickled, and nothing is believed that does not add up.

A piece's file is a zip of plain arrays (.npz) with the piece's key and a digest of all content.
The digest finds damage and edits; it is no signature: who may write the folder may forge one.
"""

import dataclasses
import hashlib
import io
import json
import math
import os
import stat
import zipfile

import numpy as np

from harvester.errors import AveragingError, EnergyNotBalanced, SimulatorAborted, SolutionDiverged
from harvester.estimates.estimate import Estimate
from harvester.record.moments import Moments
from harvester.record.output_side import OutputMoments
from harvester.scene.units import Scales

# A piece is a hundred kilobytes; more than this, packed or unpacked, is none (bytes).
MOST_BYTES = 4_000_000
# What a scene and a method decide by themselves; all else may end differently another time.
LASTING = (AveragingError, EnergyNotBalanced, SimulatorAborted, SolutionDiverged)
HEADER, DIGEST = "header", "digest"


@dataclasses.dataclass
class Piece:
    """What was computed at once.

    Attributes
    ----------
    moments : list of Moments
        Without histograms; empty for a closure and for a failure.
    quantities : dict of str to Estimate
        Of a closure, scaled units.
    waveform : ndarray, shape (len(Record._fields), WAVEFORM_POINTS), or None
        Scaled units.
    failure : str
        Error and reason in one line; empty otherwise.
    seconds : float
        Of one core.
    final : bool
        Whether another run would come to the same; a limit or the machine's trouble is not.
    """

    moments: list = dataclasses.field(default_factory=list)
    quantities: dict = dataclasses.field(default_factory=dict)
    waveform: np.ndarray | None = None
    failure: str = ""
    seconds: float = 0.0
    final: bool = True


class NotAPiece(Exception):
    """What lies under a piece's name is not the piece; the message says why."""


def packed(key, piece):
    """The bytes of a piece's file."""
    content = {
        "key": key,
        "failure": piece.failure,
        "seconds": piece.seconds,
        "quantities": {name: dataclasses.astuple(e) for name, e in piece.quantities.items()},
    }
    arrays = {HEADER: np.array(json.dumps(content))}
    if piece.waveform is not None:
        arrays["waveform"] = piece.waveform
    for k, moments in enumerate(piece.moments):
        for part, prefix in ((moments, f"{k}."), (moments.output, f"{k}.output.")):
            for each in dataclasses.fields(part) if part else ():
                if each.name != "output":
                    arrays[prefix + each.name] = np.asarray(getattr(part, each.name))
    file = io.BytesIO()
    np.savez_compressed(file, **arrays, **{DIGEST: np.array(_digest(arrays))})
    return file.getvalue()


def unpacked(content, key):
    """The piece of a file's bytes.

    Raises
    ------
    NotAPiece
    """
    try:
        arrays = _arrays(content)
        found = str(arrays.pop(DIGEST))
    # Whatever foreign bytes make the readers raise, memory and recursion included: no piece.
    except Exception as error:
        raise NotAPiece("not a whole piece: damaged, cut off or of another kind") from error
    if found != _digest(arrays):
        raise NotAPiece("its content has been changed: it does not match its digest")
    try:
        header = json.loads(str(arrays[HEADER]))
        if header["key"] != key:
            raise NotAPiece("is the piece of another key")
        return _piece(header, arrays)
    except NotAPiece:
        raise
    except Exception as error:
        raise NotAPiece("its fields are not those of a piece") from error


def read(path, key):
    """The piece at a path, or None where nothing is there.

    Raises
    ------
    NotAPiece
    """
    try:
        # Neither through a link, nor waiting for whoever writes into a pipe.
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise NotAPiece(f"cannot be read: {error.strerror}") from None
    try:
        about = os.fstat(handle)
        if not stat.S_ISREG(about.st_mode):
            raise NotAPiece("is not a file")
        if about.st_size > MOST_BYTES:
            raise NotAPiece(f"has {about.st_size} bytes, a piece at most {MOST_BYTES}")
        with open(handle, "rb", closefd=False) as file:
            content = file.read(MOST_BYTES + 1)
    finally:
        os.close(handle)
    return unpacked(content, key)


def _arrays(content):
    """The arrays of a zip by name: numbers and text, no larger than they say and may be."""
    arrays = {}
    with zipfile.ZipFile(io.BytesIO(content)) as file:
        members = file.infolist()
        plain = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
        if sum(each.file_size for each in members) > MOST_BYTES:
            raise ValueError("too large")
        if any(each.compress_type not in plain for each in members):
            raise ValueError("packed in another way")
        for each in members:
            arrays[each.filename.removesuffix(".npy")] = _array(file.read(each))
    return arrays


def _array(content):
    file = io.BytesIO(content)
    np.lib.format.read_magic(file)
    shape, _, kind = np.lib.format.read_array_header_1_0(file)
    # A shape is believed, and memory taken for it, only where so many bytes follow.
    if kind.kind not in "fiU" or math.prod(shape) * kind.itemsize != len(content) - file.tell():
        raise ValueError("absurd shape")
    file.seek(0)
    return np.lib.format.read_array(file, allow_pickle=False)


def _digest(arrays):
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {arrays[name].shape}\n".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def _piece(header, arrays):
    moments = []
    while f"{len(moments)}.start" in arrays:
        prefix = f"{len(moments)}."
        output = None
        if f"{prefix}output.start" in arrays:
            output = OutputMoments(**_fields(arrays, f"{prefix}output."))
        moments.append(Moments(**_fields(arrays, prefix), output=output))
    failure = str(header["failure"])
    quantities = {name: _estimate(*values) for name, values in header["quantities"].items()}
    if sum(map(bool, (moments, quantities, failure))) != 1:
        raise NotAPiece("holds neither one result nor one reason")
    if failure and not _is_lasting_text(failure):
        raise NotAPiece("is an outcome of its machine or of a limit, which is not kept")
    waveform = arrays.get("waveform")
    if waveform is not None and not (waveform.ndim == 2 and np.isfinite(waveform).all()):
        raise NotAPiece("its waveform is none")
    return Piece(moments, quantities, waveform, failure, float(header["seconds"]))


def _is_lasting_text(failure):
    name = failure.partition(":")[0]
    return name in {each.__name__ for each in LASTING} and failure.isprintable()


def _estimate(estimate, error, size, dimension, note):
    error, size = (None if value is None else float(value) for value in (error, size))
    Scales().of(dimension)
    if not str(note).isprintable():
        raise NotAPiece("holds text that cannot be printed")
    return Estimate(float(estimate), error, size, dimension, str(note))


def _fields(arrays, prefix):
    """Arguments of a dataclass, numbers as numbers."""
    names = [name.removeprefix(prefix) for name in arrays if name.startswith(prefix)]
    return {
        name: arrays[prefix + name] if arrays[prefix + name].ndim else arrays[prefix + name].item()
        for name in names
        if "." not in name
    }
