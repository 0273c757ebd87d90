"""Every figure of the paper is declared, with the values of its caption."""

import re

import pytest

from harvester.scene.model import Scene
from harvester.validation.paper_figures import FIGURES, KEY_SYMBOLS

# The captions, as printed: (figure, panel, swept symbol, sentence).
DENSITIES = [
    ("fig4", 0, "δr", "The position parameter δr are 1.0 and 1.2"),
    ("fig4", 1, "e", "The restitution coefficient e are 0.5 and 0.9"),
    ("fig4", 2, "K", "The contact stiffness K are 5.0 and 13.0"),
    ("fig5", 0, "D", "The noise intensity D are 0.03 and 0.1"),
    ("fig5", 1, "τ1", "The noise correlation time τ1 are 0.4 and 1.0"),
]
RANGES = [
    ("fig6", 0, "δr", "The position parameter δr increases from 0.95 to 1.25"),
    ("fig6", 1, "e", "the restitution coefficient e increases from 0.3 to 1.0"),
    ("fig6", 2, "K", "the contact stiffness K increases from 5.0 to 13.0"),
    ("fig7", 0, "D", "with the noise intensity D rising from 0.005 to 0.125"),
    ("fig8", 0, "λ", "The parameter λ increases from 0.03 to 0.09"),
    (
        "fig8",
        1,
        "β",
        "electromechanical coupling coefficient β increases from 0.3 to 0.95",
    ),
    *(("fig9", k, "D", "the noise intensity D increasing from 0.005 to 0.125") for k in range(3)),
    *(("fig10", k, "τ1", "correlation time τ1 increasing from 0.1 to 1.1") for k in range(3)),
]
CURVES = [
    *((f"fig{n}", k, "τ1", "(τ1 = 0.4 or 1.0)") for n, k in ((6, 0), (6, 2), (7, 0), (8, 1))),
    *((f"fig{n}", 0, "δr", "The position parameter δr are 1.1, 1.2 and 1.3") for n in (9, 10)),
    *((f"fig{n}", 1, "e", "the restitution coefficient e are 0.4, 0.7 and 1.0") for n in (9, 10)),
    *((f"fig{n}", 2, "K", "the contact stiffness K are 1.0, 7.0 and 13.0") for n in (9, 10)),
]


def numbers(sentence):
    return [float(text) for text in re.findall(r"(?<![\w.])\d+\.\d+", sentence)]


def curve_values(panel, symbol):
    return [v for curve in panel.curves for k, v in curve if KEY_SYMBOLS[k] == symbol]


def test_every_figure_with_noise_is_there():
    assert list(FIGURES) == [f"fig{n}" for n in range(4, 11)]
    assert [len(figure.panels) for figure in FIGURES.values()] == [3, 2, 3, 1, 2, 3, 3]


@pytest.mark.parametrize(("figure", "panel", "symbol", "caption"), [*DENSITIES, *CURVES])
def test_curves_have_the_caption_s_values(figure, panel, symbol, caption):
    assert curve_values(FIGURES[figure].panels[panel], symbol) == numbers(caption)


@pytest.mark.parametrize(("figure", "panel", "symbol", "caption"), RANGES)
@pytest.mark.parametrize("quick", [True, False])
def test_axes_have_the_caption_s_range(figure, panel, symbol, caption, quick):
    swept = FIGURES[figure].panels[panel]
    lines, simulated = swept.values(quick)
    assert KEY_SYMBOLS[swept.swept] == symbol
    for values in (lines, simulated):
        assert [values[0], values[-1]] == numbers(caption)
        assert values == sorted(values)
    assert set(simulated) <= set(lines)


def test_every_value_is_one_that_the_device_takes():
    scene = Scene.read("paper")
    for figure in FIGURES.values():
        for panel in figure.panels:
            for curve in panel.curves:
                ends = (panel.first, panel.last) if figure.quantities else ()
                scene.replace(dict(curve))
                for value in ends:
                    scene.replace({**dict(curve), panel.swept: value})
