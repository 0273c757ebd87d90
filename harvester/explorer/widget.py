"""The sliders of `explore`, by ipywidgets."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING, Any

from ipywidgets import HTML, FloatLogSlider, FloatSlider, GridBox, Image, Layout, VBox

from harvester.errors import HarvesterError
from harvester.explorer.explorer import LOGARITHMIC_RATIO
from harvester.files.plain_text import one_line
from harvester.scene.numbers import number

if TYPE_CHECKING:
    from harvester.explorer.explorer import Explorer

# Steps of a slider.
STEPS = 100
# Opacity of a picture that does not belong to the present setting of the sliders.
LOST = "0.35"


def built(explorer: Explorer) -> Any:
    """Sliders, a line of text and the picture, which follow the explorer."""
    line, picture = HTML(), Image(format="png")
    picture.layout.max_width = "100%"
    origin = explorer.scene
    sliders = {
        key: _slider(key, number(origin, key, "explore")[0], *ends)
        for key, ends in explorer.ranges.items()
    }

    def show() -> None:
        view = explorer.view
        solver = f" No stationary solver: {view.refusal}" if view.refusal else ""
        line.value = _line(f"{view.sentence()} ({view.seconds:.1f} s).{solver}")
        picture.value, picture.layout.opacity = explorer.picture, "1"

    def follow(_: object) -> None:
        line.value = _line("…")
        try:
            explorer.at({key: slider.value for key, slider in sliders.items()})
        except HarvesterError as error:
            line.value, picture.layout.opacity = _line(str(error), "#A50026"), LOST
        else:
            show()

    for slider in sliders.values():
        slider.observe(follow, "value")
    show()
    columns = Layout(grid_template_columns="repeat(auto-fit, minmax(min(30em, 100%), 1fr))")
    return VBox([GridBox([*sliders.values()], layout=columns), line, picture])


def _slider(key, value, low, high):
    """One slider, in equal ratios where its range is wide; it speaks when it is let go."""
    from math import log10

    common = {
        "value": value,
        "description": key,
        "continuous_update": False,
        "readout_format": ".4g",
        "style": {"description_width": "14em"},
        "layout": Layout(width="auto"),
    }
    if low > 0.0 and high / low >= LOGARITHMIC_RATIO:
        low, high = log10(low), log10(high)
        return FloatLogSlider(min=low, max=high, step=(high - low) / STEPS, **common)
    return FloatSlider(min=low, max=high, step=(high - low) / STEPS, **common)


def _line(text, colour="inherit"):
    return f'<span style="color: {colour}">{html.escape(one_line(text))}</span>'
