"""Expressions of netlists: parsed into immutable trees, evaluated, and written out again.

A tree is a tuple: ("number", x), ("time",), ("name", n), ("v", node, node), ("i", source),
("call", function, *trees), or (operation, *trees) with a name of `functions.OPERATIONS`.
"""

from __future__ import annotations

import functools
import math
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

from circuits.netlist.functions import CONSTANTS, OPERATIONS, SOLUTION, VARYING, folded
from circuits.netlist.numbers import AMPERE, INFIX, THOUSANDTH_OF_AN_INCH, number
from harvester.base.errors import HarvesterError
from harvester.base.plain_text import nearest
from harvester.device.terminals import GROUND

Tree = tuple[Any, ...]
NAMES = {*CONSTANTS, "time", "hertz"}
# Synonyms of functions.
_SAME = {"log": "ln", "pow": "^", "ternary_fcn": "if", "round": "nint"}
# Functions that only ngspice can evaluate.
CIRCUIT_ONLY = {"ddt": (1,), "pwl": range(5, 10_000, 2)}
ZERO, HALF, ONE = ("number", 0.0), ("number", 0.5), ("number", 1.0)


# Functions of LTspice, PSpice and ngspice's .param that are composed of other functions.
_MADE: dict[str, tuple[int, Callable]] = {
    "log10": (1, lambda x: ("/", ("ln", x), ("number", math.log(10.0)))),
    "u2": (1, lambda x: ("min", ("max", x, ZERO), ONE)),
    "int": (1, lambda x: ("*", ("sgn", x), ("floor", ("abs", x)))),
    "sqr": (1, lambda x: ("*", x, x)),
    "arctan": (1, lambda x: ("atan", x)),
    "hypot": (2, lambda x, y: ("sqrt", ("+", ("*", x, x), ("*", y, y)))),
    "limit": (3, lambda x, low, high: ("min", ("max", x, ("min", low, high)), ("max", low, high))),
    "buf": (1, lambda x: ("<", HALF, x)),
    "inv": (1, lambda x: ("<=", x, HALF)),
    "stp": (1, lambda x: ("<", ZERO, x)),
    "pwrs": (2, lambda x, y: ("pwr", x, y)),
    "if": (3, lambda c, a, b: ("if", truth(c), a, b)),
}
# Functions above that ngspice lacks or defines differently.
ELSEWHERE_ALONE = {*_MADE, "round"} - {"log10", "u2"}
# Unsupported functions of other SPICEs, and how to replace them.
ELSEWHERE = {
    "sign": "sgn(x)", "fabs": "abs(x)", "table": "pwl(x, x1, y1, x2, y2, …)",
    "atan2": "atan(y/x), the quadrant by a condition",
    "idt": "an integral: a current source into a capacitor, and its voltage",
    "idtmod": "an integral: a current source into a capacitor, and its voltage",
    "sdt": "an integral: a current source into a capacitor, and its voltage",
    "square": "x*x, or a pulse(…) source for a square wave",
    "delay": "a chain of R and C", "absdelay": "a chain of R and C",
}  # fmt: skip
# Largest argument of exp() whose value is finite.
LARGEST_ARGUMENT = math.log(sys.float_info.max)
# Deepest nesting of parentheses, and of conditions.
DEEPEST = 100
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?[a-z_]*)"
    r"|(?P<solution>[vi]\([^()]*\))|(?P<name>[a-z_][\w.#]*)"
    r"|(?P<operator>\*\*|&&|\|\||[<>=!]=|<>|[-+*/^<>?:,()!~%&|]))",
    re.ASCII,
)
_SOLUTION = re.compile(r"\b([vi])\(([^()]*)\)", re.IGNORECASE)
# Binary operators from the loosest to the tightest.
_LEVELS = ({"||"}, {"&&"}, {"==", "!=", "<>"}, {"<", ">", "<=", ">="}, {"+", "-"}, {"*", "/", "%"})
TIGHTNESS = {sign: level for level, signs in enumerate(_LEVELS) for sign in signs}
_WORDS = {"||": "or", "&&": "and"}
BOOLEAN = {"<", "<=", "==", "and", "or", "not"}


