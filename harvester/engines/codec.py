"""Serialization of an answer, the result of a task, without pickle and with all sizes checked.

An answer's file is a zip of plain arrays (.npz): a tree in JSON, the arrays that it names, and a
digest of all content. The digest finds damage and edits; it is no signature: anyone who may write
to the folder can forge it.
"""

import dataclasses
import hashlib
import io
import json
import math
import os
import re
import stat
import zipfile
from typing import Any

import numpy as np

from harvester.base import errors
from harvester.statistics.estimate import Density, Estimate
from harvester.statistics.jumps import Jumps
from harvester.statistics.moments import Moments
from harvester.statistics.output_moments import OutputMoments
from harvester.statistics.strain_moments import StrainMoments

# Largest size of a stored answer, packed or unpacked, in bytes. Typical answers have some hundred
# kilobytes.
MOST_BYTES = 32_000_000
# Errors that depend on scene and method alone; these are stored. Others may not recur.
LASTING = {
    kind.__name__: kind
    for kind in (
        errors.AveragingError,
        errors.EnergyNotBalanced,
        errors.LoadChatters,
        errors.LoadError,
        errors.NotConverged,
        errors.SimulatorAborted,
        errors.SolutionDiverged,
        errors.SpringRangeLeft,
    )
}
# Error texts of ngspice that depend on the state of the machine, not on the scene.
PASSING_REASON = re.compile(r"memory|alloc|disk|no space|too many open files", re.IGNORECASE)
TREE, DIGEST = "tree", "digest"
# Dataclasses that a stored answer may hold, by name.
_KNOWN: dict[str, type] = {
    kind.__name__: kind
    for kind in (Density, Estimate, Jumps, Moments, OutputMoments, StrainMoments)
}


class NotAnAnswer(Exception):
    """A stored file does not hold its task's answer, for the reason in the message."""


def register(kind: type) -> type:
    """Allow answers to hold instances of a dataclass; usable as a decorator."""
    _KNOWN[kind.__name__] = kind
    return kind


def is_lasting(name: str, text: str) -> bool:
    """Whether a run always ends with this error: not a time limit, not a lack of memory."""
    return name in LASTING and not PASSING_REASON.search(text)


def packed(key: str, answer: object) -> bytes:
    """Encode an answer as the bytes of its file.

    Raises TypeError if a value's type cannot be stored, NotAnAnswer if the answer is too large to
    be read back.
    """
    arrays: dict[str, Any] = {}
    tree = {"key": key, "answer": _encoded(answer, arrays)}
    arrays[TREE] = np.frombuffer(json.dumps(tree).encode(), dtype=np.uint8)
    if sum(array.nbytes for array in arrays.values()) > MOST_BYTES // 2:
        raise NotAnAnswer(f"is larger than {MOST_BYTES // 2} bytes")
    file = io.BytesIO()
    arrays[DIGEST] = np.array(digest_of(arrays))
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def unpacked(content: bytes, key: str) -> object:
    """Decode the bytes of an answer's file; raises NotAnAnswer."""
    try:
        arrays = _arrays(content)
        digest = str(arrays.pop(DIGEST))
    # Damaged content may raise any exception here, even MemoryError or RecursionError.
    except Exception as error:
        raise NotAnAnswer(
            "not a whole answer: the file is damaged, cut off or of another kind"
        ) from error
    if digest != digest_of(arrays):
        raise NotAnAnswer("its content has been changed: it does not match its digest")
    try:
        tree = json.loads(arrays[TREE].tobytes())
        if tree["key"] != key:
            raise NotAnAnswer("belongs to another task")
        return _decoded(tree["answer"], arrays)
    except NotAnAnswer:
        raise
    except Exception as error:
        raise NotAnAnswer("it has other fields than an answer") from error


