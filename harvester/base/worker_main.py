"""A worker process: reads calls from standard input, writes answers to standard output.

`harvester.base.worker_process` starts it with the command of `harvester.base.worker_command`. A
call is a pickled (function, arguments). The module-level function gets an additional argument
`report`, which sends progress. Answers are pickled pairs: ("progress", …), ("done", result),
("failed", error), ("damage", path of compiled code that could not be read), ("compilation", 1 or
-1) as a compilation begins or ends, and ("gone", error) from a process that ends itself.
"""

from __future__ import annotations

import contextlib
import gc
import os
import pickle
import queue
import signal
import sys
import threading
import traceback

from harvester.base import compilation, numba_cache
from harvester.base.errors import HarvesterError, SimulationError

_give_up = None


def give_up(error: BaseException) -> None:
    """Send an error as the call's answer and end this process: its code cannot be interrupted."""
    if _give_up:
        _give_up("gone", error)
    os._exit(71)


def as_answer(error: BaseException) -> HarvesterError:
    """The exception that is sent to the caller: a HarvesterError with one line."""
    if isinstance(error, HarvesterError):
        return error
    traceback.print_exception(error)
    if isinstance(error, MemoryError):
        return SimulationError(f"no memory left for the simulation: {error}".rstrip(": "))
    return HarvesterError(f"{type(error).__name__}: {error}")


def main() -> None:
    """Serve calls until standard input closes."""
    global _give_up
    gc.set_threshold(50_000)  # as in `harvester.__main__`
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Answers go to a copy of standard output, so that text from libraries cannot mix with them.
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    calls: queue.SimpleQueue = queue.SimpleQueue()
    threading.Thread(target=_read_calls, args=(calls,), daemon=True).start()

    def send(kind, content):
        try:
            pickle.dump((kind, content), answers)
            answers.flush()
        except BrokenPipeError:
            os._exit(0)

    _give_up = send
    numba_cache.on_damage = lambda path: send("damage", path)
    numba_cache.on_compilation = lambda change: send("compilation", change)
    # Nearly every call needs numba, so it is imported now; the first call reports a failed import.
    with contextlib.suppress(Exception):
        _ = compilation.numba
    while True:
        function, arguments = calls.get()
        try:
            send("done", function(report=lambda content: send("progress", content), **arguments))
        except Exception as error:
            send("failed", as_answer(error))


def _read_calls(calls):
    """Pass calls to the main thread; end immediately when the parent has ended.

    The process then removes its empty folder, since no other process will.
    """
    stream = sys.stdin.buffer
    while True:
        try:
            calls.put(pickle.load(stream))
        except EOFError:
            with contextlib.suppress(OSError):
                os.rmdir(os.getcwd())
            os._exit(0)
        except BaseException as error:
            # If a call cannot be read, the process ends: otherwise the caller would wait endlessly.
            print(f"{type(error).__name__}: {error}", file=sys.stderr, flush=True)
            os._exit(72)
