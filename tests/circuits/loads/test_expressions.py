import pytest

from circuits.assembly import assemble
from circuits.loads.expressions import check_netlist, expression_fault
from harvester.errors import NetlistError
from harvester.scene.model import Scene


@pytest.mark.parametrize(
    "expression",
    [
        "v(x)*v(x)",
        "(v(a,b)>1.1) ? -10*sqrt(v(a)) : 0",
        "a1 > 2 ? 1 : 2".replace("a1", "v(a1)"),
        "1+-2e-3*v(x)**2",
        "-v(x)^3 + 2k*i(V1)",
        "{v(x)/(1+abs(v(y)))}",
        "v(in.sub#node)*time",
        "(v(x)>0) ? ((v(y)>0) ? 1 : 2) : (3)",
        "max(v(x),0.5) + pwl(time, 0, 0, 1, 1)",
    ],
)
def test_good_expressions_pass(expression):
    assert expression_fault(expression) == ""


@pytest.mark.parametrize(
    ("expression", "fault"),
    [
        ("(v(x)", "1 closing parenthesis missing"),
        ("v(x))", "closing parenthesis too many"),
        ("v(x) ? 1", "'?' without its ':'"),
        ("v(x) : 1", "':' without its '?'"),
        ("sqr(v(x))", "did you mean sqrt"),
        ("v(x)*", "missing operand at the end"),
        ("*v(x)", "missing operand before '*'"),
        ("v(x) v(y)", "missing operator"),
        ("2*foo", "unknown name foo"),
        ("limit(v(a), -1, 1)", r"unknown function limit; write max(low, min(x, high))"),
        ("v(x)*()", "missing operand"),
        ("v(x)$2", "unexpected character '$'"),
        ("", "missing operand"),
    ],
)
def test_bad_expressions_are_refused_with_the_fault(expression, fault):
    assert fault in expression_fault(expression)


def test_a_netlist_is_data_and_no_program():
    for card in (".control", ".print tran v(x)", ".write file"):
        with pytest.raises(NetlistError, match="no program"):
            check_netlist(f"title\n{card}\n")
    with pytest.raises(NetlistError, match=r"Bbad.*missing"):
        check_netlist("title\nBbad x 0 i=(v(x)\n+ *2\n")
    with pytest.raises(NetlistError, match="i=expression"):
        check_netlist("title\nBbad x 0 v(x)\n")


@pytest.mark.parametrize("gap", ["1.1", "0.9"])
@pytest.mark.parametrize("mode", ["energy", "event"])
def test_our_own_expressions_pass(gap, mode):
    overrides = [f"stoppers.gap={gap}", f"stoppers.impact_velocity={mode}"]
    check_netlist(assemble(Scene.load("paper", overrides)).text)
