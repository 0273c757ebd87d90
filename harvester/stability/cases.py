"""The stiff and extreme cases of `harvester stability`: what each changes in a scene.

Values are those of the scaled equations (Eqs. 4–6) and are turned to the scene's units, so that
one matrix serves scaled and SI scenes.
"""

import math
from dataclasses import dataclass

from harvester.device import timescales
from harvester.errors import SceneError
from harvester.parameters import knot_spacing, length_scale, scale, steps_per_knot

# Realizations of a case: independent, so that there is an error bar however short they are.
REALIZATIONS = 16
# Steps of all of them together, and how many slow times each measures and lets pass first.
STEP_BUDGET = 200_000
MEASURED_TIMES = 50.0
SETTLED_TIMES = 5.0
LARGEST_SETTLED_SHARE = 0.2
# Stoppers of a scene that has none: gap in well distances, K, e.
GAP, STIFFNESS, RESTITUTION = 1.1, 10.0, 0.7


@dataclass(frozen=True)
class Case:
    """One cell of the matrix.

    Attributes
    ----------
    family : str
        What is varied.
    name : str
        Value or values, as text.
    values : dict of str to float, str or None
        Scaled values by the names in `_KEYS`; {"stoppers": None} takes the stoppers away.
    """

    family: str
    name: str
    values: dict

    @property
    def title(self):
        """Family and name."""
        return f"{self.family}: {self.name}" if self.family != "corner" else self.name


def default_cases():
    """The whole matrix, a list of `Case`."""
    cases = [Case("scene", "as it is", {})]
    cases += _decades("stiffness", "K", 2, 8)
    cases += [Case("restitution", f"e = {e:g}", {"restitution": e}) for e in (0.0, 0.05, 1.0)]
    cases += [
        Case("gap", f"δ = {gap:g} wells", {"gap_in_wells": gap})
        for gap in (0.5, 0.8, 0.95, 1.0, 1.05, 1.3, 2.0, 10.0)
    ]
    cases += _decades("intensity", "D", -6, 2)
    cases += _decades("correlation_time", "τ1", -3, 3)
    cases += _decades("decay_rate", "λ", -4, 4)
    cases += [Case("coupling", f"β = {b:g}", {"coupling": b}) for b in (0.0, 0.1, 1, 3, 10, 100)]
    cases += [
        Case("structure", "no stoppers", {"stoppers": None}),
        Case("structure", "monostable", {"monostable": True}),
        Case("structure", "monostable, no stoppers", {"monostable": True, "stoppers": None}),
        Case("structure", "v0 held", {"impact_velocity": "event"}),
    ]
    return cases + [Case("corner", name, values) for name, values in _CORNERS.items()]


_CORNERS = {
    "K = 1e8, D = 1, e = 0.05": {"stiffness": 1e8, "intensity": 1.0, "restitution": 0.05},
    "K = 1e8, D = 100": {"stiffness": 1e8, "intensity": 100.0},
    "K = 1e6, δ = 0.5 wells": {"stiffness": 1e6, "gap_in_wells": 0.5},
    "K = 1e8, δ = 1 well, e = 0": {"stiffness": 1e8, "gap_in_wells": 1.0, "restitution": 0.0},
    "K = 1e6, τ1 = 1e-3": {"stiffness": 1e6, "correlation_time": 1e-3},
    "K = 1e6, v0 held, e = 0.3": {
        "stiffness": 1e6,
        "impact_velocity": "event",
        "restitution": 0.3,
    },
    "λ = 1e4, β = 100": {"decay_rate": 1e4, "coupling": 100.0},
    "λ = 1e-4, β = 100": {"decay_rate": 1e-4, "coupling": 100.0},
    "D = 1e-6, β = 100": {"intensity": 1e-6, "coupling": 100.0},
    "D = 100, no stoppers": {"intensity": 100.0, "stoppers": None},
    "D = 100, τ1 = 1e-3": {"intensity": 100.0, "correlation_time": 1e-3},
    "D = 100, λ = 1e4, e = 1": {"intensity": 100.0, "decay_rate": 1e4, "restitution": 1.0},
}


def changed(scene, case):
    """The scene of one case, with its run length chosen.

    Raises
    ------
    SceneError
        The case is none for this scene.
    """
    changes = {
        "excitation.knot_spacing": None,
        "run.realizations": REALIZATIONS,
        **_changes(scene, case),
    }
    if scene.units == "SI":
        # The scaled values stay those of the unchanged scene's length unit.
        changes["length_scale"] = length_scale(scene)
    if "stoppers" in changes:
        del changes["stoppers"]
        new = scene.replace(changes, stoppers=None)
    else:
        new = scene.replace(changes)
    settle, duration = run_length(new)
    return new.replace({"run.settle": settle, "run.duration": duration})