class ExpressionError(HarvesterError):
    """An error in an expression; the caller adds file and line."""


class NotConstant(ExpressionError):
    """An expression depends on the circuit's solution where a constant is required."""


def truth(condition: Tree) -> Tree:
    """LTspice's if() is true above 0.5; for a comparison this makes no difference."""
    return condition if condition[0] in BOOLEAN else ("<", HALF, condition)


class Parser:
    """Precedence-climbing parser of an expression, with one method per kind of term.

    Dialects override its tables and last methods: `circuits.netlist.dialects`.
    """

    tightness: Mapping[str, int] = TIGHTNESS
    negations: tuple[str, ...] = ("!",)
    powers: tuple[str, ...] = ("^", "**")

    def __init__(self, text: str) -> None:
        self.tokens = _tokens(INFIX.sub(r"\1.\3\2", text.lower()))
        self.place = self.depth = 0
        operators = {*self.tightness, *self.negations}
        for _, piece in self.tokens:
            if piece in ("&", "|", "~") and piece not in operators:
                write = "!x" if piece == "~" else f"{piece}{piece}"
                raise ExpressionError(f"{piece!r} is no operator here: write {write}")

    def peek(self) -> str:
        """The text of the next token."""
        return self.tokens[self.place][1]

    def take(self) -> tuple[str, str]:
        """Return the next token, kind and text, and advance."""
        self.place += 1
        return self.tokens[self.place - 1]

    def whole(self) -> Tree:
        """Parse the whole text."""
        tree = self.choice()
        if self.peek():
            raise ExpressionError(f"missing operator before {self.peek()[:60]!r}")
        return tree

    def choice(self) -> Tree:
        """Parse a conditional (a ? b : c) or a value."""
        self.depth += 1
        if self.depth > DEEPEST:
            raise ExpressionError(
                f"more than {DEEPEST} nested parentheses or conditions: nest fewer"
            )
        tree = self.binary(0)
        if self.peek() == "?":
            self.take()
            yes = self.choice()
            if self.take()[1] != ":":
                raise ExpressionError("a '?' without its ':': write condition ? a : b")
            tree = ("if", self.truth(tree), yes, self.choice())
        self.depth -= 1
        return tree

    def binary(self, loosest: int) -> Tree:
        """Parse operands joined by operators of at least the precedence `loosest`."""
        tree, before = self.signed(), None
        while (level := self.tightness.get(self.peek(), -1)) >= loosest:
            sign = self.take()[1]
            self.check_order(sign, level, loosest, before)
            tree, before = self.compared(sign, tree, self.binary(level + 1)), sign
        return tree

    def check_order(self, sign: str, level: int, loosest: int, before: str | None) -> None:
        """Raise for a == b < c: sources and parameters evaluate it in different orders."""
        if level == loosest == TIGHTNESS["<"]:
            raise ExpressionError(
                f"== or != before {sign}: a source evaluates {sign} first, a parameter "
                "the left operator: write parentheses"
            )

    def signed(self) -> Tree:
        """Parse a power with the signs and negations before it."""
        signs = []
        while self.peek() in ("-", "+", *self.negations):
            signs.append(self.take()[1])
        tree = self.power()
        for sign in reversed(signs):
            if sign in self.negations:
                tree = ("not", self.truth(tree))
            elif sign == "-":
                tree = ("negative", tree)
        return tree

    def power(self) -> Tree:
        """Parse a base and its exponents, from left to right."""
        tree = self.atom()
        while self.peek() in self.powers:
            self.take()
            minus = False
            while self.peek() in ("-", "+"):
                minus ^= self.take()[1] == "-"
            exponent = self.atom()
            tree = self.raised(tree, ("negative", exponent) if minus else exponent)
        return tree

    def atom(self) -> Tree:
        """Parse a number, a name, a call, a voltage or current, or an expression in parentheses."""
        kind, text = self.take()
        if kind == "number":
            return ("number", _number(text))
        if kind == "solution":
            return _solution(text)
        if text == "(":
            tree = self.choice()
            self.close()
            return tree
        if kind != "name":
            where = f"before {text!r}" if text else "at the end"
            raise ExpressionError(f"missing operand {where}")
        if self.peek() != "(":
            return ("name", text)
        return self.call(text)

    def call(self, name: str) -> Tree:
        """Parse a function call from its opening parenthesis on."""
        self.take()
        if self.peek() == ")":
            self.take()
            return self.called(name, [])
        arguments = [self.choice()]
        while self.peek() == ",":
            self.take()
            arguments.append(self.choice())
        self.close()
        return self.called(name, arguments)

    def close(self) -> None:
        """Consume a closing parenthesis."""
        if self.peek() != ")":
            raise ExpressionError(f"missing operator before {self.peek()[:60]!r}")
        self.take()

    def truth(self, condition: Tree) -> Tree:
        """Build the tree of a condition, which is true above 0."""
        return condition

    def compared(self, sign: str, left: Tree, right: Tree) -> Tree:
        """Build the tree of a binary operator."""
        if sign in (">", ">="):
            return (sign.replace(">", "<"), right, left)
        if sign in ("!=", "<>"):
            return ("not", ("==", left, right))
        return (_WORDS.get(sign, sign), left, right)

    def raised(self, base: Tree, exponent: Tree) -> Tree:
        """Build the tree of a power."""
        return ("^", base, exponent)

    def called(self, name: str, arguments: list[Tree]) -> Tree:
        """Build the tree of a function call."""
        return ("call", name, *arguments)


