"""Decimal marks and thousands separators are read by column, or refused with both readings."""

import numpy as np
import pytest

from harvester.base.errors import SceneError
from harvester.excitation.recorded import RecordedMotion
from harvester.records.decimal_marks import marks_of

TIMES = np.arange(200) / 1000.0
MOTION = 2.0 * np.sin(2.0 * np.pi * 46.0 * TIMES + 0.4)
HEADER = "time [s];acceleration [mm/s^2]"


def swapped(text):
    return text.translate(str.maketrans(",.", ".,"))


def plain(form):
    return lambda t, a: f"{t:.3f};{1e3 * a:{form}}"


def quoted(form):
    return lambda t, a: f'"{t:.3f}","{1e3 * a:{form}}"'


FORMS = {
    "commas": plain(",.0f"),
    "commas and decimals": plain(",.2f"),
    "quoted": quoted(",.0f"),
    "points": lambda t, a: swapped(plain(",.0f")(t, a)),
    "points and decimals": lambda t, a: swapped(plain(",.1f")(t, a)),
    "apostrophes": lambda t, a: plain(",.0f")(t, a).replace(",", "'"),
    "thin blanks": lambda t, a: plain(",.0f")(t, a).replace(",", "\u202f"),
    "tabs": lambda t, a: plain(",.0f")(t, a).replace(";", "\t"),
    "large only at first": lambda t, a: plain(",.0f")(t, a * np.exp(-20.0 * t)),
    "decimal commas": lambda t, a: swapped(plain(".3f")(t, a)),
}


@pytest.mark.parametrize("name", FORMS)
def test_each_column_is_read_by_all_of_its_values(tmp_path, name):
    rows = [FORMS[name](t, a) for t, a in zip(TIMES, MOTION, strict=True)]
    mark = "\t" if name == "tabs" else "," if name == "quoted" else ";"
    (tmp_path / "a.csv").write_text("\n".join([HEADER.replace(";", mark), *rows]))
    found = RecordedMotion(str(tmp_path / "a.csv"), detrend="none")
    fading = np.exp(-20.0 * TIMES) if name.startswith("large") else 1.0
    assert found.interval == pytest.approx(1e-3)
    np.testing.assert_allclose(found.samples, MOTION * fading, atol=6e-4)


@pytest.mark.parametrize(
    ("time", "form"),
    [
        (lambda t: f"{t:.3f}".replace(".", ","), ",.0f"),
        (lambda t: f"{t:.3f}", ",.0f"),
        (lambda t: f"{t + 10.0:.3f}", None),
        (lambda t: f"{1e3 * t:.0f}", None),
    ],
)
def test_two_readings_are_refused_with_both(tmp_path, time, form):
    def value(a):
        # Always four digits, or both kinds of numbers.
        return f"{1500.0 + 200.0 * a:,.0f}" if form is None else f"{1e3 * a:{form}}"

    rows = [f"{time(t)};{value(a)}" for t, a in zip(TIMES, MOTION, strict=True)]
    if form and "," not in rows[0].split(";")[0]:
        rows = [row.replace(",", ".") for row in rows]
    (tmp_path / "a.csv").write_text("\n".join([HEADER, *rows]))
    with pytest.raises(SceneError, match=r"is ambiguous: \d+ or [\d.]+: save it"):
        assert RecordedMotion(str(tmp_path / "a.csv")).samples.size


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        ([["1,702", "1,703"], ["0.001", "0.002"]], (".", ",")),
        ([["1,702", "1,703"], ["0,001", "0,002"]], (",", "")),
        ([["1,702", "742"]], (".", ",")),
        ([["1.702", "742"]], (",", ".")),
        ([["1.702", "1.703"]], (".", "")),
        ([["1.702", "0.5", "742"]], (".", "")),
        ([["1,234,567", "12"]], (".", ",")),
        ([["1.234,5", "1,5"]], (",", ".")),
        ([["1,286", "1286"], ["0,5", "0,6"]], (",", "")),
        ([["9,812", "0,5e-3"]], (",", "")),
        ([["742", "12"]], (".", "")),
        ([["1.702", "nan"]], (".", "")),
        ([["1,702", "nan"], ["0,5", "err"]], (",", "")),
    ],
)
def test_marks_are_those_that_all_values_have(columns, expected):
    width = len(columns)
    longest = max(map(len, columns))
    rows = [[c[k % len(c)] for c in columns] for k in range(longest)]
    assert next(marks_of(rows, width)) == expected
