"""Classifies ngspice's messages by stream and form, not by names or titles in them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from circuits.netlist.load_circuit import LoadCircuit

# Matches the beginning of a line with which ngspice rejects a netlist or ends a run. Quoted lines
# of the netlist begin with an element's flat name or a dot.
_FAULT = re.compile(r"(?:fatal |internal |pt)?error(?=[:!,]| -| on line| in )", re.I)
_MISSING = re.compile(r"(?:could not|can't|cannot|unable to|no such|undefined|unknown) .*", re.I)
_IGNORED = re.compile(r"unrecognized parameter \(.*\) - ignored", re.I)
_ENDED = re.compile(r"doAnalyses: (?:TRAN: *)?", re.I)
_SINGULAR = re.compile(r"warning: (?=singular matrix)", re.I)
# Matches lines that only announce or repeat an error, or report a workaround.
_EMPTY = re.compile(
    r"(note:|error on line|line no\.|command '|trying |supplies reduced |any of the following"
    r"|warning: (model issue|there is no circuit)|warning:.*(step|increment)"
    r"|error: (transient op failed|(the|finding the) operating point|fatal error in ngspice)).*"
    r"|run simulation\(s\) aborted",
    re.I,
)
_SUBJECT = re.compile(r"(?:in line )?((?:[a-z]\.)+x\S+)(?: .*)?|\.model (\S+) .*", re.I)
MOST_REASONS = 3
# Matches the message on too small steps. Causes are switches, and coils with inductance.
_TOO_SMALL = re.compile("timestep too small", re.I)
# Matches reasons that other integration options may cure.
_NEWTON = re.compile(
    "timestep too small|trouble with|singular matrix|no convergence|iteration", re.I
)
_AT_SWITCH = re.compile(r"-instance [sw]\.", re.I)
_CHATTER = "; its own effect toggles it back repeatedly: give it a hysteresis, or a wider one"
_CUT_OFF = (
    "; the inductance maintains the coil's current, but the switching load interrupts it: set "
    "coil.inductance = 0, which changes little if ωL is far below the resistances"
)
# Longest displayed reason, in characters: some messages contain a whole expression.
LONGEST_REASON = 200
# Matches ngspice's flat names: letters and calls, as in "d.xload.d.xbridge.dupper". The name of a
# model follows a colon, as in "xload:ideal".
_FLAT = re.compile(
    r"(?<![\w.])(?:[a-z]\.)*(?:xcopy\d+[.:])?xload[.:]([^\s,;()\"]*[^\s,;:.()\"])(\"?)"
)
# Matches the nodes at a load's pins and the current into it.
_PIN = re.compile(r'"(?:load_(out|ref)|load_\w+|vload#branch)"')
# Letters of elements, in the order of how often Newton's iterations fail at them.
_LETTERS = "bmqjdswegfhvilcr"
# Largest number of elements at a node that are listed.
NAMED = 2


def refusal(lines: list[Any]) -> str:
    """Reason why ngspice rejected a netlist, in one line; empty if it did not.

    Parameters
    ----------
    lines : sequence of str
        Lines of standard error.
    """
    forms = (_FAULT.match, _MISSING.match, _IGNORED.fullmatch)
    refused = (k for k, line in enumerate(lines) if any(form(line.strip()) for form in forms))
    first = next(refused, None)
    if first is None:
        return ""
    # The element's model precedes the error.
    start = max(first - 2, 0) if _IGNORED.fullmatch(lines[first].strip()) else first
    return _as_message(lines[start:])


def abortion(lines: Sequence[str]) -> str:
    """Why a run ended early, in one line; empty if ngspice gave no reason."""
    reasons = [
        line
        for line in lines
        if any(form.match(line.strip()) for form in (_FAULT, _MISSING, _ENDED, _SINGULAR, _SUBJECT))
    ]
    return _as_message(reasons)


def advice(reason: str, drives_current: bool) -> str:
    """Advice to append to the reason of an early end; may be empty.

    Parameters
    ----------
    reason : str
    drives_current : bool
        Whether the transducer is a coil with inductance.
    """
    if not _TOO_SMALL.search(reason):
        return ""
    if drives_current:
        return _CUT_OFF
    return _CHATTER if _AT_SWITCH.search(reason) else ""


def _as_message(lines):
    """Summarize ngspice's messages in one line: the element, then the reasons."""
    subject, reasons = "", {}
    for line in map(str.strip, lines):
        match = _SUBJECT.fullmatch(line)
        if match:
            subject = subject or match.group(1) or f"model {match.group(2)}"
        elif line and not _EMPTY.fullmatch(line):
            forms = (form.match(line) for form in (_FAULT, _ENDED, _SINGULAR))
            form = next(filter(None, forms), None)
            message = (line[form.end() :] if form else line).removesuffix(" - ignored")
            message = " ".join(message.lstrip(" :!,").rstrip(" :,").split())
            reasons[message[:LONGEST_REASON]] = True
    summary = "; ".join(list(reasons)[:MOST_REASONS]) or "it gave no reason"
    return f"{subject}: {summary}" if subject else summary


def fails_to_converge(reason: str) -> bool:
    """Whether a run ended because iterations did not converge or the matrix was singular."""
    return bool(_NEWTON.search(reason))


def with_places(message: str, load: LoadCircuit | None) -> str:
    """Replace flat names in a message of ngspice by the names in the load's files."""
    if load is None:
        return message
    placed = _PIN.sub(lambda pin: f'"xload.{pin.group(1) or "p"}"', message)
    placed = _FLAT.sub(lambda match: _named(match.group(1), match.group(2), load), placed)
    if any(element.where in placed for element in load.elements):
        return placed
    return f"{placed} (the load is {load.file})"


def _named(flat, quote, load):
    """ "dupper (bridge.lib:24)" for an element, or the name of a node."""
    path = re.split("[.:]", flat.removesuffix("#branch"))
    # The element's letter is repeated between the calls.
    full = ".".join(part for k, part in enumerate(path) if len(part) > 1 or k == len(path) - 1)
    places = {element.name: element.where for element in load.elements}
    if full in places:
        return f"{path[-1]}{quote} ({places[full]})"
    near = [element for element in load.elements if full in element.nodes]
    near.sort(key=lambda element: _LETTERS.find(element.letter))
    names = " and ".join(element.place for element in near[:NAMED])
    return f"{path[-1]}{quote} of the load" + (f", at {names}" if names else "")
