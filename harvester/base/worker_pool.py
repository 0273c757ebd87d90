"""Pools that execute many calls: in worker processes, or through any executor."""

from __future__ import annotations

import atexit
import contextlib
import math
import os
import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_EXCEPTION,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from harvester.base.errors import (
    HarvesterError,
    SimulationError,
    SimulatorCrashed,
    SimulatorTimeout,
)
from harvester.base.worker_process import Worker

# Time between two checks for other events, in seconds.
LOOK_AROUND = 0.5


class Workers(Protocol):
    """Interface of all pools: a `WorkerPool`, an `ExecutorPool`, or an object of the caller."""

    def map(
        self,
        function: Callable,
        calls: Sequence[dict],
        time_limit: float | None = None,
        on_progress: Callable | None = None,
        keep_going: bool = False,
    ) -> list:
        """See `WorkerPool.map`."""


class WorkerPool:
    """Several workers that share a list of calls; use it in a `with` block.

    Parameters
    ----------
    calls : int
        Largest number of simultaneous calls.
    workers : int or None
        Number of processes; None: one per core. `size` is the number of simultaneous calls.
    folders : sequence of str or Path
        See `Worker`.
    """

    def __init__(
        self,
        calls: int | None = None,
        workers: int | None = None,
        folders: Sequence[str | Path] = (),
    ) -> None:
        size = workers or os.cpu_count() or 1
        self.size = min(size, calls or size)
        self._folders = folders
        self._open()
        # Processes start in the background; the first call raises a failure to start.
        for worker in self._workers:
            self._threads.submit(worker.start)

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
        """Call one function with several sets of arguments; returns the results in order.

        Parameters
        ----------
        function, time_limit
            As in `Worker.call`.
        calls : sequence of dict
            Arguments by name.
        on_progress : callable or None
            Called with (index, report).
        keep_going : bool
            Repeat a call once if its process crashed or timed out; if it fails again, return the
            SimulationError as its result. Otherwise the first error ends all calls and is raised.
            Other errors and interrupts are always raised. The pool can be reused.
        """
        call = call_twice if keep_going else Worker.call
        futures = []
        for index, arguments in enumerate(calls):
            report = partial(on_progress, index) if on_progress else None
            futures.append(self._begin(call, function, arguments, time_limit, report))
        try:
            return gather(futures)
        except BaseException:
            self.interrupt()
            raise

    def submit(
        self,
        function: Callable,
        arguments: dict[str, Any],
        time_limit: float | None = None,
        report: Callable | None = None,
    ) -> Future:
        """Start one call as with `keep_going` in `map`; returns its Future.

        `report` is called with the function's reports, in a thread of the pool.
        """
        return self._begin(call_twice, function, arguments, time_limit, report)

    def interrupt(self) -> None:
        """End every process and its call; the pool can be reused."""
        self.close()
        self._open()

    def close(self) -> None:
        """End every process."""
        self._closed = True
        for worker in self._workers:
            worker.close()
        self._threads.shutdown(cancel_futures=True)

    def _open(self) -> None:
        """Create new workers, whose processes are not running yet."""
        self._closed = False
        self._threads = ThreadPoolExecutor(self.size)
        self._idle: queue.SimpleQueue[Worker] = queue.SimpleQueue()
        self._workers = [Worker(self._folders) for _ in range(self.size)]
        for worker in self._workers:
            self._idle.put(worker)

    def _begin(self, *call):
        """Start one call; return its Future."""
        if self._closed:
            raise HarvesterError("runner: is closed; give an open one")
        return self._threads.submit(self._run, *call)

    def _run(self, call, function, arguments, time_limit, report):
        worker = self._idle.get()
        try:
            return call(worker, function, arguments, time_limit, report)
        finally:
            self._idle.put(worker)


class ExecutorPool:
    """A pool over any `concurrent.futures.Executor`: a process pool, Dask's, mpi4py's.

    Each executor process starts a separate worker process, so that a crash or hang of the simulator
    does not affect the executor. Progress is not reported.
    """

    # The executor queues calls itself.
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
        futures = [self._begin(function, arguments, time_limit, keep_going) for arguments in calls]
        try:
            return gather(futures)
        except HarvesterError:
            raise
        except (Exception, CancelledError) as error:
            raise lost(error) from error

    def submit(
        self,
        function: Callable,
        arguments: dict[str, Any],
        time_limit: float | None = None,
        report: Callable | None = None,
    ) -> Future:
        """See `WorkerPool.submit`; `report` is not called."""
        return self._begin(function, arguments, time_limit, True)

    def interrupt(self) -> None:
        """Do nothing: running calls of an executor cannot be interrupted."""

    def _begin(self, *call):
        """Start one call; return its Future."""
        try:
            return self._executor.submit(call_here, *call)
        # Executors have no common exception for "already shut down".
        except Exception as error:
            raise HarvesterError(
                f"executor: accepts no calls: {type(error).__name__}: {error}; give an open one"
            ) from error


@contextlib.contextmanager
def processes(
    executor: Executor | WorkerPool | ExecutorPool | None,
    workers: int | None,
    calls: int | None = None,
) -> Iterator[WorkerPool | ExecutorPool]:
    """Yield the given pool, a pool around the executor, or new workers for the block."""
    if isinstance(executor, (WorkerPool, ExecutorPool)):
        yield executor
    elif executor is not None:
        yield ExecutorPool(executor)
    else:
        with WorkerPool(calls, workers) as pool:
            yield pool


def lost(error: BaseException) -> HarvesterError:
    """The exception for a call that an executor dropped."""
    return HarvesterError(
        f"the executor lost a task: {type(error).__name__}: {error}; finished answers are kept "
        "if --output is given"
    )


def gather(futures: Sequence[Future]) -> list[Any]:
    """Results in order; the first unexpected error cancels the other calls and is raised."""
    left = set(futures)
    try:
        while left:
            # A wait of finite length can be interrupted on every system.
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
    """Make a call, repeated once after a crash or time-out; return a repeated SimulationError."""
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
    """Make a call in this thread's worker, which is kept for the next call."""
    if not hasattr(_own, "worker"):
        _own.worker = Worker()
        atexit.register(_own.worker.close)
    call = call_twice if keep_going else Worker.call
    return call(_own.worker, function, arguments, time_limit)
