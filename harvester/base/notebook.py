"""A progress bar in notebooks, for long calls without `progress`."""

from __future__ import annotations

import contextlib
import html
import sys
import time
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from typing import Any

# Shorter calls (s) show no bar, since it would only flicker.
SHOW_AFTER_SECONDS = 1.0
# Shortest time (s) between two updates, each of which is a message to the browser.
UPDATE_SECONDS = 0.1

_HAS_BAR = ContextVar("has_bar", default=False)


@contextlib.contextmanager
def progress_bar(label: str) -> Iterator[Callable[[float, str], None] | None]:
    """A function of (finished share, description) that shows a bar until the block ends.

    None outside a notebook, and within the block of another bar.
    """
    ipython = sys.modules.get("IPython")
    in_notebook = ipython and hasattr(ipython.get_ipython(), "kernel")
    if not in_notebook or _HAS_BAR.get():
        yield None
        return
    from IPython.display import HTML, display

    handles: list[Any] = []
    due = time.monotonic() + SHOW_AFTER_SECONDS

    def show(share: float, words: str = "") -> None:
        nonlocal due
        now = time.monotonic()
        if now < due:
            return
        due = now + UPDATE_SECONDS
        text = html.escape(f"{label}: {share:.0%} {words}")
        bar = HTML(f'<progress value="{share:.3f}" max="1"></progress> {text}')
        if handles:
            handles[0].update(bar)
        else:
            handles.append(display(bar, display_id=True))

    token = _HAS_BAR.set(True)
    try:
        yield show
    finally:
        _HAS_BAR.reset(token)
        if handles:
            handles[0].update(HTML(""))
