"""What pieces of a study are cut from: the scene of a point, or its control, by a method."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

import harvester
from harvester.averaging import CLOSURES
from harvester.device import timescales
from harvester.engines import side_by_side
from harvester.engines.realization import empty_moments
from harvester.excitation import OrnsteinUhlenbeck
from harvester.record.moments import QUANTITIES
from harvester.record.output_side import OutputMoments
from harvester.record.record import Record
from harvester.scene.model import Scene
from harvester.scene.units import scale
from harvester.studies.pieces import WAVEFORM_POINTS, key_of

# Realizations in one piece where they run side by side or fast.
TOGETHER = 8
# The control's mean comes from so many realizations, this much longer, of another seed.
CONTROL_REALIZATIONS, CONTROL_LENGTH = 32, 30.0
# Periods of small oscillations in a waveform.
PERIODS = 6.0


@dataclass(frozen=True)
class Source:
    """A scene by a method: what pieces are cut from."""

    scene: Scene
    method: str
    step: str | float
    size: int
    version: str
    window: tuple | None = None

    @property
    def most(self):
        """Realizations there are."""
        return self.scene.run.realizations

    def call(self, start):
        """Arguments of `pieces.compute` for the piece that begins with this realization."""
        return {
            "scene": self.scene,
            "engine": self.method,
            "indices": list(range(start, min(start + self.size, self.most))),
            "step": self.step,
            "window": self.window if start == 0 else None,
        }

    @cached_property
    def digest(self):
        """The scene's, worked out once."""
        return self.scene.digest()

    def key(self, start):
        """Name of that piece."""
        call = self.call(start)
        decides = (call[name] for name in ("engine", "indices", "step", "window"))
        return key_of(self.digest, *decides, self.version)

    @cached_property
    def _template(self):
        return None if self.method in CLOSURES else empty_moments(self.scene)

    def misfit(self, start, piece):
        """What of a piece cannot come from here; "" where all may.

        Parameters
        ----------
        start : int
        piece : harvester.studies.piece_file.Piece
        """
        if piece.failure:
            return ""
        if self._template is None:
            return "" if piece.quantities else "is not of a closure"
        if len(piece.moments) != len(self.call(start)["indices"]):
            return "has another number of realizations"
        shape = (len(Record._fields), WAVEFORM_POINTS)
        if piece.waveform is not None and piece.waveform.shape != shape:
            return "its waveform has another shape"
        load = self.scene.electrical_load.circuit
        has_output = bool(load and load.has_output)
        if all(_fits(each, self._template, has_output) for each in piece.moments):
            return ""
        return "its numbers are not those of this scene"


def make_source(scene, method, step, version):
    """The `Source` of one scene by one engine or closure, its first window some periods long.

    Parameters
    ----------
    scene : harvester.scene.model.Scene
    method : str
        An engine or a closure.
    step : str or float
        As `harvester.simulation.simulate` takes it.
    version : str
        Of what makes the numbers, part of their key.
    """
    parameters, _ = scale(scene)
    start = scene.run.settle
    window = (start, start + PERIODS * 2.0 * math.pi / timescales.angular_frequency(parameters))
    window = (start, min(window[1], start + scene.run.duration))
    if method in CLOSURES:
        return Source(scene, method, step, 1, version)
    return Source(scene, method, step, _together(scene, method, step), version, window)


def _fits(moments, template, has_output):
    """Whether moments have the shapes and times that the scene gives them, and finite sums."""
    same = ("start", "batch_length", "free", "saddles", "sample_interval")
    shaped = ("integrals", "products", "bin_widths", "first", "last")
    if not all(np.array_equal(getattr(moments, name), getattr(template, name)) for name in same):
        return False
    for name in shaped:
        array = getattr(moments, name)
        if np.shape(array) != np.shape(getattr(template, name)) or not np.isfinite(array).all():
            return False
    output, integrals = moments.output, moments.integrals
    if has_output != (output is not None):
        return False
    if has_output:
        expected = OutputMoments.beside(moments)
        for name in ("integrals", "passages"):
            if np.shape(getattr(output, name)) != np.shape(getattr(expected, name)):
                return False
        if not np.isfinite(output.integrals).all():
            return False
    squares = QUANTITIES.index("square_velocity") + 1
    return bool((integrals[:, :squares] >= 0.0).all() and integrals[:, 0].sum() > 0.0)


def _together(scene, method, step):
    """Realizations in one piece: several only where they cost less so."""
    many = scene.replace({"run.realizations": TOGETHER * side_by_side.FEWEST_NETLISTS})
    size = side_by_side.copies(many, lambda: TOGETHER, step) if method == "circuit" else TOGETHER
    return min(size, scene.run.realizations)


def control_of(scene):
    """Monte Carlo of the device with the resistor that matches it; None where there is none."""
    if not isinstance(scene.excitation, OrnsteinUhlenbeck):
        return None
    parameters, _ = scale(scene)
    rate = timescales.angular_frequency(parameters)
    if scene.coil:
        load = {"resistance": scene.coil.resistance}
    elif scene.units == "SI":
        load = {"resistance": 1.0 / (rate * scene.piezo.capacitance)}
    else:
        load = {"decay_rate": rate}
    tables = scene.to_tables()
    tables["load"] = load
    tables["excitation"].setdefault("knot_spacing", scene.excitation.knot_spacing)
    resistor = Scene.from_tables(tables, name=scene.name, origin=scene.name)
    return Source(
        resistor, "monte-carlo", "default", TOGETHER, f"harvester {harvester.__version__}"
    )


def long_control(control):
    """Where a control's mean is known from: longer, and another seed."""
    run = control.scene.run
    scene = control.scene.replace(
        {
            "run.seed": run.seed + 1,
            "run.duration": CONTROL_LENGTH * run.duration,
            "run.realizations": CONTROL_REALIZATIONS,
        }
    )
    return Source(scene, control.method, control.step, 1, control.version)
