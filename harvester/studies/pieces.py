"""Finished pieces of a study: a few realizations of one point, each a file of its own.

A piece is computed in a worker process, written aside and renamed: it is on disk whole or not at
all. Its name is the digest of all that decides its numbers.
"""

import dataclasses
import hashlib
import json
import time
import zipfile
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from harvester.averaged import average
from harvester.averaging import CLOSURES
from harvester.errors import EngineNotFound, HarvesterError
from harvester.estimators import Estimate
from harvester.moments import Moments
from harvester.output import whole_file
from harvester.output_moments import OutputMoments
from harvester.realization import run

# Points of a stored waveform, evenly spaced.
WAVEFORM_POINTS = 1000
FORMAT = 1


@dataclass
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
    """

    moments: list = field(default_factory=list)
    quantities: dict = field(default_factory=dict)
    waveform: np.ndarray | None = None
    failure: str = ""
    seconds: float = 0.0


def compute(scene, engine, indices, step, window, report):
    """One piece (called in a worker). A simulation that fails is a piece that says so."""
    clock = time.perf_counter()
    try:
        if engine in CLOSURES:
            quantities = average(scene, engine).scaled_quantities
            return Piece(quantities=quantities, seconds=time.perf_counter() - clock)
        realizations = run(scene, engine, indices, step, "external", window, report)
    except EngineNotFound:
        raise
    except HarvesterError as error:
        return failed(error, time.perf_counter() - clock)
    # Nothing of a study reads histograms, by far the largest part.
    moments = [
        dataclasses.replace(each.moments, histograms=np.zeros((1, 0, 0))) for each in realizations
    ]
    waveform = realizations[0].waveform
    return Piece(
        moments=moments,
        waveform=None if waveform is None else _even(waveform),
        seconds=time.perf_counter() - clock,
    )


def failed(error, seconds=0.0):
    """The piece that stands for a simulation that came to no end."""
    return Piece(failure=f"{type(error).__name__}: {error}", seconds=seconds)


def key_of(digest, engine, indices, step, window, version):
    """SHA-256 of all that decides a piece's numbers; `digest` is the scene's."""
    content = [FORMAT, digest, engine, list(indices), step, window, version]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


class Store:
    """Pieces by key, in a folder or, without one, in memory."""

    def __init__(self, folder=None):
        self._folder = Path(folder) / "points" if folder else None
        self._held = {}

    def get(self, key):
        """The piece, or None where there is none that can be read."""
        if key not in self._held and self._folder:
            piece = _read(self._folder / f"{key}.npz")
            if piece:
                self._held[key] = piece
        return self._held.get(key)

    def put(self, key, piece):
        """Keep a piece; on return it is on disk."""
        if self._folder:
            with whole_file(self._folder / f"{key}.npz") as temporary:
                np.savez_compressed(temporary, **_arrays(piece))
        self._held[key] = piece


def _arrays(piece):
    arrays = {"failure": np.array(piece.failure), "seconds": np.array(piece.seconds)}
    if piece.waveform is not None:
        arrays["waveform"] = piece.waveform
    quantities = {name: dataclasses.astuple(e) for name, e in piece.quantities.items()}
    arrays["quantities"] = np.array(json.dumps(quantities))
    for k, moments in enumerate(piece.moments):
        for part, prefix in ((moments, f"{k}."), (moments.output, f"{k}.output.")):
            for each in dataclasses.fields(part) if part else ():
                if each.name != "output":
                    arrays[prefix + each.name] = np.asarray(getattr(part, each.name))
    return arrays


def _read(path):
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            arrays = dict(file)
    except (OSError, EOFError, ValueError, zipfile.BadZipFile, zlib.error):
        return None
    quantities = json.loads(str(arrays["quantities"]))
    moments = []
    while f"{len(moments)}.start" in arrays:
        prefix = f"{len(moments)}."
        output = None
        if f"{prefix}output.start" in arrays:
            output = OutputMoments(**_fields(arrays, f"{prefix}output."))
        moments.append(Moments(**_fields(arrays, prefix), output=output))
    return Piece(
        moments=moments,
        quantities={name: Estimate(*values) for name, values in quantities.items()},
        waveform=arrays.get("waveform"),
        failure=str(arrays["failure"]),
        seconds=float(arrays["seconds"]),
    )


def _fields(arrays, prefix):
    """Arguments of a dataclass, numbers as numbers."""
    names = [name.removeprefix(prefix) for name in arrays if name.startswith(prefix)]
    return {
        name: arrays[prefix + name] if arrays[prefix + name].ndim else arrays[prefix + name].item()
        for name in names
        if "." not in name
    }


def _even(waveform):
    time_points = np.linspace(waveform.time[0], waveform.time[-1], WAVEFORM_POINTS)
    return np.array([np.interp(time_points, waveform.time, column) for column in waveform])
