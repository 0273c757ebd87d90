"""`stability`: verdicts on stiff and extreme cases of a scene.

Every case is run by every engine and every stationary method; `verdicts` compares their answers.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from harvester.base.errors import SceneError
from harvester.base.formatting import NOT_KNOWN, Printed, written
from harvester.base.serialising import plain
from harvester.engines.runner import Runner
from harvester.engines.task import Task
from harvester.results.panels import set_title
from harvester.results.view import Picture, ResultBase, View
from harvester.scene.model import Scene
from harvester.validation.stability_cases import METHODS, Case, answer, changed, default_cases
from harvester.validation.verdicts import (
    LARGEST_RESIDUAL,
    LARGEST_SIGMAS,
    LARGEST_STEP_BIAS,
    NOT_JUDGED,
    REFUSED,
    SHARP_ENOUGH,
    UNFINISHED,
    WORDS,
    WRONG,
    CaseRow,
    CaseVerdict,
    row_of_case,
)

LEGEND = (
    "a cell names the reference that it agrees with, the most accurate first: path: a fine path on "
    "the same noise; a method or a closed form: its E[V²]; grid: a stationary method's coarser grid"
)
FACE = dict(zip(WORDS, ("#A8DDB5", "#D0D0D0", "#FEE8A0", "#FDAE6B", "#CB181D"), strict=True))
INK = {WRONG: "white", REFUSED: "0.25"}
# Rows of a page, and the width of a figure in inches.
PAGE, WIDTH = 30, 12.0
# Share of the width for the names of cases, and fewest characters of a column.
NAME, SHORTEST = 0.22, 14


@dataclass(frozen=True, repr=False)
class StabilityMatrix(ResultBase):
    """All rows of one scene; the result of `harvester stability`."""

    scene: Scene
    rows: list[CaseRow]
    wall_seconds: float

    @property
    def methods(self) -> list[str]:
        return list(self.rows[0].cells)

    def cells(self, word: str) -> list[tuple[str, str, CaseVerdict]]:
        """(case title, method, verdict) of every cell with this word."""
        return [
            (row.case.title, method, verdict)
            for row in self.rows
            for method, verdict in row.cells.items()
            if verdict.word == word
        ]

    @property
    def counts(self) -> str:
        return ", ".join(f"{len(self.cells(word))} {word}" for word in WORDS)

    @property
    def wrong(self) -> list[tuple[str, str, str]]:
        """(case title, method, reason) of every wrong cell."""
        return [(title, method, verdict.reason) for title, method, verdict in self.cells(WRONG)]

    def view(self) -> View:
        """The verdict of each cell; a figure has `PAGE` rows, legible in print."""
        starts = range(0, len(self.rows), PAGE)
        pictures = [
            Picture(_draw, (self, self.rows[first : first + PAGE]), str(number) if first else "")
            for number, first in enumerate(starts, 1)
        ]
        return View(self._table(), self._findings(), pictures=pictures)

    def _table(self) -> tuple[list[str], list[list[str]]]:
        header = ["case", *self.methods, "residuals", "seconds"]
        return header, [self._cells_of(row) for row in self.rows]

    def _cells_of(self, row):
        answers = [row.answer(method) for method in self.methods]
        residuals = [
            answer.residual for answer in answers if answer and answer.residual is not None
        ]
        listed = " | ".join(f"{residual:+.2%}" for residual in residuals)
        return [
            row.case.title,
            *(row.cells[method].text() for method in self.methods),
            Printed(listed or NOT_KNOWN, max(residuals, key=abs, default=math.nan)),
            written(sum(answer.seconds for answer in answers if answer), ".1f", "s"),
        ]

    def _findings(self) -> list[str]:
        """Sentences on the verdicts, one line each; cells with the same reason share a line."""
        lines = [f"{self.counts} in {self.wall_seconds:.0f} s", LEGEND]
        lines += [f"WRONG {title}, {method}: {reason}" for title, method, reason in self.wrong]
        for word in (UNFINISHED, NOT_JUDGED, REFUSED):
            shared: dict[tuple[str, str], list[str]] = {}
            for title, method, verdict in self.cells(word):
                shared.setdefault((method, verdict.reason), []).append(title)
            lines += [
                f"{word}: {method} for {'; '.join(titles)}: {reason}"
                for (method, reason), titles in shared.items()
            ]
        return lines

    def to_dict(self) -> dict[str, Any]:
        return {
            "scene": self.scene.to_dict(),
            "seed": self.scene.run.seed,
            "wall_seconds": self.wall_seconds,
            "limits": {
                "deviation_in_standard_errors": LARGEST_SIGMAS,
                "sharpness": SHARP_ENOUGH,
                "mean_squares_along_the_path": LARGEST_STEP_BIAS,
                "energy_balance_residual": LARGEST_RESIDUAL,
            },
            "counts": {word: len(self.cells(word)) for word in WORDS},
            "cases": plain(self.rows),
        }


def matrix_of(
    scene: Scene, runner: Runner, cases: Sequence[Case] | None, step: str | float
) -> StabilityMatrix:
    """See `harvester.stability`."""
    clock = time.perf_counter()
    cases = default_cases() if cases is None else tuple(cases)
    scenes: list[Any] = []
    for case in cases:
        try:
            scenes.append(changed(scene, case))
        except SceneError as error:
            scenes.append(error)
    tasks = [
        Task(answer, {"scene": s, "method": m, "step": step}, runner.version(m), m)
        for s in scenes
        if isinstance(s, Scene)
        for m in METHODS
    ]
    outcomes = iter(runner.run(tasks))
    rows = []
    for case, variation in zip(cases, scenes, strict=True):
        refused = isinstance(variation, SceneError)
        answers = {method: variation if refused else next(outcomes) for method in METHODS}
        rows.append(row_of_case(case, variation, answers))
    return StabilityMatrix(scene, rows, time.perf_counter() - clock)


def _draw(matrix_and_rows):
    """Draw some rows of the table in colour, with the counts of the whole matrix as title."""
    from matplotlib.figure import Figure

    matrix, rows = matrix_and_rows
    words = [[row.cells[method].word for method in matrix.methods] for row in rows]
    texts = [[row.cells[method].text() for method in matrix.methods] for row in rows]
    lengths = [max(SHORTEST, *map(len, column)) for column in zip(*texts, strict=True)]
    titles = [row.case.title for row in rows]
    figure = Figure(figsize=(WIDTH, 1.4 + 0.25 * len(titles)))
    axes: Any = figure.subplots()
    axes.axis("off")
    header = [method.replace("_", " ") for method in matrix.methods]
    table = axes.table(
        [["", *header], *([title, *line] for title, line in zip(titles, texts, strict=True))],
        cellColours=[["none"] * (len(header) + 1), *(["none", *map(FACE.get, w)] for w in words)],
        colWidths=[NAME, *((1.0 - NAME) * length / sum(lengths) for length in lengths)],
        cellLoc="center",
        bbox=(0.0, 0.0, 1.0, 1.0),
        edges="closed",
    )
    table.auto_set_font_size(False)
    for (line, column), cell in table.get_celld().items():
        cell.set(edgecolor="white", linewidth=1.0)
        cell.set_fontsize(7 if line and column else 8)
        if line and column:
            cell.set_text_props(color=INK.get(words[line - 1][column - 1], "black"))
        else:
            cell.set_text_props(**({"weight": "bold"} if column else {"ha": "left"}))
    set_title(figure, f"{matrix.scene.name}: stiff and extreme cases ({matrix.counts})\n{LEGEND}")
    return figure