def read(path: os.PathLike, key: str) -> object:
    """The answer at a path; raises FileNotFoundError or NotAnAnswer."""
    try:
        # Links are not followed, and opening a pipe does not wait for its writer.
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise NotAnAnswer(f"cannot be read: {error.strerror}") from None
    try:
        about = os.fstat(handle)
        if not stat.S_ISREG(about.st_mode):
            raise NotAnAnswer("is not a file")
        if about.st_size > MOST_BYTES:
            raise NotAnAnswer(f"has {about.st_size} bytes; the limit is {MOST_BYTES}")
        with open(handle, "rb", closefd=False) as file:
            content = file.read(MOST_BYTES + 1)
    finally:
        os.close(handle)
    return unpacked(content, key)


def digest_of(arrays: dict) -> str:
    """SHA-256 of named arrays."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {arrays[name].shape}\n".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def _encoded(value, arrays):
    """Return a value as JSON: plain values unchanged, others as a list that starts with a type."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in "biuf":
            raise TypeError(f"an array of {value.dtype} cannot be stored")
        arrays[f"a{len(arrays)}"] = value
        return ["array", f"a{len(arrays) - 1}"]
    if isinstance(value, errors.HarvesterError):
        text = "".join(character if character.isprintable() else " " for character in str(value))
        return ["error", type(value).__name__, text]
    if isinstance(value, dict):
        return ["dict", *([_encoded(k, arrays), _encoded(v, arrays)] for k, v in value.items())]
    if type(value) in (list, tuple):
        return [type(value).__name__, *(_encoded(item, arrays) for item in value)]
    if _KNOWN.get(type(value).__name__) is type(value):
        instance: Any = value
        fields = (getattr(value, attribute.name) for attribute in dataclasses.fields(instance))
        return ["object", type(value).__name__, *(_encoded(content, arrays) for content in fields)]
    raise TypeError(f"{type(value).__name__} cannot be stored")


def _decoded(tree, arrays):
    if isinstance(tree, str) and not all(line.isprintable() for line in tree.split("\n")):
        raise NotAnAnswer("holds text that cannot be printed")
    if not isinstance(tree, list):
        return tree
    kind, *content = tree
    if kind == "array":
        return arrays[content[0]]
    if kind == "error":
        return _error(*content)
    if kind == "dict":
        return {_decoded(k, arrays): _decoded(v, arrays) for k, v in content}
    if kind in ("list", "tuple"):
        values = [_decoded(item, arrays) for item in content]
        return values if kind == "list" else tuple(values)
    if kind == "object":
        registered = _KNOWN[content[0]]
        names = [attribute.name for attribute in dataclasses.fields(registered)]
        values = [_decoded(item, arrays) for item in content[1:]]
        return registered(**dict(zip(names, values, strict=True)))
    raise NotAnAnswer("holds a value of unknown type")


def _error(name, text):
    if not is_lasting(name, text):
        raise NotAnAnswer("holds an error of the machine or of a limit, which is never stored")
    if not text.isprintable():
        raise NotAnAnswer("holds text that cannot be printed")
    return LASTING[name](text)


def _arrays(content):
    """Read the named arrays of a zip file; raise if a type or a size is not allowed."""
    arrays = {}
    with zipfile.ZipFile(io.BytesIO(content)) as file:
        members = file.infolist()
        plain = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
        if sum(member.file_size for member in members) > MOST_BYTES:
            raise ValueError("too large")
        if any(member.compress_type not in plain for member in members):
            raise ValueError("unsupported compression")
        for member in members:
            arrays[member.filename.removesuffix(".npy")] = _array(file.read(member))
    return arrays


def _array(content):
    file = io.BytesIO(content)
    np.lib.format.read_magic(file)
    shape, _, kind = np.lib.format.read_array_header_1_0(file)
    # Memory is allocated only if the file holds as many bytes as the shape says.
    if kind.kind not in "biufU" or math.prod(shape) * kind.itemsize != len(content) - file.tell():
        raise ValueError("shape and size disagree")
    file.seek(0)
    return np.lib.format.read_array(file, allow_pickle=False)
