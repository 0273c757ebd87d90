"""What the fuzz tests share: their budget, and the check that an input ends as it should.

`FUZZ_EXAMPLES=20000 pytest tests -k fuzz` searches longer, from another beginning each time.
"""

import contextlib
import os
import signal
import time

import hypothesis

from harvester.errors import HarvesterError

LONGEST_MESSAGE = 2000
# Processor time: other processes do not count.
SECONDS = 1.0


def budget(examples):
    """Settings of a fuzz test: the same examples in every run, unless a longer one is asked for."""
    asked = os.environ.get("FUZZ_EXAMPLES")
    return hypothesis.settings(
        max_examples=int(asked or examples),
        derandomize=not asked,
        database=None,
        deadline=None,
        suppress_health_check=list(hypothesis.HealthCheck),
    )


@contextlib.contextmanager
def ends_well():
    """The block ends within a second, by itself or with a named error of one printable line."""
    previous = signal.signal(signal.SIGALRM, _too_long)
    signal.setitimer(signal.ITIMER_REAL, 10.0)
    start = time.process_time()
    try:
        yield
    except HarvesterError as error:
        message = str(error)
        assert message.isprintable(), message
        assert len(message) <= LONGEST_MESSAGE
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous)
    assert time.process_time() - start < SECONDS


def _too_long(number, frame):
    raise TimeoutError("no end within 10 s")
