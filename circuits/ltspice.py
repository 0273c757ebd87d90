"""ngspice's netlists in LTspice's words."""

from __future__ import annotations

import re

from circuits.loads.reader import statements
from harvester.errors import NetlistError

# Documented in LTspice's help under "B. Arbitrary Behavioral Voltage or Current Sources".
FUNCTIONS = {
    "abs", "absdelay", "acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "buf", "ceil",
    "cos", "cosh", "ddt", "delay", "exp", "floor", "hypot", "i", "idt", "idtmod", "if", "int",
    "inv", "limit", "ln", "log", "log10", "max", "min", "pow", "pwr", "pwrs", "rand", "random",
    "round", "sdt", "sgn", "sin", "sinh", "sqrt", "table", "tan", "tanh", "u", "uramp", "v",
    "white",
}  # fmt: skip
# ngspice's pow(x, y) is |x|^y, LTspice's is the real part of x^y; their pwr differ likewise.
RENAMED = {
    "pow": "pwr", "pwr": "pwrs", "log": "ln", "nint": "round", "ternary_fcn": "if", "pwl": "table",
}  # fmt: skip
CONSTANTS = {"temper": "temp"}
# Of a B source itself.
VARIABLES = {"time", "pi", "temp"}
DIFFERENCES = (
    "the noise is read from a file beside this one (PWL file=), not written out here",
    "conditions are if(a,b,c) in place of a ? b : c; a==b is (a>=b)*(a<=b)",
    "pwr(x,y) = |x|^y stands for ngspice's pow(x,y), pwrs for its pwr",
    "the noise current is I(Inoise) in place of @inoise[current]",
    "plotwinsize=0 turns the compression of waveforms off, numdgt=7 keeps them in double precision",
    "trtol scales each simulator's own error estimate: the steps are not the same",
)
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?[a-z]*)|(?P<name>[a-z_][\w.#]*)"
    r"|(?P<operator>\*\*|&&|\|\||[<>=!]=|[-+*/^<>?:,(){}!~%]))",
    re.IGNORECASE,
)
# Characters of an expression: a == b says both sides twice.
LONGEST_EXPRESSION = 100_000
# Binary operators from the loosest to the tightest, and LTspice's word for them.
OPERATOR_LEVELS = (
    {"||": "|"},
    {"&&": "&"},
    {"==": "==", "!=": "!="},
    {"<": "<", ">": ">", "<=": "<=", ">=": ">="},
    {"+": "+", "-": "-"},
    {"*": "*", "/": "/"},
)


def to_ltspice(text: str) -> str:
    """Elements, sub-circuits, models and analysis as LTspice reads them.

    Parameters
    ----------
    text : str
        A netlist of `circuits.assembly`, the noise source's waveform already LTspice's.

    Returns
    -------
    str

    Raises
    ------
    NetlistError
        An expression that LTspice has no words for.
    """
    return "\n".join(filter(None, map(_card, statements(text, "netlist")))) + "\n"


def _card(card):
    first = card.text.split()[0].lower()
    if first == ".title":
        return ""
    if first == ".save":
        return re.sub(r"@(\w+)\[current\]", r"I(\1)", card.text)
    if first.startswith(".options"):
        return f"{card.text} plotwinsize=0 numdgt=7"
    if first.startswith("b"):
        head, equals, expression = card.text.partition("=")
        return f"{head}{equals}{translate(expression, behavioural=True)}"
    if re.fullmatch(r"\.param pi=3\.14\d*", card.text.lower()):
        return ""  # LTspice's own
    return re.sub(r"\{([^{}]*)\}", lambda found: f"{{{translate(found.group(1))}}}", card.text)


def translate(expression: str, behavioural: bool = False) -> str:
    """An expression of ngspice in LTspice's words.

    Parameters
    ----------
    expression : str
    behavioural : bool
        Of a B source, where parameters stand in braces.

    Raises
    ------
    NetlistError
        It cannot be said there.

    Examples
    --------
    >>> translate("(v(x) > 1) ? pow(v(x)-1, 1.5) : 0", behavioural=True)
    'if((v(x)>1),pwr(v(x)-1,1.5),0)'
    """
    return _Translation(expression, behavioural).all()


class _Translation:
    """A recursive descent over the expression, one method for a kind of operator."""

    def __init__(self, expression, behavioural):
        self._expression = expression
        self._braces = behavioural
        self._tokens = []
        place = 0
        text = expression.strip()
        while place < len(text):
            found = _TOKEN.match(text, place)
            if not found:
                self._refuse(f"{text[place]!r} means nothing")
            self._tokens.append((found.lastgroup, found.group(found.lastgroup)))
            place = found.end()

    def all(self):
        try:
            said = self._condition()
        except RecursionError:
            self._refuse("it nests too deeply")
        if self._tokens:
            self._refuse(f"{self._tokens[0][1]!r} stands where it has no meaning")
        return said

    def _refuse(self, fault):
        raise NetlistError(f"{self._expression.strip()[:60]!r}: {fault}; not written for LTspice")

    def _next(self):
        return self._tokens[0][1] if self._tokens else ""

    def _take(self, expected=None):
        if not self._tokens or (expected and self._next() != expected):
            self._refuse(f"{expected or 'an operand'} is missing")
        return self._tokens.pop(0)

    def _condition(self):
        said = self._binary(0)
        if self._next() != "?":
            return said
        self._take("?")
        yes = self._condition()
        self._take(":")
        return f"if({said},{yes},{self._condition()})"

    def _binary(self, level):
        if level == len(OPERATOR_LEVELS):
            return self._power()
        said = self._binary(level + 1)
        while self._next() in OPERATOR_LEVELS[level]:
            word = OPERATOR_LEVELS[level][self._take()[1]]
            other = self._binary(level + 1)
            if len(said) + len(other) > LONGEST_EXPRESSION:
                self._refuse("it grows too long")
            same = f"((({said})>=({other}))*(({said})<=({other})))"
            both = f"(({said}){word}({other}))"
            special = {"==": same, "!=": f"(1-{same})", "&": both, "|": both}
            said = special.get(word, f"{said}{word}{other}")
        return said

    def _power(self):
        if self._next() in ("-", "+", "!"):
            return f"{self._take()[1]}{self._power()}"
        said = self._operand()
        while self._next() in ("^", "**"):
            self._take()
            sign = self._take()[1] if self._next() in ("-", "+") else ""
            # ngspice raises the size of the base, from left to right.
            said = f"pwr({said},{sign}{self._operand()})"
        return said

    def _operand(self):
        kind, word = self._take()
        if word == "(":
            said = self._condition()
            self._take(")")
            return f"({said})"
        if word == "{":
            return self._parameters()
        if kind == "operator":
            self._refuse(f"{word!r} has no equal there")
        if kind == "name" and self._next() == "(":
            return self._call(word)
        word = CONSTANTS.get(word.lower(), word)
        known = kind == "number" or word.lower() in VARIABLES or not self._braces
        return word if known else f"{{{word}}}"

    def _parameters(self):
        outside, self._braces = self._braces, False
        said = self._condition()
        self._take("}")
        self._braces = outside
        return f"{{{said}}}"

    def _call(self, name):
        self._take("(")
        if name.lower() in ("v", "i"):
            return f"{name}({''.join(self._until_closed())})"
        arguments = [self._condition()]
        while self._next() == ",":
            self._take(",")
            arguments.append(self._condition())
        self._take(")")
        if name.lower() == "u2":
            return f"limit({arguments[0]},0,1)"
        word = RENAMED.get(name.lower(), name)
        if word.lower() not in FUNCTIONS:
            self._refuse(f"{name} is no function of LTspice")
        return f"{word}({','.join(arguments)})"

    def _until_closed(self):
        """Names of nodes or of a source, as they stand."""
        while self._next() != ")":
            yield self._take()[1]
        self._take(")")
