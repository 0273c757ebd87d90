"""Bounds over intervals against what an expression's values there are."""

import numpy as np
import pytest

from circuits.netlist.bounds import bounds, of_time_alone
from circuits.netlist.expression import Names, parse, resolved
from circuits.netlist.expression_graph import Values

EXPRESSIONS = (
    "time^3-2*time", "pow(time-3,2.5)", "pwr(time-3,3)", "abs(time-2)", "exp(3-time)",
    "exp(90*time)", "ln(time+1)", "sqrt(time)",
    "sin(7*time)*cos(3*time)", "tan(time)", "atan(time-1)",
    "sinh(time-2)+cosh(time-2)", "tanh(9*(time-2))", "max(time,2)-min(3*time,4)",
    "time>2 ? time : 5-time", "sin(time)<=0.5 && !(cos(2*time)==0)", "time>4 || sin(time)>0.9",
    "sgn(time-2)", "u(time-1)+uramp(time-3)", "1/(time-2.5)", "time/(1.1+sin(5*time))",
    "floor(2*time)+ceil(3*time)", "asinh(time)", "asin(sin(time))", "acos(cos(time))",
    "nint(time)", "atanh(0.9*sin(time))", "acosh(1+time)", "sin(time)^2+cos(time)^2",
    "time*3-floor(time*3)", "(time>1) - (time>=3)",
)  # fmt: skip


def tree_of(text):
    return resolved(parse(text), Names({"time": ("time",)}.__getitem__))


@pytest.mark.parametrize("text", EXPRESSIONS)
def test_all_values_lie_between(text):
    """Of random intervals from a billionth to all of them; narrow ones are no wider than due."""
    random = np.random.default_rng(5)
    low = random.uniform(0.0, 6.0, 300)
    high = low + 10.0 ** random.uniform(-9.0, 0.5, 300)
    tree = tree_of(text)
    least, most = bounds(tree, low, high)
    values = Values([tree], [])
    inside = [low + share * (high - low) for share in np.linspace(0.0, 1.0, 41)]
    found = np.array([values(time, np.zeros((0, 300)))[0] for time in inside])
    rounding = 1e-12 * (1.0 + np.abs(found).max(axis=0))
    assert np.all(found.min(axis=0) >= least - rounding)
    assert np.all(found.max(axis=0) <= most + rounding)
    # Where a jump or a pole lies within, no interval is narrow enough.
    narrow = high - low < 1e-6
    assert np.mean((most - least < 1e-2 * (1.0 + np.abs(most)))[narrow]) > 0.98


def test_points_of_a_straight_line_function():
    tree = tree_of("pwl(time,0,0,1,5,1.5,-1,2,0)")
    least, most = bounds(tree, np.array([0.2, 0.9, 3.0]), np.array([0.4, 1.6, 4.0]))
    assert least == pytest.approx([1.0, -1.0, 0.0])
    assert most == pytest.approx([2.0, 5.0, 0.0])


def test_what_changes_with_time_alone():
    assert of_time_alone(tree_of("sin(time)>0.5"))
    assert not of_time_alone(tree_of("sin(time)*v(a)"))
    assert not of_time_alone(tree_of("3"))
