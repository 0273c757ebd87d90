"""Base classes of all excitations, their interface to scenes and engines; and the table [run]."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.errors import SceneError
from harvester.device.keys import SCALED, Table, key, not_negative, positive, table, word

if TYPE_CHECKING:
    from numpy.random.bit_generator import SeedSequence


# Largest seed: numpy draws seeds of 128 bits.
LARGEST_SEED = 2**128 - 1


@table
class Run(Table):
    """Length and number of the realizations, and the seed.

    With `starts` each realization has a random start, uniform over the device's energy range;
    without it, successive realizations begin in successive wells.
    """

    duration: float = positive("duration: measured time; default of a record: all", "s")
    settle: float = not_negative("settling time: discarded before the duration", "s", default=0.0)
    seed: int = key("seed of the random numbers", kind=int, low=0, high=LARGEST_SEED, default=0)
    realizations: int = key("number of realizations", kind=int, low=1, high=1_000_000, default=1)
    starts: int | None = key("number of random starts", kind=int, low=1, high=1_000_000)
    orbit: str | None = word(
        "orbit: evaluated by studies if starts reach several; by default rest",
        ("rest", "best", "weighted"),
    )

    def __post_init__(self) -> None:
        if self.starts is not None:
            object.__setattr__(self, "realizations", self.starts)


def knots(usual: str) -> Any:
    """A field for the spacing of the knots, with a description of its default."""
    return positive(f"spacing of the knots (samples): by default {usual}", "s")


def realization_seed(seed: int, index: int) -> SeedSequence:
    """The independent `SeedSequence` of one realization, identical for all engines and runs.

    It equals the child of `SeedSequence(seed).spawn` at this index.
    """
    return np.random.SeedSequence(seed, spawn_key=(index,))


def child_seed(seed: SeedSequence, index: int) -> SeedSequence:
    """The child that `seed.spawn` would give at this index, without changing the seed."""
    return np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, index))


def kernel_loss(spacing: float, angular_frequency: float) -> float:
    """Share of the spectral density that is lost by linear interpolation between knots.

    A straight line between samples is their convolution with a triangle, whose power gain at
    the frequency ω is sinc⁴(ω spacing/2).
    """
    return 1.0 - float(np.sinc(0.5 * spacing * angular_frequency / np.pi)) ** 4


class ExcitationPath(ABC):
    """The samples of η of one realization, in order, at equally spaced knots.

    Attributes
    ----------
    spacing
        Time between knots (s).
    """

    spacing: float

    @abstractmethod
    def read(self, count: int) -> np.ndarray:
        """The next `count` samples, float64 of shape (count,), independent of the block sizes.

        An engine may read past the end of the run.
        """


class Excitation(Table, ABC):
    """One kind of excitation η, the right-hand side of Eq. 4a, linear between equal knots.

    A kind is a class decorated by `harvester.device.keys.table`: its fields are the keys of the
    scene's table `[excitation]`, in the scene's units. Accelerations are divided by the length unit
    to give η.
    """

    NAME = "excitation"

    kind: str

    @property
    def symmetric(self) -> bool:
        """Whether the path and its negative are equally likely."""
        return True

    @property
    def random(self) -> bool:
        """Whether the path differs from realization to realization."""
        return True

    @property
    def endless(self) -> bool:
        """Whether the number of independent paths is unlimited."""
        return False

    @property
    def lines(self) -> tuple[tuple[float, float], ...]:
        """Frequency (Hz) and amplitude of each sine, whether simultaneous or successive.

        Steps are chosen by these lines: near a resonance an integrator's frequency error changes a
        sine's power.
        """
        return ()

    @property
    def period(self) -> float | None:
        """Period of the excitation (s); None if it has none."""
        return None

    @property
    def own_duration(self) -> float | None:
        """Duration of the excitation (s), the default of `run.duration`; None if unlimited."""
        return None

    @property
    def longest_run(self) -> float:
        """Longest sum of run.settle and run.duration (s)."""
        return math.inf

    def longer_run(self, run: Run) -> str:
        """Advice for means that need a longer run; a record may end."""
        if run.settle + 1.01 * run.duration > self.longest_run:
            return f"take a longer record than its {self.longest_run:g} s"
        return f"raise run.duration = {run.duration:g}"

    @property
    def drifts(self) -> bool:
        """Whether the intensity changes during the run, as in the record of one event."""
        return False

    def transient(self, run: Run) -> bool:
        """Whether a run contains only a few events, not a sample of a stationary signal."""
        return False

    @property
    def kept_samples(self) -> int:
        """Number of samples that a path keeps in memory for the whole run."""
        return 0

    @property
    def corners(self) -> tuple[float, ...]:
        """Frequencies at which `density` has a corner or a jump (Hz)."""
        return ()

    def density(self, frequencies: np.ndarray) -> np.ndarray | None:
        """One-sided density of the base's acceleration, without `lines`; None if unknown.

        At frequencies (Hz) of any shape, in (m/s²)²/Hz; in a scaled scene the density of η.
        """
        return None

    def measured_density(self, stretch: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Frequencies (Hz) and density of a measured path; None for other paths.

        The density is averaged over segments of length `stretch` (s), and known up to a factor.
        """
        return None

    @property
    def highest_frequency(self) -> float:
        """Highest frequency in a measured path (Hz); infinite for other excitations."""
        return math.inf

    @property
    def prescribes_displacement(self) -> bool:
        """Whether the displacement is prescribed, so that forces have no effect."""
        return False

    def check(self, units: str, run: Run, origin: str) -> None:
        """Raise for values that are valid alone but not together, or not with this run.

        `run.duration` is None if the excitation determines it. `origin` is the file's or the
        scene's name, for the message of the SceneError.
        """

    def _check_unit(self, units: str, origin: str, required: bool = False) -> None:
        """Raise if the `unit` of samples or densities is not allowed with a scene's `units`."""
        unit = getattr(self, "unit", None)
        if (unit == SCALED) == (units == SCALED) and (unit or not required):
            return
        words = (w for w in self.KEYS["unit"].words if (w == SCALED) == (units == SCALED))
        stated = f' = "{unit}"' if unit else " is missing"
        raise SceneError(
            f'{origin}: excitation.unit{stated}: a scene with units = "{units}" takes one of '
            + ", ".join(f'"{word}"' for word in words)
        )

    def _check_knot_spacing(self, longest: float, words: str, origin: str) -> None:
        """Raise if `knot_spacing` exceeds `longest` (s); `words` explain the limit."""
        spacing = getattr(self, "knot_spacing", None)
        if spacing is not None and spacing > longest:
            raise SceneError(
                f"{origin}: excitation.knot_spacing = {spacing:g}: must be a number in "
                f"(0, {longest:g}], {words}"
            )

    @abstractmethod
    def spacing(self, longest: float) -> float:
        """Spacing of the knots (s).

        `longest` is the longest spacing that resolves the device's motion (s); infinite if it has
        no natural frequency.
        """

    @abstractmethod
    def equivalent_noise(self, relaxation_time: float, longest: float) -> tuple[float, float]:
        """(D, τ1) of Ornstein–Uhlenbeck noise of about the same effect.

        It determines step sizes; averaging uses it if `averaging_refusal` is empty. The arguments
        are the device's relaxation time and the longest spacing that resolves its motion (s).
        """

    @abstractmethod
    def path(self, spacing: float, length: float, seed: Any) -> ExcitationPath:
        """The path of one realization: the same seed gives the same bytes.

        Parameters
        ----------
        spacing : float
            Time between knots (s).
        length : float
            The divisor that turns accelerations into η: the length unit (1 in scaled scenes) over
            `oscillator.base_factor`.
        seed : numpy.random.SeedSequence
            Seed of this realization.
        """

    @abstractmethod
    def notes(self, spacing: float, angular_frequency: float, run: Run) -> tuple[str, ...]:
        """Notes for the result: caveats of the excitation."""

    def averaging_refusal(self) -> str:
        """Reason why stochastic averaging does not apply; empty if it does."""
        return "averaging assumes stationary noise with a smooth spectrum: simulate"
