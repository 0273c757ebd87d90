"""What the command line shows: tables, and a progress bar on a terminal."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich import box
from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn
from rich.table import Table

from harvester.base.plain_text import one_line
from harvester.cli.shown import Tabled, is_quiet

if TYPE_CHECKING:
    from harvester.results.result import Result

# A progress bar appears after so many seconds; a shorter one would only flicker.
SHOW_AFTER_SECONDS = 0.5
SAY_AFTER_SECONDS = 5.0
# Width of a line in characters. It is so large that tables are never folded.
TABLE_WIDTH = 1000
# A sketch of a density: bars in steps of an eighth of the height, letters of a line, samples of the
# density within each, and the share of the peak below which its ends are left out.
HEIGHTS = " ▁▂▃▄▅▆▇█"
LETTERS, FINER, VISIBLE_SHARE = 56, 32, 0.01
# Remaining times above this (s) are shown as "centuries".
LONGEST_TOLD_SECONDS = 1e10


@contextlib.contextmanager
def progress() -> Iterator[Callable]:
    """A function (label, scene) → callback for the share done; silent when quiet.

    With None for the scene the bar shows no simulated time, but the callback's own words. Off a
    terminal there is no bar, but a line on what is left of a run that takes long.
    """
    console = Console(stderr=True)
    if is_quiet():
        yield lambda label, scene: None
        return
    if not console.is_terminal:
        with contextlib.ExitStack() as opened:
            yield lambda label, scene: opened.enter_context(contextlib.closing(_Lines(label)))
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
    # The delay begins now and not at the first report: compilation before it may take long.
    delayed_start = threading.Timer(SHOW_AFTER_SECONDS, bar.start)

    def follow(label, scene):
        total = scene and (scene.run.settle + scene.run.duration) * scene.run.realizations
        task = bar.add_task(label, total=1.0, rate="starting; the first run compiles", start=True)
        started = time.monotonic()

        def update(share, words=""):
            elapsed = time.monotonic() - started
            rate = f"{share * total / elapsed:,.0f} s/s" if total and elapsed > 0.0 else words
            rate = rate if share else f"{words}: starting; the first run compiles"
            bar.update(task, completed=share, rate=rate)

        return update

    delayed_start.daemon = True
    delayed_start.start()
    try:
        yield follow
    finally:
        delayed_start.cancel()
        delayed_start.join()
        bar.stop()


class _Lines:
    """Says how far a run is: after a few seconds, then each time its duration has doubled.

    A thread does so where nothing is reported meanwhile. If the reported share falls, a new list of
    tasks has begun.
    """

    def __init__(self, label):
        self._label, self._share = label, 0.0
        self._words = "starting; the first run compiles, a minute or so"
        # The speed is measured from the first report on, since the start takes a time of its own.
        self._first = None
        self._started, self._next = time.monotonic(), SAY_AFTER_SECONDS
        self._saying, self._closed = threading.Lock(), threading.Event()
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
        if share < 1.0:
            self._say()

    def _say(self):
        with self._saying:
            now = time.monotonic()
            elapsed = now - self._started
            if elapsed < self._next:
                return
            self._next = 2.0 * elapsed
            began, before = self._first or (now, self._share)
            left, done = self._words, self._share - before
            if self._share >= 1.0:
                left = "evaluating the results"
            elif done > 0.0:
                left = f"about {_duration((now - began) * (1.0 - self._share) / done)} more"
            share = f"{self._share:.2%} " if self._share else ""
            if not self._share and self._first:
                left = f"{left}: starting; the first run compiles"
            print(f"{self._label}: {share}after {elapsed:.0f} s, {left}", file=sys.stderr)


def _duration(seconds):
    if seconds > LONGEST_TOLD_SECONDS:
        return "centuries"
    for size, unit in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:,.0f} {unit}"
    return f"{seconds:.0f} s"


def show_table(
    content: Tabled, title: str, to_stderr: bool = False, alarms: Sequence[str] = ()
) -> None:
    """Print a result as a table, its alarms in red, and its sentences.

    On a terminal that has the letters for it, densities are sketched before the sentences.
    """
    header, rows = content.table()
    if content.scene is not None:
        title = f"{content.scene.name}: {title}"
    table = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left")
    for column, name in enumerate(header):
        words = column < 2
        table.add_column(one_line(name), justify="left" if words else "right", no_wrap=True)
    for row in rows:
        table.add_row(*map(one_line, row))
    by_method = getattr(content, "results_by_method", None)
    sketch = density_sketch(by_method()) if by_method else []
    _print(table, content.sentences(), to_stderr, alarms, sketch)


def density_sketch(results: Mapping[str, Result]) -> list[str]:
    """A line of letters for each method that knows the density of X, and one with the range.

    All lines have the same range and the same height.
    """
    import numpy as np

    curves = {
        name: result.densities["displacement"]
        for name, result in results.items()
        if "displacement" in result.densities
    }
    if not curves:
        return []
    visible = [c.centre[c.density >= VISIBLE_SHARE * c.density.max()] for c in curves.values()]
    low, high = min(centre[0] for centre in visible), max(centre[-1] for centre in visible)
    samples = low + (high - low) * (np.arange(LETTERS * FINER) + 0.5) / (LETTERS * FINER)
    heights = {
        name: np.interp(samples, c.centre, c.density).reshape(LETTERS, FINER).mean(axis=1)
        for name, c in curves.items()
    }
    top = max(row.max() for row in heights.values())
    names = max(map(len, heights))
    first = results[next(iter(curves))]
    scale, unit = first.scales.of("displacement"), first.unit("displacement")
    ends = f"{low * scale:.3g}", f"{high * scale:.3g} {unit}"
    middle = f"{'density of displacement':^{LETTERS - len(ends[0]) - len(ends[1])}}"
    return [
        *(
            f"  {name:{names}}  {''.join(HEIGHTS[round(8 * share)] for share in row / top)}"
            for name, row in heights.items()
        ),
        f"  {'':{names}}  {ends[0]}{middle}{ends[1]}",
    ]


def show_engine(engine: dict[str, Any], to_stderr: bool = False) -> None:
    """The library that was found, its features, and whether the compiled device is on."""
    features = [name for name in ("xspice", "cider", "osdi", "klu") if engine[name]]
    lines = [
        f"{engine['version']} from {engine['library']}",
        f"features: {', '.join(features) or 'none of XSPICE, CIDER, OSDI, KLU'}",
        f"compiled device: {engine['compiled_device_off'] or 'on'}",
    ]
    _print(None, lines, to_stderr)


def _print(table, lines, to_stderr, alarms=(), sketch=()):
    if is_quiet():
        return
    stream = sys.stderr if to_stderr else sys.stdout
    # As wide as the table needs: a line that runs on is better than a number that is cut off.
    console = Console(file=stream, highlight=False, markup=False, emoji=False, width=TABLE_WIDTH)
    if table is not None:
        console.print(table)
    for line in alarms:
        console.print(one_line(line), soft_wrap=True, style="bold red")
    shows_blocks = stream.isatty() and not console.no_color and not console.options.ascii_only
    for line in [*(sketch if shows_blocks else ()), *lines]:
        console.print(one_line(line), soft_wrap=True)
