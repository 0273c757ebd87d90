"""Every form of a part says the same: numba code, Python, netlist expression, Verilog-A."""

import itertools
import math
import re

import numpy as np
import pytest
from device_scenes import MAGNETS
from device_truths import Written
from scipy.integrate import quad

from circuits.equivalent.assembly import assemble
from circuits.equivalent.compact_model import module
from harvester.base.compilation import compiled
from harvester.device import contact as contacts
from harvester.device import damper, spring, system
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared

RANDOM = np.random.default_rng(31)
RATE = 3.7


def as_python(formula):
    """A formula of netlists and Verilog-A as Python: a ? b : c, node voltages, pow."""
    formula = re.sub(r"v\((\w+)\)", r"\1", formula.strip())
    depth, question = 0, None
    for place, letter in enumerate(formula):
        depth += {"(": 1, ")": -1}.get(letter, 0)
        if letter == "?" and depth == 0 and question is None:
            question = place
            nested = 0
        elif letter == "?" and depth == 0:
            nested += 1
        elif letter == ":" and depth == 0 and question is not None:
            if nested == 0:
                condition, yes, no = formula[:question], formula[question + 1 : place], place + 1
                parts = map(as_python, (yes, condition, formula[no:]))
                return "({} if {} else {})".format(*parts)
            nested -= 1
    pieces = []
    while formula:
        start = formula.find("(")
        if start < 0:
            pieces.append(formula)
            break
        depth = 0
        for end in range(start, len(formula)):
            depth += {"(": 1, ")": -1}.get(formula[end], 0)
            if depth == 0:
                break
        inner = ",".join(as_python(each) for each in arguments(formula[start + 1 : end]))
        pieces += [formula[:start], f"({inner})"]
        formula = formula[end + 1 :]
    return "".join(pieces)


def arguments(text):
    """The text cut at its outer commas."""
    depth, parts = 0, [""]
    for letter in text:
        depth += {"(": 1, ")": -1}.get(letter, 0)
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


def value(formula, **names):
    """A formula's value."""

    def sgn(x):
        return float(np.sign(x))

    known = {"pow": math.pow, "abs": abs, "sgn": sgn, "sqrt": math.sqrt, **names}
    return eval(as_python(formula), {"__builtins__": {}}, known)


FORCES = {
    **{f"degree {n}": [*RANDOM.normal(size=n), 1.0 + RANDOM.random()] for n in (1, 3, 5, 7)},
    "only odd": [0.0, -4.0, 0.0, 3.9, 0.0, 0.4, 0.0, 0.2],
    "tiny": [1e-9, -1e-12, 0.0, 1e-3],
    "bias alone": [0.3, 2.0],
    "gaps": [0.0, -1.0, 0.0, 0.0, 0.0, 1.0],
    "table": {"force_table": MAGNETS},
    "smoothed table": {"force_table": MAGNETS, "force_interpolation": "smooth"},
    "softening in a range": {
        "restoring_force": [0.1, 2.0, 0.0, -0.4],
        "restoring_force_range": [-1.6, 1.6],
    },
    # Between equal stoppers, whose speed is then a product of its own.
    "cubic": [0.0, -4.0, 0.0, 3.9],
}
STOPPERS = {
    "none": [],
    "pair": [{"gap": 0.8, "stiffness": 20.0, "restitution": 0.6}],
    "right": [{"gap": 0.5, "stiffness": 9.0, "restitution": 0.0, "side": "right"}],
    "left, exponent": [
        {"gap": 0.4, "stiffness": 30.0, "restitution": 0.3, "side": "left", "exponent": 1.2}
    ],
    "two on the right": [
        {"gap": 0.3, "stiffness": 5.0, "restitution": 0.9, "side": "right", "exponent": 1.0},
        {"gap": 0.6, "stiffness": 50.0, "restitution": 0.5, "side": "right", "exponent": 2.5},
        {"gap": 0.7, "stiffness": 40.0, "restitution": 1.0, "side": "left"},
    ],
    # On both sides of a spring that is not symmetric: 32 contacts.
    "sixteen": [{"gap": 0.1 * k, "stiffness": k, "restitution": 0.5} for k in range(1, 17)],
    "held": [{"gap": 0.5, "stiffness": 9.0, "restitution": 0.4, "impact_velocity": "event"}],
}


def scene_of(force, stoppers, **oscillator):
    base = Scene.read("linear").to_tables()
    force = force if isinstance(force, dict) else {"restoring_force": force}
    base["oscillator"] = {"damping": 0.1, **force, **oscillator}
    return Scene.from_tables({**base, **({"stoppers": stoppers} if stoppers else {})})


@compiled
def compiled_forces(s, x, v, held, low, high):
    return (
        spring.force(s.spring, x),
        spring.energy(s.spring, x),
        system.part_force(s.damper, v),
        contacts.force(s.contacts, s.spring, x, v, held, low, high),
        contacts.energy(s.contacts, x),
        contacts.loss_rate(s.contacts, s.spring, x, v, held),
    )


# These compile longest.
MOST_CODE = [("tiny", "sixteen"), ("table", "pair")]


def zone(s, x):
    edges = contacts.edges(s.contacts)
    return next((a, b) for a, b in itertools.pairwise(edges) if a <= x <= b)


