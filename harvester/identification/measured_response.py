"""Measured frequency responses: voltage over base acceleration, sine by sine."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from types import NoneType
from typing import Any, Self

import numpy as np

from harvester.base.errors import IdentificationError, SceneError

# Fewest frequencies in a response. One line in three is kept aside.
FEWEST_FREQUENCIES, KEPT_ASIDE = 12, 3
# A response is conjugated if it turns by more than this share of all its turning, lines weighted by
# their squares, towards larger phases: a device's turns the other way, noise either way.
RISING = 0.5


@dataclass(frozen=True)
class MeasuredResponse:
    """Voltage over base acceleration at some frequencies, in SI units or a scaled scene's.

    Attributes
    ----------
    frequency : ndarray, shape (n,)
        Hz; a descending sweep is turned round.
    response : ndarray, shape (n,)
        V/(m/s²): complex, or the amplitude alone.
    acceleration : ndarray of shape (n,), or None
        Amplitude of the base's sine (m/s²): the response then may depend on it.
    changes : dict of str to number or text
        Values of the scene that differ in this record: {"load.resistance": 1e5}.
    name : str
    sensors : dict of str to float
        Known effects of sensors: {"sensor.acceleration_highpass": 0.5}.
    """

    frequency: np.ndarray
    response: np.ndarray
    acceleration: np.ndarray | None = None
    changes: dict[str, Any] = field(default_factory=dict)
    name: str = "response"
    sensors: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        arrays = {quantity: np.atleast_1d(values) * 1.0 for quantity, values in self._arrays()}
        shape = arrays["frequency"].shape
        if len(shape) != 1 or not shape[0]:
            raise SceneError(
                f"{self.name}: frequency has the shape {shape}: must be a list of numbers"
            )
        for quantity, values in arrays.items():
            if values.shape != shape:
                raise SceneError(
                    f"{self.name}: {quantity} has the shape {values.shape}: must be one number per "
                    f"line, as frequency with {shape}"
                )
            if not np.isfinite(values).all():
                raise SceneError(f"{self.name}: {quantity}: lines without a number: leave them out")
        descends = arrays["frequency"][0] > arrays["frequency"][-1]
        for quantity, values in arrays.items():
            object.__setattr__(self, quantity, values[::-1] if descends else values)
        for quantity in ("frequency", "acceleration"):
            least = np.inf if getattr(self, quantity) is None else getattr(self, quantity).min()
            if least <= 0.0:
                raise SceneError(
                    f"{self.name}: {quantity}: {least:.6g}: must be > 0: leave those lines out, or "
                    "check the column"
                )
        if np.diff(self.frequency).min(initial=np.inf) <= 0.0:
            raise SceneError(
                f"{self.name}: frequency must rise or fall from line to line: is it the right "
                "column? Of several sweeps keep one"
            )

    @property
    def outputs(self) -> dict[str, np.ndarray]:
        """Outputs that are compared with the model: real and imaginary part, or the amplitude."""
        if np.iscomplexobj(self.response):
            return {"real part": self.response.real, "imaginary part": self.response.imag}
        return {"amplitude": self.response}

    @property
    def sensed(self) -> dict[str, np.ndarray]:
        """Amplitudes of the sensors' outputs by name."""
        return {"voltage": np.abs(self.response)}

    @property
    def resonance(self) -> float:
        """Frequency of the greatest amplitude (Hz)."""
        return float(self.frequency[np.argmax(np.abs(self.response))])

    @property
    def aside(self) -> np.ndarray:
        """Mask of the lines that are kept aside."""
        return np.arange(self.frequency.size) % KEPT_ASIDE == 1

    def _arrays(self):
        """Names and values of all fields with a number for each frequency."""
        values = ((entry.name, getattr(self, entry.name)) for entry in fields(self))
        return [pair for pair in values if not isinstance(pair[1], (str, dict, NoneType))]

    def part(self, lines: np.ndarray) -> Self:
        """A selection of its frequencies."""
        return replace(self, **{quantity: values[lines] for quantity, values in self._arrays()})

    def check(self) -> None:
        """Refuse a response with too few frequencies, one side of the resonance, or conjugated.

        Raises
        ------
        IdentificationError
            Too few frequencies, none on one side of the resonance, or a phase that rises.
        """
        if self.frequency.size < FEWEST_FREQUENCIES:
            raise IdentificationError(
                f"{self.name}: too short: {self.frequency.size} frequencies, and "
                f"{FEWEST_FREQUENCIES} are the fewest"
            )
        if self.resonance in self.frequency[[0, -1]]:
            raise IdentificationError(
                f"{self.name}: no excitation in the band that matters: the response is greatest at "
                f"{self.resonance:.4g} Hz, where the record ends: measure on both sides of the "
                "resonance"
            )
        turn = np.imag(np.conj(self.response[:-1]) * self.response[1:])
        if turn.sum() > RISING * np.abs(turn).sum():
            raise IdentificationError(
                f"{self.name}: the phase rises through the resonance at {self.resonance:.4g} Hz, "
                "and a device's falls: the response is conjugated; reverse the sign of its phase, "
                "or of its imaginary part"
            )


def response_of(
    columns: dict[str, np.ndarray], changes: dict[str, Any], name: str, sensors: dict[str, float]
) -> MeasuredResponse:
    """A response from columns by their quantities, in the scene's units.

    Raises
    ------
    SceneError
        Neither an amplitude nor two parts are there.
    """
    phase = columns.get("phase")
    if "frequency" not in columns:
        raise SceneError(
            f"{name}: a column of complex numbers is a frequency response, and no column of "
            "frequencies is named: write frequency [Hz] in its header, or frequency=COLUMN:UNIT "
            "behind the file"
        )
    if "response" in columns:
        response = columns["response"]
        if not np.iscomplexobj(response):
            raise SceneError(
                f"{name}: the column of the response holds no complex numbers: name it by "
                "amplitude=COLUMN:UNIT, and its phase by phase=COLUMN:UNIT"
            )
    elif {"real", "imaginary"} <= set(columns):
        response = columns["real"] + 1j * columns["imaginary"]
    elif "amplitude" not in columns:
        raise SceneError(
            f"{name}: no column of the response: write amplitude [V/g] and phase [deg], or "
            "real [V/g] and imaginary [V/g] in its header, or amplitude=COLUMN:UNIT behind the file"
        )
    elif phase is None:
        response = columns["amplitude"]
    else:
        response = columns["amplitude"] * np.exp(1j * phase)
    return MeasuredResponse(
        columns["frequency"], response, columns.get("acceleration"), changes, name, sensors
    )
