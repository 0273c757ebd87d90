"""Finished pieces of a study: a few realizations of one point, each a file of its own.

A piece is computed in a worker process, written aside and renamed: it is on disk whole or not at
all. Its name is the digest of all that decides its numbers, and it holds that name and a digest
of its content: see `harvester.studies.piece_file`.
"""

import dataclasses
import hashlib
import json
import os
import re
import stat
import time
from pathlib import Path

import numpy as np

from harvester.averaging import CLOSURES
from harvester.averaging.of_scene import average
from harvester.engines.realization import run
from harvester.errors import EngineNotFound, HarvesterError
from harvester.files.writing import whole_file
from harvester.studies.piece_file import LASTING, NotAPiece, Piece, packed, read

# Points of a stored waveform, evenly spaced.
WAVEFORM_POINTS = 1000
FORMAT = 2
# Reasons that ngspice names and another hour or machine may not have.
PASSING_REASON = re.compile(r"memory|alloc|disk|no space|too many open files", re.IGNORECASE)


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
    except (HarvesterError, MemoryError, OSError) as error:
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
    text = f"{type(error).__name__}: {error}"
    return Piece(
        failure="".join(each if each.isprintable() else " " for each in text),
        seconds=seconds,
        final=isinstance(error, LASTING) and not PASSING_REASON.search(text),
    )


def key_of(digest, engine, indices, step, window, version):
    """SHA-256 of all that decides a piece's numbers; `digest` is the scene's."""
    content = [FORMAT, digest, engine, list(indices), step, window, version]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


class Store:
    """Pieces by key, in a folder or, without one, in memory.

    Attributes
    ----------
    refused : dict of str to str
        Keys to one line each: what lay under a piece's name and was none.
    """

    def __init__(self, folder=None):
        self._folder = Path(folder) / "points" if folder else None
        self._held = {}
        self.refused = {}

    @property
    def on_disk(self):
        """Whether anything outlasts this object."""
        return self._folder is not None

    def get(self, key, misfit=None):
        """The piece, or None where there is none to be believed.

        Parameters
        ----------
        key : str
        misfit : callable or None
            Given a piece that was read, says what does not fit; "" where all does.
        """
        if key not in self._held and self._folder and key not in self.refused:
            piece = self._read(key, misfit)
            if piece:
                self._held[key] = piece
        return self._held.get(key)

    def put(self, key, piece):
        """Keep a piece; on return it is on disk, if another run would come to the same."""
        self._held[key] = piece
        if self._folder and piece.final and self._is_free(key):
            with whole_file(self._path(key)) as file:
                file.write(packed(key, piece))

    def _path(self, key):
        return self._folder / f"{key}.npz"

    def _read(self, key, misfit):
        try:
            piece = read(self._path(key), key)
            wrong = misfit(piece) if piece and misfit else ""
            if wrong:
                raise NotAPiece(wrong)
        except NotAPiece as reason:
            self.refused[key] = f"{self._path(key)}: {reason}: computed again"
            return None
        return piece

    def _is_free(self, key):
        """Whether a piece may be written: what is no plain file is not ours to replace."""
        try:
            if stat.S_ISREG(os.lstat(self._path(key)).st_mode):
                return True
        except OSError:
            return True
        self.refused[key] = f"{self._path(key)}: is not a file: left there, and the piece not kept"
        return False


def _even(waveform):
    time_points = np.linspace(waveform.time[0], waveform.time[-1], WAVEFORM_POINTS)
    return np.array([np.interp(time_points, waveform.time, column) for column in waveform])
