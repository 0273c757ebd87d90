"""Worker processes: one call at a time each, with a wall-clock limit, killed when they hang."""

from __future__ import annotations

import atexit
import contextlib
import math
import os
import pickle
import queue
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from harvester.engines import isolation
from harvester.errors import SimulationError, SimulatorCrashed, SimulatorTimeout

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future

# What a process prints just before it dies of its own, in the order of interest.
LAST_LINES = 3
# Between looks at what else there is (s).
LOOK_AROUND = 0.5


class Workers(Protocol):
    """What carries out calls: a `WorkerPool`, an `ExecutorPool`, or one's own."""

    def map(
        self,
        function: Callable,
        calls: Sequence[dict],
        time_limit: float | None = None,
        on_progress: Callable | None = None,
        keep_going: bool = False,
    ) -> list:
        """See `WorkerPool.map`."""


class Worker:
    """One process of `harvester.engines.worker`, started at its first call, again after a crash.

    Parameters
    ----------
    folders : sequence of str or Path
        For the process to import from, after all others.
    """

    def __init__(self, folders: Sequence[str | Path] = ()) -> None:
        self._folders = folders
        self._process = None
        self._answers = None
        self._errors = None
        self._workplace = None
        self._closed = False

    @property
    def process_id(self) -> int | None:
        """Of the running process, or None."""
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
            Of a module; it takes `report` besides its arguments.
        arguments : dict
            Passed by name, pickled.
        time_limit : float or None
            Wall-clock seconds after which the process is killed.
        on_progress : callable or None
            Given what the function reports; the latest report is also kept for errors.

        Raises
        ------
        SimulatorCrashed, SimulatorTimeout
            With the latest report as `partial`.
        HarvesterError
            As raised by the function.
        """
        process, answers = self._start()
        deadline = None if time_limit is None else time.monotonic() + time_limit
        latest = None
        try:
            pickle.dump((function, arguments), process.stdin)
            process.stdin.flush()
        except (BrokenPipeError, ValueError):
            raise self._crashed(process, latest) from None
        while True:
            timeout = None if deadline is None else max(deadline - time.monotonic(), 0.0)
            try:
                kind, content = answers.get(timeout=timeout)
            except queue.Empty:
                self.kill()
                raise SimulatorTimeout(
                    f"the simulator was stopped at its wall-clock limit of {time_limit:g} s; "
                    "raise it with --time-limit, or shorten run.duration",
                    partial=latest,
                ) from None
            if kind == "progress":
                latest = content
                if on_progress:
                    on_progress(content)
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
        """End the process and start no other."""
        self._closed = True
        self.kill()

    def kill(self) -> None:
        """End the process at once, whatever it does."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            for stream in (process.stdin, process.stdout):
                with contextlib.suppress(BrokenPipeError):
                    stream.close()
        errors, self._errors = self._errors, None
        if errors is not None:
            errors.close()
        workplace, self._workplace = self._workplace, None
        if workplace is not None:
            workplace.cleanup()

    def _start(self):
        """The running process and the queue of its answers."""
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
                f"the simulator's process cannot be started: {_cause(error)}; raise the limit "
                "(ulimit -a shows it) or take fewer --workers"
            ) from None
        return self._process, self._answers

    def _open(self):
        """Start the process; returns the queue of its answers."""
        isolation.check_memory()
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - closed by kill
        self._workplace = tempfile.TemporaryDirectory(
            prefix="harvester-", ignore_cleanup_errors=True
        )
        self._process = subprocess.Popen(
            isolation.command(self._folders),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            cwd=self._workplace.name,
            env=isolation.environment(),
        )
        answers = queue.SimpleQueue()
        threading.Thread(
            target=_read_answers, args=(self._process.stdout, answers), daemon=True
        ).start()
        return answers

    def _crashed(self, process, latest):
        status = process.wait()
        words = "" if self._process is None else self._last_words()
        self.kill()
        how = f"was killed by signal {-status}" if status < 0 else f"ended with status {status}"
        if status == -signal.SIGKILL:
            how += " (from outside, or for want of memory)"
        return SimulatorCrashed(
            f"the simulator's process {how}" + (f": {words}" if words else ""), partial=latest
        )

    def _last_words(self):
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").splitlines()
        return "; ".join(line.strip() for line in lines[-LAST_LINES:] if line.strip())


def _cause(error):
    return getattr(error, "strerror", None) or str(error) or "no memory"


def _read_answers(stream, answers):
    while True:
        try:
            answers.put(pickle.load(stream))
        except Exception:  # cut short, or no memory for it
            answers.put(("ended", None))
            return


