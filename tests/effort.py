"""A limit to the work of a block, which is the same on a busy machine: a time is not."""

import contextlib
import sys


@contextlib.contextmanager
def at_most(calls):
    """The block makes at most so many calls of functions, those of the standard library too."""
    made = 0

    def count(frame, event, argument):
        nonlocal made
        made += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(count)
    try:
        yield
    finally:
        sys.setprofile(before)
    assert made <= calls, f"{made} calls"
