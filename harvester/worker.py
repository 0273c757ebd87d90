"""A worker process: takes calls on standard input, answers on standard output.

Started by `harvester.workers` as `python -m harvester.worker`. A call is a pickled
(function, arguments), function as "module:name"; it is called with `report` on top, which sends
progress. Answers are pickled pairs: ("progress", …), ("done", result), ("failed", error).
"""

import importlib
import os
import pickle
import queue
import signal
import sys
import threading
import traceback

from harvester.errors import HarvesterError


def main():
    """Serve calls until standard input closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Libraries that print must not write between the answers.
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    calls = queue.SimpleQueue()
    threading.Thread(target=_read_calls, args=(calls,), daemon=True).start()

    def send(kind, content):
        try:
            pickle.dump((kind, content), answers)
            answers.flush()
        except BrokenPipeError:
            os._exit(0)

    while True:
        function, arguments = calls.get()
        module, _, name = function.partition(":")
        try:
            call = getattr(importlib.import_module(module), name)
            send("done", call(report=lambda content: send("progress", content), **arguments))
        except HarvesterError as error:
            send("failed", error)
        except Exception as error:
            traceback.print_exc()
            send("failed", HarvesterError(f"{type(error).__name__}: {error}"))


def _read_calls(calls):
    """Pass calls on; leave at once when the parent is gone, whatever runs."""
    stream = sys.stdin.buffer
    while True:
        try:
            calls.put(pickle.load(stream))
        except EOFError:
            os._exit(0)


if __name__ == "__main__":
    main()
