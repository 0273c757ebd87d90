"""Output of the command line: tables, and a progress bar on a terminal."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Iterator

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn

from harvester.base.plain_text import one_line
from harvester.cli.shown import is_quiet
from harvester.results.view import Table, View

# Seconds after which a progress bar appears, so that it does not flicker in short runs.
SHOW_AFTER_SECONDS = 0.5
SAY_AFTER_SECONDS = 5.0
STARTING = "starting; the first run compiles for about a minute"
# Remaining times above this (s) are shown as "centuries".
LONGEST_TOLD_SECONDS = 1e10


@contextlib.contextmanager
def progress(
    label: str, simulated_seconds: float = 0.0
) -> Iterator[Callable[[float, str], object] | None]:
    """Yield a function of the completed share and a text that draws a progress bar; None if quiet.

    If a simulated time is given, the bar shows its rate instead of the text. If the output is not a
    terminal, lines on the remaining time of a long run replace the bar.
    """
    console = Console(stderr=True)
    if is_quiet():
        yield None
        return
    if not console.is_terminal:
        with contextlib.closing(_Lines(label)) as lines:
            yield lines
        return
    bar = Progress(
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TextColumn("{task.fields[rate]}", markup=False),
        TimeRemainingColumn(),
        console=console,
        transient=True,
    )
    task = bar.add_task(label, total=1.0, rate=STARTING)

    def update(share, words=""):
        elapsed = bar.tasks[task].elapsed or 1.0
        rate = f"{share * simulated_seconds / elapsed:,.0f} s/s" if simulated_seconds else words
        rate = rate if share else _starting(words)
        bar.update(task, completed=share, rate=rate)

    # The delay begins here and not at the first report, since a long compilation may precede it.
    delayed_start = threading.Timer(SHOW_AFTER_SECONDS, bar.start)
    delayed_start.daemon = True
    delayed_start.start()
    try:
        yield update
    finally:
        delayed_start.cancel()
        delayed_start.join()
        bar.stop()


class _Lines:
    """Print the progress after a few seconds, then each time the elapsed time has doubled.

    A thread prints, since reports may be far apart. If the reported share falls, a new list of
    tasks has begun.
    """

    def __init__(self, label):
        self._label, self._share, self._words = label, 0.0, STARTING
        # The speed is measured from the first report on, to exclude the start-up.
        self._first = None
        self._started, self._next = time.monotonic(), SAY_AFTER_SECONDS
        self._closed = threading.Event()
        threading.Thread(target=self._watch, daemon=True).start()

    def close(self):
        self._closed.set()

    def _watch(self):
        while not self._closed.wait(self._next - (time.monotonic() - self._started)):
            self._say()

    def __call__(self, share, words=""):
        if self._first is None or share < self._share:
            self._first = time.monotonic(), share
        self._share, self._words = share, words

    def _say(self):
        now = time.monotonic()
        elapsed = now - self._started
        if elapsed < self._next:
            return
        self._next = 2.0 * elapsed
        began, before = self._first or (now, self._share)
        remaining, done = self._words, self._share - before
        if self._share >= 1.0:
            remaining = "evaluating the results"
        elif done > 0.0:
            remaining = f"about {_duration((now - began) * (1.0 - self._share) / done)} more"
        elif self._first and not self._share:
            remaining = _starting(self._words)
        share = f"{self._share:.2%} " if self._share else ""
        print(f"{self._label}: {share}after {elapsed:.0f} s, {remaining}", file=sys.stderr)


def _starting(words):
    return f"{words}: {STARTING}" if words else STARTING


def _duration(seconds):
    if seconds > LONGEST_TOLD_SECONDS:
        return "centuries"
    for size, unit in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:,.0f} {unit}"
    return f"{seconds:.0f} s"


def show_view(view: View, title: str, to_stderr: bool = False) -> None:
    """Print a result's table, its alarms in red, and its findings.

    If the terminal's encoding supports it, densities are drawn before the findings.
    """
    from harvester.results.terminal import density_sketch, laid_out

    if is_quiet():
        return
    stream = sys.stderr if to_stderr else sys.stdout
    console = Console(file=stream, highlight=False, markup=False, emoji=False, soft_wrap=True)
    blocks, footnotes = laid_out(Table(*view.table), console.width)
    for number, block in enumerate(blocks):
        console.print(one_line(f"{title}, further columns" if number else title))
        console.print(block, soft_wrap=False)
    sketched = console.is_terminal and not console.no_color and not console.options.ascii_only
    sketch = density_sketch(view.methods) if sketched else []
    plain = [*sketch, *view.findings]
    for lines, style in ((footnotes, ""), (view.alarms, "bold red"), (plain, "")):
        for line in lines:
            console.print(one_line(line), style=style)
