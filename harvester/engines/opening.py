"""Opens a runner with its folder, processes and limits."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from typing import Literal

from harvester.base.arguments import check_processes, checked_progress
from harvester.base.errors import HarvesterError, OutOfTime
from harvester.base.libraries import optional_library
from harvester.base.signatures import Count, Folder, RunnerOptions, Seconds, check_options
from harvester.base.worker_pool import ExecutorPool, WorkerPool, processes
from harvester.engines.folder import held
from harvester.engines.runner import Runner
from harvester.engines.simulate import TIME_LIMIT

__all__ = ["RunnerOptions", "open_runner"]


@contextlib.contextmanager
def open_runner(
    output: Folder | None = None,
    *,
    workers: Count | None = None,
    executor: Executor | WorkerPool | ExecutorPool | None = None,
    scheduler: str | None = None,
    time_budget: Seconds | None = None,
    time_limit: Seconds = TIME_LIMIT,
    progress: Callable[[float, str], object] | Literal[False] | None = None,
    runner: Runner | None = None,
) -> Iterator[Runner]:
    """Open a runner for the duration of a `with` block.

    Parameters
    ----------
    output : str or Path or StudyFolder or None
        Folder that stores every answer in `points/`; stored answers are reused. It is locked for
        other runs. None: answers are kept in memory.
    workers : int or None
        Number of worker processes; None: one per core.
    executor : concurrent.futures.Executor, WorkerPool, ExecutorPool or None
        Executor used instead of worker processes; results are the same.
    scheduler : str or None
        Address of a Dask scheduler, used instead of worker processes.
    time_budget : float or None
        Wall-clock seconds after which no task starts; tasks still running 5 % later are terminated.
    time_limit : float
        Wall-clock seconds of one realization.
    progress : callable or False or None
        Called with the finished share, 0 … 1, and a short description.
    runner : Runner or None
        An open runner; all other options must then be omitted.

    Raises
    ------
    HarvesterError
        A number is out of range, or the scheduler does not exist.
    FolderInUse
        Another run uses the folder.
    """
    check_processes({"executor": executor, "runner": runner})
    if runner is not None:
        yield runner
        return
    options = {"workers": workers, "time_budget": time_budget, "time_limit": time_limit}
    check_options(open_runner, {**options, "output": output, "scheduler": scheduler})
    report = checked_progress(progress) if progress else None
    deadline = time.monotonic() + time_budget if time_budget else math.inf
    with (
        held(output) if output else contextlib.nullcontext() as folder,
        _pool(workers, executor, scheduler) as pool,
    ):
        opened = Runner(pool, folder, deadline, time_limit, report)
        try:
            yield opened
        except OutOfTime as error:
            error.args = (f"{error}: {opened.remedy}", *error.args[1:])
            raise


@contextlib.contextmanager
def _pool(workers, executor, scheduler):
    """The Dask cluster's executor, or `harvester.base.worker_pool.processes`."""
    if executor is not None or scheduler is None:
        with processes(executor, workers) as pool:
            yield pool
        return
    distributed = optional_library("distributed", "--scheduler", "cluster")
    try:
        client = distributed.Client(scheduler, timeout="10s")
    except (OSError, ValueError) as error:
        raise HarvesterError(f"scheduler {scheduler}: {error}; check the address") from None
    with client:
        yield ExecutorPool(client.get_executor(pure=False))
