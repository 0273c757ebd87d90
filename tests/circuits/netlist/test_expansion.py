"""Netlists that stand for more than they hold are refused before anything grows."""

import os

import effort
import pytest

from circuits.equivalent.ltspice import translate
from circuits.netlist.subcircuits import read_load
from harvester.base.errors import NetlistError

# Each of these takes at most 2.5 million. Every pair of 15,000 characters makes 225 million.
MOST_CALLS = 5_000_000
LOAD = ".subckt load p n\nR1 p n 1k\n{}\n.ends\n"


def lines(line, count, last=""):
    """A line for each number, `k` and the next in it, and one more."""
    return "\n".join([line.format(k=k, next=k + 1) for k in range(count)] + [last.format(k=count)])


def calls(levels, each, inside=""):
    """Sub-circuits that each call the next so many times."""
    texts = [
        f".subckt s{k} p n\n" + lines(f"X{{k}} p n s{k + 1}", each, ".ends\n")
        for k in range(levels)
    ]
    return LOAD.format("X0 p n s0") + "".join(texts) + f".subckt s{levels} p n\n{inside}\n.ends\n"


TOO_MUCH = {
    "empty calls, two by two": (calls(12, 2), "more than 2000 elements or calls"),
    "empty calls, ten by ten": (calls(9, 10), "more than 2000 elements or calls"),
    "diamonds": (calls(18, 1000), "more than 2000 elements or calls"),
    "calls within calls": (calls(30, 1), "nest deeper than 20"),
    "elements": (LOAD.format(lines("R{next}x p n 1k", 3000)), "more than 2000 elements"),
    "models in calls": (
        calls(2, 40, lines(".model d{k} d(is={{1n+{k}}} n={{2*{k}}} rs={{3*{k}}})", 100)),
        "more than 1000 kB",
    ),
    "definitions": (lines(".param a{k}=1", 6000) + "\n" + LOAD.format(""), "more than 5000 param"),
    "definitions in definitions": (lines(".subckt s{k} p n", 3000), "nest deeper than 20"),
    "statements": (lines("* c\nR{next} p n 1k", 30_000), "more than 20000 statements"),
    "a long statement": (LOAD.format("R2 p n 1k\n" + "+ tol=1\n" * 100_000), "of 600009 charact"),
    "a large file": (LOAD.format("* comment\n" * 100_000), "more than 1000 kB"),
    "doubling functions": (
        ".func f0(x) {x+x}\n" + lines(".func f{next}(x) {{f{k}(x)+f{k}(x)}}", 19) + LOAD.format(""),
        ".func f11 is longer than 20000",
    ),
    "a wide function": (
        ".func f(x) {" + "+".join("x" * 300) + "}\n" + LOAD.format("R2 p n {f(f(1))}"),
        "'r2 p n {f(f(1))}' is longer than 20000",
    ),
    "a function in its argument": (
        ".func f(x) {x+x}\n" + LOAD.format("B1 p n i=" + "f(" * 60 + "v(p)" + ")" * 60),
        "longer than 20000",
    ),
    "a function of itself": (".func f(x) {f(x)+1}\n" + LOAD.format(""), ".func f calls itself"),
    "functions in a circle": (
        ".func f(x) {g(x)}\n.func g(x) {f(x)}\n" + LOAD.format(""),
        ".func f calls itself",
    ),
    "a long chain of functions": (
        lines(".func f{k}(x) {{f{next}(x)}}", 2000, ".func f{k}(x) {{x}}\n") + LOAD.format(""),
        "nest deeper than 20 functions",
    ),
    "parameters in a circle": (".param a={b} b={a}\n" + LOAD.format(""), "cyclic definition"),
    "a parameter of itself": (".param a={a+1}\n" + LOAD.format(""), "cyclic definition"),
    "a long number": (LOAD.format("R2 p n " + "1" * 15_000 + "-"), "more than 250 characters"),
    "a long name": (LOAD.format("R" + "x" * 15_000 + " p n 1"), "more than 250 characters"),
    "numbers that are none": (LOAD.format("R2 p n " + ("1" * 240 + "- ") * 80), "is not a number"),
    "parentheses": (LOAD.format("B1 p n i=" + "(" * 9000 + "1" + ")" * 9000), "deeper than 100"),
    "equal signs": (LOAD.format("R2 p n " + "=" * 15_000), "has no parameter"),
    "quotes": (LOAD.format("R2 p n " + "'" * 15_001), "is not allowed"),
    "braces": (LOAD.format("R2 p n " + "{" * 15_000), "braces do not match"),
    "pins": (LOAD.format("X1 p n s\n") + ".subckt s " + lines("a{k}", 900).replace("\n", " ")
             + "\n.ends\n", r"900 in all"),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("case", TOO_MUCH)
def test_what_grows_beyond_a_load_is_refused_with_its_line_before_it_grows(tmp_path, case):
    text, message = TOO_MUCH[case]
    path = tmp_path / "hostile.lib"
    path.write_text(text)
    with effort.at_most(MOST_CALLS), pytest.raises(NetlistError) as refusal:
        read_load(path, "load")
    assert message in str(refusal.value)
    assert str(refusal.value).startswith(str(path) if "file" in case else "hostile.lib:")
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < 400


def test_what_a_load_may_hold_is_read(tmp_path):
    """Just under the limits, and functions and calls used as people use them."""
    path = tmp_path / "load.lib"
    twice = ".func f(x) {2*x}\n.func g(x,y) {f(x)+f(y)}\n"
    body = lines("R{next}x p n {{g(1k,f({k}))}}", 1900) + "\n" + lines("X{k} p n s", 90)
    path.write_text(twice + LOAD.format(body) + ".subckt s p n\nC1 p n {g(1p,2p)}\n.ends\n")
    assert read_load(path, "load").linear


def test_a_called_sub_circuit_may_hold_one_of_the_same_name(tmp_path):
    path = tmp_path / "load.lib"
    path.write_text(".subckt load p n\n.subckt load a b\nR1 a b 5\n.ends\nX1 p n load\n.ends\n")
    assert read_load(path).linear


def test_includes_end(tmp_path):
    """Many files, deep files, and what is no file."""
    for level in range(12):
        include = f".include level{level + 1}.lib\n"
        (tmp_path / f"level{level}.lib").write_text(include * 10)
    (tmp_path / "level12.lib").write_text("* nothing\n")
    (tmp_path / "loop.lib").symlink_to("loop.lib")
    (tmp_path / "folder.lib").mkdir()
    (tmp_path / "device.lib").symlink_to("/dev/zero")
    os.mkfifo(tmp_path / "fifo.lib")
    for k in range(20):
        (tmp_path / f"deep{k}.lib").write_text(f".include deep{k + 1}.lib\n")
    (tmp_path / "large.lib").write_text("* comment\n" * 60_000)
    for name, message in {
        "level0": "more than 100 files",
        "loop": "cannot be read",
        "folder": "not a regular file",
        "device": "is outside",
        "fifo": "not a regular file",
        "deep0": "deeper than 16",
        "large.lib\n.include large": "more than 1000 kB with",
        "x" * 300: "cannot be read",
        "a\0b": "cannot be read",
    }.items():
        (tmp_path / "load.lib").write_text(f".include {name}.lib\n" + LOAD.format(""))
        with pytest.raises(NetlistError, match=message) as refusal:
            read_load(tmp_path / "load.lib", "load")
        assert ": .include" in str(refusal.value)


@pytest.mark.parametrize("name", ["fifo", "folder", "/dev/zero", "/proc/kmsg", "none"])
def test_a_load_is_a_regular_file(tmp_path, name):
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "folder").mkdir()
    with pytest.raises(NetlistError, match=r"not a regular file|cannot be read|no \.subckt"):
        read_load(tmp_path / name)


@pytest.mark.parametrize(
    "expression",
    ["x" + "==x" * 200, "(" * 5000 + "x" + ")" * 5000, "x?1:" * 3000 + "1"],
)
def test_an_expression_too_large_for_ltspice_is_refused(expression):
    with pytest.raises(NetlistError, match=r"deeper than|more than 100|becomes too long"):
        translate(expression)
