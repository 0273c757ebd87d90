"""One page of HTML with everything of an identification."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

from harvester.identification.drawing import draw, draw_posterior
from harvester.show import figures
from harvester.show.page import Verdict, facts, figure_of, page, table_of, verdict_list, wide

if TYPE_CHECKING:
    from harvester.identification.identification import Identification

LEGEND = (
    "95 % intervals, which allow for residuals that are correlated. The last third of each record "
    "was kept aside: nothing was fitted to it but the states at the beginnings of windows."
)
CAPTION = (
    "The part kept aside. Grey: measured; blue: predicted (waveforms in windows, spectra and "
    "densities from one start alone); orange: the difference in windows."
)


POSTERIOR_CAPTION = "Draws of each value and of each pair; grey: the 95 % intervals of the table."


def report(found: Identification) -> str:
    """An identification as a self-contained page of HTML."""
    first, *others = found.sentences()
    good = found.verdict.good
    header, rows = found.table()
    models = [
        (candidate.name, str(len(candidate.fitted.keys)), f"{candidate.fitted.nrmse:.2%}")
        for candidate in found.candidates
    ]
    scene = html.escape(found.scene_text())
    records = ", ".join(record.name for record in found.measurements)
    return page(
        f"{found.scene.name}: identified from {records}",
        f"scene {found.scene.digest()[:12]}",
        {
            "Verdict": verdict_list(
                [Verdict(first, good), *(Verdict(sentence, None) for sentence in others)]
            ),
            "Values": wide(table_of(header, rows)) + facts(LEGEND),
            "Figures": figure_of(
                figures.picture(draw, found), f"{found.scene.name}: proof", CAPTION
            ),
            **_posterior(found),
            "Models": wide(table_of(("model", "values", "NRMSE"), models)),
            "Scene": wide(f"<pre>{scene}</pre>"),
        },
    )


def _posterior(found):
    """The posterior's section of the page; empty if it was not sampled."""
    if not found.posterior:
        return {}
    picture = figures.picture(draw_posterior, found)
    return {"Posterior": figure_of(picture, f"{found.scene.name}: posterior", POSTERIOR_CAPTION)}
