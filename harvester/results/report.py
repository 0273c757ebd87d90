"""`--report`: one HTML page of a result under one headline."""

from __future__ import annotations

from harvester.results.page import (
    all_facts,
    listing,
    page,
    table_in_pages,
    table_of,
    verdict_list,
    verdicts,
    wide,
)
from harvester.results.view import ResultBase
from harvester.scene.described import scene_rows


def page_of(result: ResultBase, title: str) -> str:
    """A result as an HTML page; if the result defines a page, that page."""
    view = result.view()
    if view.page:
        return view.page()
    scene, scenes = result.scene, result.scenes
    sections = {
        "Result": verdict_list(verdicts(view)),
        "Numbers": table_in_pages(*view.table),
        "Figures": "\n".join(filter(None, (picture.html(title) for picture in view.pictures))),
        "How the numbers were obtained": all_facts(view.findings),
    }
    about = ""
    if scene is not None and scenes:
        title = f"{scene.name}: {title}"
        about = f"seed {scene.run.seed}; scene {scene.digest()[:12]}"
        sections["Scene"] = wide(table_of(("key", "value"), scene_rows(scenes), "text"))
        circuits = {s.load.circuit.text: s.load.circuit.file for s in scenes if s.load.circuit}
        sections["Netlist"] = "\n".join(listing(*pair) for pair in circuits.items())
    return page(title, about, {name: html for name, html in sections.items() if html})
