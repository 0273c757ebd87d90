"""Worker processes with one call at a time and a wall-clock limit."""

from __future__ import annotations

import contextlib
import math
import pickle
import queue
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Any

from harvester.base import numba_cache, worker_command
from harvester.base.errors import SimulatorCrashed, SimulatorTimeout
from harvester.base.temporary import TemporaryFolder

# Number of lines of a crashed process's last output that are quoted.
LAST_LINES = 3


class Worker:
    """A process of `harvester.base.worker_main`, started at the first call and after a crash.

    `folders` are appended to the process's import path.
    """

    def __init__(self, folders: Sequence[str | Path] = ()) -> None:
        self._folders = folders
        self._process: subprocess.Popen | None = None
        self._answers: queue.SimpleQueue | None = None
        self._errors: IO[bytes] | None = None
        self._workplace: TemporaryFolder | None = None
        self._closed = False
        # One thread may end the process while another starts it or reads its last output.
        self._changing = threading.RLock()

    @property
    def process_id(self) -> int | None:
        """The number of the running process, or None."""
        return self._process.pid if self._process else None

    def call(
        self,
        function: Callable,
        arguments: dict[str, Any],
        time_limit: float | None = None,
        on_progress: Callable | None = None,
    ) -> Any:
        """Call a function in the process and return its result.

        Parameters
        ----------
        function : callable
            A module-level function, with a parameter `report` in addition to its arguments.
        arguments : dict
            Passed by name, pickled.
        time_limit : float or None
            Wall-clock seconds after which the process is killed; compilation does not count.
        on_progress : callable or None
            Called with the function's reports; the latest report is also kept for errors.

        Raises
        ------
        SimulatorCrashed, SimulatorTimeout
            With the latest report as `partial`.
        HarvesterError
            As raised by the function.
        """
        process, answers = self.start()
        deadline = math.inf if time_limit is None else time.monotonic() + time_limit
        latest, compiling, began, compiled = None, 0, 0.0, 0.0
        try:
            pickle.dump((function, arguments), process.stdin)
            process.stdin.flush()
        except (BrokenPipeError, ValueError):
            raise self._crashed(process, latest) from None
        while True:
            # The deadline may be infinite; the system can wait for at most TIMEOUT_MAX.
            left = max(deadline + compiled - time.monotonic(), 0.0)
            timeout = None if compiling else min(left, threading.TIMEOUT_MAX)
            try:
                kind, content = answers.get(timeout=timeout)
            except queue.Empty:
                self.kill()
                raise SimulatorTimeout(
                    f"the simulator was stopped at its wall-clock limit of {time_limit:g} s, "
                    f"without {compiled:.0f} s of compilation; "
                    "raise it with --time-limit, or shorten run.duration",
                    partial=latest,
                ) from None
            if kind == "progress":
                latest = content
                if on_progress:
                    on_progress(content)
            elif kind == "compilation":
                now = time.monotonic()
                began = began if compiling else now
                compiling += content
                compiled += 0.0 if compiling else now - began
            elif kind == "damage":
                numba_cache.on_damage(content)
            elif kind == "done":
                return content
            elif kind in ("failed", "gone"):
                if kind == "gone":
                    self.kill()
                if getattr(content, "partial", latest) is None:
                    content.partial = latest
                raise content
            else:
                raise self._crashed(process, latest)

    def close(self) -> None:
        """End the process permanently."""
        self._closed = True
        self.kill()

    def kill(self) -> None:
        """End the process immediately."""
        with self._changing:
            process, self._process = self._process, None
            if process is not None:
                process.kill()
                process.wait()
                for stream in (process.stdin, process.stdout):
                    with contextlib.suppress(BrokenPipeError):
                        if stream is not None:
                            stream.close()
            errors, self._errors = self._errors, None
            if errors is not None:
                errors.close()
            workplace, self._workplace = self._workplace, None
            if workplace is not None:
                workplace.cleanup()

    def start(self) -> tuple[Any, Any]:
        """Start the process unless it runs; returns it and the queue of its answers."""
        with self._changing:
            if self._closed:
                raise SimulatorCrashed("the simulator was stopped")
            if self._process is not None and self._process.poll() is None:
                return self._process, self._answers
            self.kill()
            try:
                self._answers = self._open()
            except (OSError, RuntimeError, MemoryError) as error:
                self.kill()
                raise SimulatorCrashed(
                    f"the simulator's process cannot be started: {_cause(error)}; reduce "
                    "--workers, or raise the limit of processes, files or memory (see ulimit -a)"
                ) from None
            return self._process, self._answers

    def _open(self):
        """Start the process; returns the queue of its answers."""
        self._errors = errors = tempfile.TemporaryFile()  # noqa: SIM115 - closed by kill
        self._workplace = workplace = TemporaryFolder()
        self._process = process = subprocess.Popen(
            worker_command.command(self._folders),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            cwd=workplace.name,
            env=worker_command.environment(),
        )
        answers: queue.SimpleQueue = queue.SimpleQueue()
        threading.Thread(target=_read_answers, args=(process.stdout, answers), daemon=True).start()
        return answers

    def _crashed(self, process, latest):
        status = process.wait()
        with self._changing:
            words = self._last_words()
            self.kill()
        how = f"was killed by signal {-status}" if status < 0 else f"ended with status {status}"
        if status == -signal.SIGKILL:
            how += " (from outside, or for lack of memory)"
        return SimulatorCrashed(
            f"the simulator's process {how}" + (f": {words}" if words else ""), partial=latest
        )

    def _last_words(self):
        if self._errors is None:
            return ""
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").splitlines()
        return "; ".join(line.strip() for line in lines[-LAST_LINES:] if line.strip())


def _cause(error):
    return getattr(error, "strerror", None) or str(error) or "no memory"


def _read_answers(stream, answers):
    while True:
        try:
            answers.put(pickle.load(stream))
        except Exception:  # the answer is incomplete, or memory is exhausted
            answers.put(("ended", None))
            return
