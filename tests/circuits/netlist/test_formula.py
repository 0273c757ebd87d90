"""Expressions against ngspice's own values, their slopes against differences."""

import subprocess

import numpy as np
import pytest
from raw_files import ngspice_program

from circuits.netlist.expression import ExpressionError, Names, parse, resolved
from circuits.netlist.expression_graph import ExpressionGraph, evaluate, slopes
from harvester.validation.other_programs import read_raw

X, Y = -1.7, 0.6
EXPRESSIONS = (
    "v(x)^3", "v(x)**3", "pow(v(x),2.5)", "pwr(v(x),3)", "2^3^2+v(y)", "-v(x)^2", "v(x)^-1",
    "abs(v(x))", "exp(v(y))", "ln(v(y))", "log(v(y))", "log10(v(y))", "sqrt(v(y))",
    "sin(v(x))*cos(v(y))", "tan(v(y))", "atan(v(x))", "sinh(v(y))+cosh(v(x))", "tanh(v(x,y))",
    "max(v(x),v(y))-min(v(x),v(y))", "v(x)>v(y) ? v(x) : v(y)*v(y)", "v(x)<=v(y) && !(v(y)==0)",
    "v(x)>0 || v(y)>0", "sgn(v(x))", "u(v(x))+u2(v(y))+uramp(v(y))", "1.5k*v(y)/(v(x)-2)",
    "floor(v(x))+ceil(v(y))", "asinh(v(x))", "asin(v(y))", "acos(v(y))", "((v(x)))--v(y)",
    "nint(v(x))", "atanh(v(y))", "acosh(2+v(y))", "u(v(x)-v(x))", "v(x)/(v(y)-v(y))",
)  # fmt: skip


def on_tape(text):
    """(rows, values, place of the value) of an expression of v(x) and v(y)."""
    graph = ExpressionGraph()
    tree = resolved(parse(text), Names())
    last = graph.add(tree, lambda each: ["x", "y"].index(each[1]) if each[1] != "0" else -1)
    return np.array(graph.rows), np.array(graph.values), last


def value(text, x, y):
    rows, values, last = on_tape(text)
    evaluate(rows, values, np.array([x, y]), 0.0)
    return values[last]


def test_values_are_ngspices(tmp_path):
    """Each as a behavioural source in one netlist that `ngspice -b` solves."""
    sources = [f"b{k} b{k} 0 v={text}" for k, text in enumerate(EXPRESSIONS)]
    lines = [
        "values",
        f".nodeset v(x)={X} v(y)={Y}",
        f"vx x 0 {X}",
        f"vy y 0 {Y}",
        *sources,
        ".op",
        ".end",
    ]
    (tmp_path / "values.cir").write_text("\n".join(lines) + "\n")
    command = [ngspice_program(), "-b", "-r", "values.raw", "values.cir"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    theirs = read_raw(tmp_path / "values.raw")
    for k, text in enumerate(EXPRESSIONS):
        assert value(text, X, Y) == pytest.approx(theirs[f"v(b{k})"][0], rel=1e-6, abs=1e-9), text


@pytest.mark.parametrize("text", EXPRESSIONS)
def test_slopes_are_differences(text):
    rows, values, last = on_tape(text)
    share = np.zeros(len(rows))
    evaluate(rows, values, np.array([X, Y]), 0.0)
    slopes(rows, values, share, 0, last)
    for unknown, (dx, dy) in enumerate(((1e-6, 0.0), (0.0, 1e-6))):
        slope = share[(rows[:, 0] == 0) & (rows[:, 1] == unknown)].sum()
        wanted = (value(text, X + dx, Y + dy) - value(text, X - dx, Y - dy)) / 2e-6
        assert slope == pytest.approx(wanted, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("text", ["ddt(v(x))", "pwl(v(x),0,0,1,1)", "v(x)%2"])
def test_what_is_not_taken_is_said(text):
    with pytest.raises(ExpressionError):
        on_tape(text)