def _tokens(text):
    """(kind, text) of each token, and an end token; checks parentheses and conditions."""
    lowered = text.strip().lower()
    tokens, position = [], 0
    while position < len(lowered):
        match = _TOKEN.match(lowered, position)
        if not match:
            raise ExpressionError(f"unexpected character {lowered[position]!r}: remove it")
        kind = str(match.lastgroup)
        tokens.append((kind, match.group(kind)))
        position = match.end()
    depth = questions = 0
    for _, piece in tokens:
        depth += (piece == "(") - (piece == ")")
        questions += (piece == "?") - (piece == ":")
        if depth < 0:
            raise ExpressionError("one closing parenthesis too many: remove it")
        if questions < 0:
            raise ExpressionError("a ':' without a '?': write condition ? a : b")
        if depth > DEEPEST:
            raise ExpressionError(f"parentheses nest deeper than {DEEPEST}: nest fewer")
    if depth:
        raise ExpressionError(f"{depth} closing parenthes{'is' if depth == 1 else 'es'} missing")
    if questions:
        raise ExpressionError("a '?' without its ':': write condition ? a : b")
    return [*tokens, ("end", "")]


def _number(text):
    value = number(text)
    if AMPERE.fullmatch(text):
        raise ExpressionError(f"{text}: ngspice 46 reads A as 1e-18, version 39 as 1: omit the A")
    if THOUSANDTH_OF_AN_INCH.fullmatch(text):
        raise ExpressionError(f"{text}: mil is 1e-3 in ngspice's .param: multiply by 25.4u instead")
    if value is None:
        raise ExpressionError(f"{text[:60]} is not a finite number")
    return value


def _solution(text):
    """Parse v(a), v(a,b) or i(source); a node may have any name."""
    names = [name.strip() for name in text[2:-1].split(",")]
    most = 2 if text[0] == "v" else 1
    if len(names) > most:
        raise ExpressionError(f"{text[0]} takes {most} arguments, not {len(names)}")
    if not all(re.fullmatch(r"[\w.+\-#/\[\]]+", name) for name in names):
        raise ExpressionError(f"{text[:60]}: needs a node; i() needs a source")
    return ("v", names[0], names[1] if names[1:] else GROUND) if most == 2 else ("i", names[0])


