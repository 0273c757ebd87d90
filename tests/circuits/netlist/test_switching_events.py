"""Which comparisons make a source jump, and where."""

import pytest

from circuits.netlist.subcircuits import find_netlist, read_load
from circuits.netlist.switching_events import passing, zero_crossings


def found(tmp_path, expression):
    """(ends, level) of each comparison that jumps, or None where it is not so simple."""
    path = tmp_path / "load.lib"
    path.write_text(
        f".subckt load p n\nB1 p n i={expression}\nR1 p a 1k\nR2 a b 1k\nR3 b n 1k\n.ends\n"
    )
    tree = read_load(path).elements[0].expression
    return [passing(each) for each in zero_crossings(tree)]


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("v(a,b)>2 ? 1m : 0", [(("b", "a"), -2.0)]),
        ("v(a)<=v(b) ? 1m : v(p)", [(("a", "b"), 0.0)]),
        ("sgn(2*v(a,n)-3)", [(("a", "n"), 1.5)]),
        ("u(v(a,b)-v(b,a)+4)", [(("a", "b"), -2.0)]),
        ("v(a)*v(b)>1 ? 1 : 0", [None]),
        ("floor(v(a,n))", [None]),
        # Both sides agree where they turn.
        ("v(a,b)>0 ? v(a,b)*1k : v(a,b)*1n", []),
        ("v(a)>1 ? 2*(v(a)-1)+3 : 3", []),
        ("abs(v(a))+max(v(a),v(b))", []),
        # Known beforehand, or never.
        ("time>0.5 ? 1m : 0", []),
        ("v(a)+1", []),
    ],
)
def test_what_jumps(tmp_path, expression, expected):
    near = [each and (each[0], pytest.approx(each[1])) for each in expected]
    assert found(tmp_path, expression) == near


def test_ideal_diodes_do_not_jump():
    elements = read_load(find_netlist("bridge_ideal")).elements
    assert not any(
        zero_crossings(each.expression) for each in elements if each.expression is not None
    )