class WorkerPool:
    """Several workers that share a list of calls; use it in a `with` block.

    Parameters
    ----------
    calls : int
        Most calls at a time that will be asked for.
    workers : int or None
        Processes; None: one per core.
    folders : sequence of str or Path
        See `Worker`.

    Attributes
    ----------
    size : int
        Calls that are made at a time.
    """

    def __init__(
        self,
        calls: int | None = None,
        workers: int | None = None,
        folders: Sequence[str | Path] = (),
    ) -> None:
        size = workers or os.cpu_count() or 1
        self.size = min(size, calls or size)
        self._threads = ThreadPoolExecutor(self.size)
        self._idle: queue.SimpleQueue[Worker] = queue.SimpleQueue()
        self._workers = [Worker(folders) for _ in range(self.size)]
        for worker in self._workers:
            self._idle.put(worker)

    def __enter__(self) -> WorkerPool:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def map(
        self,
        function: Callable,
        calls: Sequence[dict[str, Any]],
        time_limit: float | None = None,
        on_progress: Callable | None = None,
        keep_going: bool = False,
    ) -> list[Any]:
        """Outcomes of one function over several argument sets, in their order.

        Parameters
        ----------
        function : callable
            See `Worker.call`.
        calls : sequence of dict
            Arguments by name.
        time_limit : float or None
            Wall-clock seconds of each call.
        on_progress : callable or None
            Given (index, report).
        keep_going : bool
            Make a call whose process crashed or ran out of time once more, and let a
            SimulationError that stays stand in the place of its result. Without it the first
            error ends the other calls and is raised, as any other error and an interrupt do.

        Returns
        -------
        list
            Results, or SimulationError where a call failed.
        """
        call = call_twice if keep_going else Worker.call
        futures = [
            self._threads.submit(
                self._run, call, function, arguments, time_limit, _of_one(on_progress, index)
            )
            for index, arguments in enumerate(calls)
        ]
        try:
            return gather(futures)
        except BaseException:
            self.close()
            raise

    def submit(
        self, function: Callable, arguments: dict[str, Any], time_limit: float | None = None
    ) -> Future:
        """One call as with `keep_going` in `map`; returns its Future."""
        return self._threads.submit(self._run, call_twice, function, arguments, time_limit, None)

    def close(self) -> None:
        """End every process."""
        for worker in self._workers:
            worker.close()
        self._threads.shutdown(cancel_futures=True)

    def _run(self, call, function, arguments, time_limit, report):
        worker = self._idle.get()
        try:
            return call(worker, function, arguments, time_limit, report)
        finally:
            self._idle.put(worker)


class ExecutorPool:
    """The same over any `concurrent.futures.Executor`: a process pool, Dask's, mpi4py's.

    Each of the executor's processes keeps one worker process of its own, so that a crash or a
    hang of the simulator never reaches the executor. There is no progress.
    """

    # It queues them itself, and knows how many processes there are.
    size = math.inf

    def __init__(self, executor: Executor) -> None:
        self._executor = executor

    def map(
        self,
        function: Callable,
        calls: Sequence[dict[str, Any]],
        time_limit: float | None = None,
        on_progress: Callable | None = None,
        keep_going: bool = False,
    ) -> list[Any]:
        """See `WorkerPool.map`."""
        futures = [
            self._executor.submit(call_here, function, arguments, time_limit, keep_going)
            for arguments in calls
        ]
        return gather(futures)

    def submit(
        self, function: Callable, arguments: dict[str, Any], time_limit: float | None = None
    ) -> Future:
        """See `WorkerPool.submit`."""
        return self._executor.submit(call_here, function, arguments, time_limit, True)


def _of_one(on_progress, index):
    """A report of one of several calls."""
    return (lambda content: on_progress(index, content)) if on_progress else None


def gather(futures: Sequence[Future]) -> list[Any]:
    """Outcomes in order; the first unexpected error cancels the rest and is raised."""
    left = set(futures)
    try:
        while left:
            # A finite wait lets an interrupt through anywhere.
            done, left = wait(left, LOOK_AROUND, FIRST_EXCEPTION)
            for future in done:
                future.result()
    except BaseException:
        for future in futures:
            future.cancel()
        raise
    return [future.result() for future in futures]


def call_twice(
    worker: Worker,
    function: Callable,
    arguments: dict[str, Any],
    time_limit: float | None = None,
    report: Callable | None = None,
) -> Any:
    """One call, repeated once after a crash or a time-out; a SimulationError is returned."""
    try:
        return worker.call(function, arguments, time_limit, report)
    except (SimulatorCrashed, SimulatorTimeout):
        pass
    except SimulationError as error:
        return error
    try:
        return worker.call(function, arguments, time_limit, report)
    except SimulationError as error:
        return error


_own = threading.local()


def call_here(
    function: Callable, arguments: dict[str, Any], time_limit: float | None, keep_going: bool
) -> Any:
    """A call in this thread's own worker, which is kept for the next one."""
    if not hasattr(_own, "worker"):
        _own.worker = Worker()
        atexit.register(_own.worker.close)
    call = call_twice if keep_going else Worker.call
    return call(_own.worker, function, arguments, time_limit)