def solutions(text: str) -> list[tuple[str, list[str]]]:
    """("v" or "i", names) of each voltage and current in a text, with names as written."""
    return [
        (kind.lower(), [name.strip() for name in inside.split(",")])
        for kind, inside in _SOLUTION.findall(text)
    ]


def respelt(text: str, spell: Callable[[str, list[str]], str]) -> str:
    """Replace each voltage and current in a text by `spell(kind, names)` if that is not empty."""
    return _SOLUTION.sub(lambda match: spell(*solutions(match[0])[0]) or match[0], text)


@functools.lru_cache(maxsize=4096)
def parse(text: str) -> Tree:
    """Parse an expression; names and functions are not resolved yet.

    Raises
    ------
    ExpressionError
    """
    return Parser(text).whole()


def parts_of(tree: Tree) -> Tree:
    """The operands of an expression."""
    if tree[0] == "call":
        return tree[2:]
    return () if tree[0] in ("number", "time", "name", "v", "i") else tree[1:]


def rebuilt(tree: Tree, value_of: Callable) -> Any:
    """Value of a tree, built from its leaves: `value_of(tree, values of its parts)` for each node.

    Not recursive, since a sum of a thousand terms is a thousand levels deep.
    """
    done: list[Any] = []
    waiting = [(tree, False)]
    while waiting:
        node, complete = waiting.pop()
        parts = parts_of(node)
        if parts and not complete:
            waiting.append((node, True))
            waiting += [(part, False) for part in reversed(parts)]
        else:
            first = len(done) - len(parts)
            done[first:] = [value_of(node, done[first:])]
    return done[0]


def replaced(tree: Tree, change: Callable[[Tree], Tree]) -> Tree:
    """A tree with each of its leaves replaced by `change(leaf)`."""

    def made(node: Tree, parts: list[Tree]) -> Tree:
        return (*node[: len(node) - len(parts)], *parts) if parts else change(node)

    return rebuilt(tree, made)


def leaves(tree: Tree | None) -> Iterator[Tree]:
    """A tree and all its subtrees; nothing for None."""
    waiting = [tree] if tree else []
    while waiting:
        node = waiting.pop()
        yield node
        waiting += parts_of(node)


def nodes_in(tree: Tree | None) -> list[str]:
    """Nodes whose voltages an expression depends on, including ground."""
    return [node for leaf in leaves(tree) if leaf[0] == "v" for node in leaf[1:]]


def currents_in(tree: Tree | None) -> list[str]:
    """Sources and coils whose currents an expression depends on."""
    return [leaf[1] for leaf in leaves(tree) if leaf[0] == "i"]


def unknowns_in(tree: Tree | None) -> list[str]:
    """Unique nodes (without ground) and currents "i(name)" that an expression depends on."""
    unknowns = [leaf for leaf in leaves(tree) if leaf[0] in ("v", "i")]
    names = [f"i({leaf[1]})" if leaf[0] == "i" else node for leaf in unknowns for node in leaf[1:]]
    return [name for name in dict.fromkeys(names) if name != GROUND]


def is_constant(tree: Tree) -> bool:
    """Whether a resolved tree is a number."""
    return tree[0] == "number"


def check(text: str, parameters: Any, functions: Mapping[str, Any]) -> None:
    """Raise for an expression with undefined names or functions, or wrong calls.

    Parameters
    ----------
    text : str
    parameters : collection of str
    functions : mapping of str to sequence
        Functions of the file: (card, arguments, …).

    Raises
    ------
    ExpressionError
    """
    for leaf in leaves(parse(text)):
        if leaf[0] == "name" and leaf[1] not in NAMES and leaf[1] not in parameters:
            truths = ("true", "false", "yes", "no")
            hint = "; write 1 or 0" if leaf[1] in truths else nearest(leaf[1], parameters)
            raise ExpressionError(f"unknown name {leaf[1][:60]}{hint}: define it by .param")
        if leaf[0] == "call":
            _check_call(leaf[1], len(leaf) - 2, functions)


