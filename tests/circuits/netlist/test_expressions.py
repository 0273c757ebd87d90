import re

import pytest

from circuits.equivalent.assembly import assemble
from circuits.netlist.expression import ExpressionError, check
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared


@pytest.mark.parametrize(
    "expression",
    [
        "v(x)*v(x)",
        "(v(a,b)>1.1) ? -10*sqrt(v(a)) : 0",
        "a1 > 2 ? 1 : 2".replace("a1", "v(a1)"),
        "1+-2e-3*v(x)**2",
        "-v(x)^3 + 2k*i(V1)",
        "v(x)/(1+abs(v(y)))",
        "v(in.sub#node)*time",
        "(v(x)>0) ? ((v(y)>0) ? 1 : 2) : (3)",
        "max(v(x),0.5) + pwl(time, 0, 0, 1, 1)",
    ],
)
def test_good_expressions_pass(expression):
    check(expression, (), {})


@pytest.mark.parametrize(
    ("expression", "fault"),
    [
        ("(v(x)", "1 closing parenthesis missing"),
        ("v(x))", "closing parenthesis too many"),
        ("v(x) ? 1", "'?' without"),
        ("v(x) : 1", "':' without a '?'"),
        ("sqrr(v(x))", "did you mean sqr"),
        ("idt(v(x))", "write an integral: a current source into a capacitor"),
        ("v(x) & 1", "write &&"),
        ("1a*v(x)", "omit the A"),
        ("v(x)*", "missing operand at the end"),
        ("*v(x)", "missing operand before '*'"),
        ("v(x) v(y)", "missing operator"),
        ("2*foo", "unknown name foo"),
        ("table(v(a), -1, 1)", "unknown function table; write pwl("),
        ("v(x)*()", "missing operand"),
        ("(" * 200 + "1" + ")" * 200, "nest deeper than 100"),
        ("1?" * 200 + "1" + ":1" * 200, "more than 100 nested"),
        ("v(x)$2", "unexpected character '$'"),
        ("", "missing operand"),
    ],
)
def test_bad_expressions_are_refused_with_the_fault(expression, fault):
    with pytest.raises(ExpressionError, match=re.escape(fault)):
        check(expression, (), {})


@pytest.mark.parametrize("text", ["+".join(["v(x)"] * 2000), "-" * 3000 + "1", "v(x)^2" * 1])
def test_long_expressions_are_read_without_recursion(text):
    check(text, (), {})


@pytest.mark.parametrize("gap", ["1.1", "0.9"])
@pytest.mark.parametrize("mode", ["energy", "event"])
def test_our_own_expressions_pass(gap, mode):
    overrides = [f"stoppers.gap={gap}", f"stoppers.impact_velocity={mode}"]
    assert "\nB" in assemble(prepared(Scene.read("paper", overrides))).text
