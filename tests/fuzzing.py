"""What the fuzz tests share: their budget, and the check that an input ends as it should.

`FUZZ_EXAMPLES=20000 pytest tests -k fuzz` searches longer, from another beginning each time.
"""

import contextlib
import os
import signal

import effort
import hypothesis

from harvester.base.errors import HarvesterError

LONGEST_MESSAGE = 2000
# The largest of the records takes 1.6 million.
MOST_CALLS = 5_000_000
# A block that has not ended after so many seconds hangs, however busy the machine is.
FOREVER = 300.0


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
    """The block ends within `MOST_CALLS` calls, by itself or with a named error of one line."""
    previous = signal.signal(signal.SIGALRM, _too_long)
    signal.setitimer(signal.ITIMER_REAL, FOREVER)
    try:
        with effort.at_most(MOST_CALLS):
            yield
    except HarvesterError as error:
        message = str(error)
        assert message.isprintable(), message
        assert len(message) <= LONGEST_MESSAGE
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous)


def _too_long(number, frame):
    raise TimeoutError(f"no end within {FOREVER:g} s")
