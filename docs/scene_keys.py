"""Writes docs/reference/scene-keys.md from the declarations: `python docs/scene_keys.py`."""

from pathlib import Path

from harvester.device.keys import SCALED, SI
from harvester.scene.tables import KINDS, Top, all_tables

PAGE = Path(__file__).parent / "reference" / "scene-keys.md"
HEAD = """# Keys of a scene

*Generated from the declarations: every key with its meaning, its unit and the values it accepts.*

The columns SI and scaled give the unit: "·" if there is none, "–" if scenes with these `units`
cannot have the key. Keys joined by "or" are alternatives: give one. [A data
sheet](../how-to/data-sheet.md) and [a drawing](../how-to/drawing.md) show their use;
[symbols](glossary.md) lists the symbols. In scaled units, l is `length_scale` and M the mass.
"""


def page() -> str:
    """The text of the page."""
    sections = [HEAD, *_section("Outside the tables", Top)]
    for name, cls in all_tables().items():
        if cls is not KINDS:
            sections += _section(f"`[{name}]`", cls)
            continue
        for kind, excitation in cls.items():
            sections += _section(f'`[{name}]` with `kind = "{kind}"`', excitation)
    return "\n".join(sections)


def _section(title, cls):
    yield f"## {title}\n"
    for group in cls.ALTERNATIVES:
        listed = " or ".join(f"`{name}`" for name in group.keys)
        needs = "".join(
            f"; `{name}` needs {' or '.join(f'`{other}`' for other in needed)}"
            for name, needed in group.needs.items()
        )
        yield f"{'One of' if group.required else 'At most one of'} {listed}{needs}.\n"
    yield "| key | meaning | SI | scaled | accepts | default |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for name, spec in cls.KEYS.items():
        if not spec.written:
            continue
        si = (spec.unit or "·") if SI in spec.units else "–"
        scaled = (spec.scaled or "·") if SCALED in spec.units else "–"
        default = "required" if spec.required else ""
        if spec.default not in (None, "", ()):
            default = f"`{spec.default!s}`"
        accepts = spec.allowed() if len(spec.words) < 12 else "a unit"
        row = (f"`{name}`", spec.text, si, scaled, accepts, default)
        yield f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |"
    yield ""


if __name__ == "__main__":
    PAGE.write_text(page(), "utf-8")
