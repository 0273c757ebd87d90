"""Worker processes: one call at a time each, with a wall-clock limit, killed when they hang."""

import atexit
import contextlib
import os
import pickle
import queue
import signal
import subprocess
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor

from harvester.engines import isolation
from harvester.errors import SimulationError, SimulatorCrashed, SimulatorTimeout

# What a process prints just before it dies of its own, in the order of interest.
LAST_LINES = 3


class Worker:
    """One process of `harvester.engines.worker`, started at its first call, again after a crash.

    Parameters
    ----------
    folders : sequence of str or Path
        For the process to import from, after all others.
    """

    def __init__(self, folders=()):
        self._folders = folders
        self._process = None
        self._answers = None
        self._errors = None
        self._workplace = None
        self._closed = False

    @property
    def process_id(self):
        """Of the running process, or None."""
        return self._process.pid if self._process else None

    def call(self, function, arguments, time_limit=None, on_progress=None):
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

    def close(self):
        """End the process and start no other."""
        self._closed = True
        self.kill()

    def kill(self):
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
    """

    def __init__(self, calls=None, workers=None, folders=()):
        size = workers or os.cpu_count() or 1
        self._threads = ThreadPoolExecutor(min(size, calls or size))
        self._idle = queue.SimpleQueue()
        self._workers = [Worker(folders) for _ in range(min(size, calls or size))]
        for worker in self._workers:
            self._idle.put(worker)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def map(
        self,
        function,
        calls,
        time_limit=None,
        on_progress=None,
        keep_going=False,
        on_result=None,
        stop=None,
    ):
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
        on_result : callable or None
            Given (index, outcome) as soon as there is one.
        stop : callable or None
            Asked now and then; once it says so, calls that have not begun are left out.

        Returns
        -------
        list
            Results, or SimulationError where a call failed; None where it was left out.
        """
        call = call_twice if keep_going else Worker.call
        futures = [
            self._threads.submit(
                self._run, call, function, index, arguments, time_limit, on_progress
            )
            for index, arguments in enumerate(calls)
        ]
        try:
            return gather(futures, on_result, stop)
        except BaseException:
            self.close()
            raise

    def close(self):
        """End every process."""
        for worker in self._workers:
            worker.close()
        self._threads.shutdown(cancel_futures=True)

    def _run(self, call, function, index, arguments, time_limit, on_progress):
        report = (lambda content: on_progress(index, content)) if on_progress else None
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

    def __init__(self, executor):
        self._executor = executor

    def map(
        self,
        function,
        calls,
        time_limit=None,
        on_progress=None,
        keep_going=False,
        on_result=None,
        stop=None,
    ):
        """See `WorkerPool.map`."""
        futures = [
            self._executor.submit(call_here, function, arguments, time_limit, keep_going)
            for arguments in calls
        ]
        return gather(futures, on_result, stop)


def gather(futures, on_result=None, stop=None):
    """Outcomes in order; the first unexpected error cancels the rest and is raised.

    `on_result` and `stop` as in `WorkerPool.map`.
    """
    place = {future: index for index, future in enumerate(futures)}
    # Each tells once that it is done: to ask all that are left would cost their number squared.
    done = queue.SimpleQueue()
    for future in futures:
        future.add_done_callback(done.put)
    left = len(futures)
    try:
        while left:
            future = _next(done)
            if future is not None:
                left -= 1
                outcome = None if future.cancelled() else future.result()
                if on_result and not future.cancelled():
                    on_result(place[future], outcome)
            if stop and stop():
                stop = None
                for each in futures:
                    each.cancel()
    except BaseException:
        for future in futures:
            future.cancel()
        raise
    return [None if future.cancelled() else future.result() for future in futures]


def _next(done):
    """The next future of the queue, or None: a finite wait lets an interrupt through anywhere."""
    try:
        return done.get(timeout=0.5)
    except queue.Empty:
        return None


def call_twice(worker, function, arguments, time_limit=None, report=None):
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


def call_here(function, arguments, time_limit, keep_going):
    """A call in this thread's own worker, which is kept for the next one."""
    if not hasattr(_own, "worker"):
        _own.worker = Worker()
        atexit.register(_own.worker.close)
    call = call_twice if keep_going else Worker.call
    return call(_own.worker, function, arguments, time_limit)