def _check_call(name, count, functions):
    expected = _arguments_of(name, functions)
    if count not in expected:
        raise ExpressionError(f"{name} takes {expected[0]} arguments, not {count}")


def _arguments_of(name, functions):
    if name in functions:
        return (len(functions[name][1]),)
    if name in _MADE:
        return (_MADE[name][0],)
    if name in CIRCUIT_ONLY:
        return CIRCUIT_ONLY[name]
    if name in SOLUTION:
        raise ExpressionError(f"{name}() takes names of nodes or a source")
    if name in FUNCTIONS:
        return (OPERATIONS[_SAME.get(name, name)].arguments,)
    known_names = {*FUNCTIONS, *functions}
    hint = f"; write {ELSEWHERE[name]}" if name in ELSEWHERE else nearest(name, known_names)
    raise ExpressionError(f"unknown function {name[:60]}{hint}")


_HIDDEN = {"negative", "and", "or", "not"}
# All functions that an expression may call, apart from functions defined in the file.
FUNCTIONS = {name for name in OPERATIONS if name.isalpha() and name not in _HIDDEN}
FUNCTIONS |= {*_SAME, *_MADE, *CIRCUIT_ONLY, *SOLUTION}


def _unknown(name):
    raise ExpressionError(f"unknown name {name[:60]}: define it by .param")


class Names(NamedTuple):
    """Lookup of an expression's names and functions.

    Attributes
    ----------
    name : returns the tree of a name.
    function : returns (arguments, tree, look-up of local functions) of a file's function, or None.
    parameters_only : whether the expression is a parameter's value: it is constant, pow() keeps
        the sign, and pwr() does not.
    """

    name: Callable[[str], Tree] = _unknown
    function: Callable[[str], Any] = lambda name: None
    parameters_only: bool = False


def resolved(tree: Tree, names: Names) -> Tree:
    """Resolve names and functions of a tree, and evaluate constant parts.

    Raises
    ------
    ExpressionError
    """

    def made(here, parts):
        if here[0] == "name":
            return names.name(here[1])
        if here[0] == "call":
            return _called(here[1], parts, names)
        if here[0] in ("v", "i") and names.parameters_only:
            raise NotConstant("must be constant, but changes during the run")
        return _folded(here[0], parts, names) if parts else here

    return rebuilt(tree, made)


def _called(name, arguments, names):
    user_function = names.function(name)
    if user_function is not None:
        formal, body, functions = user_function
        if len(formal) != len(arguments):
            raise ExpressionError(f"{name} takes {len(formal)} arguments, not {len(arguments)}")
        bindings = dict(zip(formal, arguments, strict=True))

        # ngspice replaces a call by the function's text: free names refer to the caller's scope.
        def within(name):
            return bindings[name] if name in bindings else names.name(name)

        return resolved(body, Names(within, functions, names.parameters_only))
    _check_call(name, len(arguments), {})
    if name in CIRCUIT_ONLY:
        return ("call", name, *arguments)
    if names.parameters_only and name in ("pow", "pwr"):
        return _of_parameters(name, arguments)
    if name in _MADE:
        composed = _MADE[name][1](*arguments)
        return rebuilt(
            composed, lambda node, parts: _folded(node[0], parts, names) if parts else node
        )
    return _folded(_SAME.get(name, name), arguments, names)


