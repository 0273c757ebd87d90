"""A progress bar in notebooks, for long calls that were given no `progress`."""

from __future__ import annotations

import contextlib
import html
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

# A call that is shorter (s) shows no bar, which would only flicker.
SHOW_AFTER_SECONDS = 1.0

_open_bars: list[str] = []


def in_notebook() -> bool:
    """Whether the code runs in a Jupyter kernel."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    return shell is not None and hasattr(shell, "kernel")


@contextlib.contextmanager
def progress_bar(label: str) -> Iterator[Callable[[float, str], None] | None]:
    """A function of the share done and a few words that shows a bar; it goes when the block ends.

    None outside a notebook, and inside another bar's block.
    """
    if not in_notebook() or _open_bars:
        yield None
        return
    from IPython.display import HTML, display

    handles: list[Any] = []
    started = time.monotonic()

    def show(share: float, words: str = "") -> None:
        if time.monotonic() - started < SHOW_AFTER_SECONDS:
            return
        text = html.escape(f"{label}: {share:.0%} {words}")
        bar = HTML(f'<progress value="{share:.3f}" max="1"></progress> {text}')
        if handles:
            handles[0].update(bar)
        else:
            handles.append(display(bar, display_id=True))

    _open_bars.append(label)
    try:
        yield show
    finally:
        _open_bars.remove(label)
        if handles:
            handles[0].update(HTML(""))