def states(count):
    """Random displacements, velocities and held speeds, still and very slow ones too."""
    speeds = np.concatenate([[0.0, 1e-9, -1e-9], RANDOM.normal(size=count)])
    for v in speeds:
        yield RANDOM.uniform(-1.5, 1.5), float(v), abs(v) * RANDOM.uniform(0.5, 3.0) + 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("force", "stoppers"),
    [
        pytest.param(*pair, marks=pytest.mark.exhaustive if pair in MOST_CODE else ())
        for pair in zip(FORCES, itertools.cycle(STOPPERS), strict=False)
    ],
)
def test_all_forms_of_a_device_agree_at_random_states(force, stoppers):
    scene = scene_of(FORCES[force], STOPPERS[stoppers], quadratic_damping=0.7)
    s = prepared(scene).system
    truth = Written(scene)
    netlist, own_rate = netlist_force(scene)
    verilog = None if stoppers == "held" else verilog_force(s)
    for x, v, held in states(25):
        low, high = zone(s, x)
        in_contact = sum(truth.contact(*each, x, v, held) for each in truth.contacts)
        expected = truth.spring(x) + truth.damping * v + truth.drag * abs(v) * v + in_contact
        near = pytest.approx(expected, rel=1e-11, abs=1e-11)
        got = compiled_forces(s, x, v, held, low, high)
        assert got[0] + got[2] + got[3] == near
        python = float(spring.force(s.spring, x)) + s.damper.force(v)
        assert python + contacts.force(s.contacts, s.spring, x, v, held, low, high) == near
        assert netlist(x, v, held) * own_rate**2 == near
        if verilog:
            assert verilog(x, v / RATE) * RATE**2 == near
        energy = truth.spring_energy(x)
        assert got[1] == pytest.approx(energy, rel=1e-11, abs=1e-13)
        assert float(spring.energy(s.spring, x)) == pytest.approx(energy, rel=1e-11, abs=1e-13)
        stored = truth.contact_energy(x)
        assert got[4] == pytest.approx(stored, rel=1e-11, abs=1e-14)
        assert float(contacts.energy(s.contacts, x)) == pytest.approx(stored, rel=1e-11, abs=1e-14)
        elastic = float(contacts.elastic_push(s.contacts, x))
        assert got[5] * v == pytest.approx(in_contact - elastic, rel=1e-9, abs=1e-11)
        assert system.elastic_force(s, x) == pytest.approx(truth.spring(x) + elastic, abs=1e-11)


def netlist_force(scene):
    """Force over rate² as a function of x, v and held speed, from the netlist's own lines."""
    text = assemble(prepared(scene)).text

    def last_of(element):
        found = re.search(rf"^{element} .*?(\S+)(?: ic=.*)?$", text, re.M)
        return found.group(1) if found else "0.0"

    rate = 1.0 / float(re.search(r"^Cmass \S+ \S+ (\S+)", text, re.M).group(1))
    terms = [f"velocity/{last_of('Rdamper')}", last_of("Itilt")]
    terms.append(f"displacement*({last_of('Gspring')})")
    names = r"cubic|nonlinear_spring|drag|stopper\w*"
    terms += [
        f"({found.group(1)})"
        for found in re.finditer(rf"^B(?:{names}) velocity 0 [iI]=(.*)$", text, re.M)
    ]

    def force(x, v, held):
        named = {"displacement": x, "velocity": v / rate, "held_speed": held / rate}
        return sum(value(each, **named) for each in terms)

    return force, rate


def verilog_force(s):
    """Force over RATE² as a function of x and u, from the statements of the Verilog-A module."""
    _, text, numbers = module(s, RATE)
    body = text[text.index("u = V(velocity);") : text.index("I(displacement) <+")]
    assigned = re.findall(r"(?:if \((.*)\)\n\s*)?push = ([^;]*);", body)
    assigned = [(condition, " ".join(formula.split())) for condition, formula in assigned]

    def force(x, u):
        push = 0.0
        for condition, formula in assigned:
            if not condition or value(condition, x=x, u=u, **numbers):
                push = value(formula, x=x, u=u, push=push, **numbers)
        return push

    return force


@pytest.mark.parametrize("stoppers", ["pair", "two on the right", "left, exponent"])
def test_energies_are_integrals_of_forces_and_stoppers_push_inwards(stoppers):
    s = prepared(scene_of(FORCES["degree 7"], STOPPERS[stoppers])).system
    edges = [x for x in contacts.edges(s.contacts) if math.isfinite(x)]
    for x in (-1.4, -0.45, 0.2, 0.55, 1.3):
        points = [edge for edge in edges if min(0.0, x) < edge < max(0.0, x)]
        integral = quad(lambda y: float(system.elastic_force(s, y)), 0.0, x, points=points or None)
        assert float(system.potential(s, x)) == pytest.approx(integral[0], rel=1e-8)
        push = float(contacts.elastic_push(s.contacts, x))
        assert push * x >= 0.0
        assert (push != 0.0) == any(abs(x) > abs(edge) and x * edge > 0.0 for edge in edges)


def test_a_drag_takes_energy_whichever_way_the_mass_moves():
    part = damper.damper(0.0, 0.4)
    for v in (-2.0, -0.1, 0.3):
        assert part.force(v) * v == pytest.approx(0.4 * abs(v) ** 3)
        assert part.rate(v) * v * v == pytest.approx(0.4 * abs(v) ** 3)