def _of_parameters(name, arguments):
    """pow() and pwr() in ngspice's parameters: C's pow(), and the power of the absolute value."""
    x, y = (number[1] for number in arguments)
    try:
        return ("number", math.pow(x if name == "pow" else abs(x), y))
    except (ValueError, OverflowError):
        raise ExpressionError(f"{name}() has no value for these numbers") from None


def _folded(kind, parts, names):
    if kind == "if" and is_constant(parts[0]):
        return parts[1] if parts[0][1] else parts[2]
    if not all(map(is_constant, parts)):
        if kind == "%":
            raise ExpressionError("% of a value that changes: write x-y*floor(x/y)")
        return (kind, *parts)
    numbers = [part[1] for part in parts]
    if kind in ("%", "/") and names.parameters_only and numbers[1] == 0.0:
        raise ExpressionError(f"{kind} is undefined: division by 0")
    if kind == "%":
        value = math.fmod(*numbers) if numbers[1] else math.nan
    elif kind == "exp" and names.parameters_only:
        value = math.exp(numbers[0]) if numbers[0] < LARGEST_ARGUMENT else math.inf
    else:
        value = folded(kind, numbers)
    if not math.isfinite(value):
        raise ExpressionError(f"{kind} has no value for these numbers: change its arguments")
    return ("number", value)


# LTspice's names of functions in CIRCUIT_ONLY.
_LTSPICES = {"pwl": "table"}
# Longest expression written for LTspice, in characters: a == b is written with both sides twice.
LONGEST_WRITTEN = 100_000
_LOOSE = {"+": 1, "-": 1, "*": 2, "/": 2}


def written(
    tree: Tree, node: Callable = str, source: Callable = str, dialect: str = "ngspice"
) -> str:
    """Write a tree so that any SPICE release reads it back: with explicit parentheses.

    Parameters
    ----------
    tree : tuple
    node, source : callable
        Functions that spell a node and a source.
    dialect : str
        "ngspice" or "ltspice".
    """

    def made(here, parts):
        kind = here[0]
        if kind == "number":
            text = repr(float(here[1]))
            return f"({text})" if text.startswith("-") else text, 9
        if kind in ("time", "name"):
            return here[-1], 9
        if kind == "i":
            return f"i({source(here[1])})", 9
        if kind == "v":
            return _voltage(here[1], here[2], node), 9
        if kind == "call":
            name = _LTSPICES.get(here[1], here[1]) if dialect == "ltspice" else here[1]
            return f"{name}({','.join(text for text, _ in parts)})", 9
        tightness = _LOOSE.get(kind, 0)
        texts = [text for text, _ in parts]
        form = "{0}%{1}" if kind == "%" else getattr(OPERATIONS[kind], dialect)
        if sum(map(len, texts)) > LONGEST_WRITTEN:
            raise ExpressionError("the expression becomes too long for LTspice: split it")
        if form[0].isalpha():
            return form.format(*texts), 9
        texts = [
            text
            if tightness_of_part == 9 or (k == 0 and 0 < tightness <= tightness_of_part)
            else f"({text})"
            for k, (text, tightness_of_part) in enumerate(parts)
        ]
        return form.format(*texts), tightness

    return rebuilt(tree, made)[0]


def _voltage(a, z, node):
    if a == z:
        return "0.0"
    if a == GROUND:
        return f"(-v({node(z)}))"
    return f"v({node(a)})" if z == GROUND else f"v({node(a)},{node(z)})"


def varies(tree: Tree) -> bool:
    """Whether an unresolved expression depends on a voltage, a current or time."""
    return any(
        leaf[0] in (*SOLUTION, "time") or (leaf[0] == "name" and leaf[1] in VARYING)
        for leaf in leaves(tree)
    )


def renamed(tree: Tree, nodes: Mapping[str, str]) -> Tree:
    """A resolved tree with some nodes renamed."""

    def other(leaf: Tree) -> Tree:
        return ("v", *(nodes.get(n, n) for n in leaf[1:])) if leaf[0] == "v" else leaf

    return replaced(tree, other)