def _changes(scene, case):
    """The case's overrides by dotted keys, in the scene's units."""
    values = dict(case.values)
    if "stoppers" in values:
        changes = {"stoppers": None}
    elif not scene.stoppers and values.keys() & {"stiffness", "gap_in_wells", "restitution"}:
        values = {
            "stiffness": STIFFNESS,
            "gap_in_wells": GAP,
            "restitution": RESTITUTION,
            **values,
        }
        changes = {}
    else:
        changes = {}
    for name, value in values.items():
        if name != "stoppers":
            _check_part(scene, name)
            key, convert = _KEYS[scene.units][name]
            for place in _places(scene, key):
                changes[place] = convert(scene, value)
    return changes


def _check_part(scene, name):
    """Refuse a variation of a part that the device does not have."""
    lacking = {
        "coupling": (scene.piezo is None, "a piezo"),
        "decay_rate": (scene.piezo is None, "a piezo"),
        "monostable": (scene.oscillator.linear_stiffness is None, "a linear and cubic spring"),
    }
    absent, part = lacking.get(name, (False, ""))
    if absent:
        raise SceneError(f"{scene.name}: this case varies {part}, and the device has none")


def _places(scene, key):
    """A key, or one of each of several stoppers."""
    table, _, name = key.partition(".")
    if table == "stoppers" and isinstance(scene.to_tables().get(table), list):
        return [f"{table}[{k}].{name}" for k in range(len(scene.stoppers))]
    return [key]


def _reference_length(scene):
    """The well's distance in scaled units; without a well the gap, or one unit."""
    p, _ = scale(scene)
    bare = p._replace(contacts=())
    if 0.0 < timescales.rest(bare) < math.inf:
        return timescales.rest(bare)
    gap = timescales.free_zone(p)[1]
    return gap if math.isfinite(gap) else 1.0


_ANY = {
    "restitution": ("stoppers.restitution", lambda scene, e: e),
    "impact_velocity": ("stoppers.impact_velocity", lambda scene, name: name),
    "correlation_time": ("excitation.correlation_time", lambda scene, time: time),
    "monostable": (
        "oscillator.linear_stiffness",
        lambda scene, _: abs(scene.oscillator.linear_stiffness),
    ),
}
# Name in a case → dotted key of a scene, and the scaled value in its units (Eq. 3).
_KEYS = {
    "scaled": {
        **_ANY,
        "stiffness": ("stoppers.stiffness", lambda scene, k: k),
        "gap_in_wells": ("stoppers.gap", lambda scene, gap: gap * _reference_length(scene)),
        "intensity": ("excitation.intensity", lambda scene, d: d),
        "decay_rate": ("load.decay_rate", lambda scene, rate: rate),
        "coupling": ("piezo.coupling", lambda scene, beta: beta),
    },
    "SI": {
        **_ANY,
        "stiffness": (
            "stoppers.stiffness",
            lambda scene, k: k * scene.oscillator.mass / math.sqrt(length_scale(scene)),
        ),
        "gap_in_wells": (
            "stoppers.gap",
            lambda scene, gap: gap * _reference_length(scene) * length_scale(scene),
        ),
        "intensity": ("excitation.intensity", lambda scene, d: d * length_scale(scene) ** 2),
        "decay_rate": (
            "load.resistance",
            lambda scene, rate: 1.0 / (rate * scene.piezo.capacitance),
        ),
        "coupling": (
            "piezo.coupling",
            lambda scene, beta: math.sqrt(beta * scene.oscillator.mass * scene.piezo.capacitance),
        ),
    },
}


def run_length(scene):
    """Settling and measured time (s) from the scene's own times, within the budget of steps.

    The slowest of relaxation time, period, correlation time and 1/λ is to be seen many times.
    """
    p, _ = scale(scene)
    period = 2.0 * math.pi / timescales.angular_frequency(p)
    slowest = max(timescales.relaxation_time(p), period, p.noise.correlation_time)
    decay = p.transducer.decay_rate()
    if decay > 0.0:
        slowest = max(slowest, 1.0 / decay)
    step = knot_spacing(scene) / steps_per_knot(scene)
    affordable = STEP_BUDGET * step / scene.run.realizations
    settle = min(SETTLED_TIMES * slowest, LARGEST_SETTLED_SHARE * affordable)
    return settle, min(MEASURED_TIMES * slowest, affordable - settle)


def _decades(key, symbol, first, last):
    return [
        Case(key.replace("_", " "), f"{symbol} = 1e{n}", {key: 10.0**n})
        for n in range(first, last + 1)
    ]
