"""`harvester.coupled`: a device for co-simulation with electronics in another program.

It calls the same compiled code as an importer of the FMU.
"""

from __future__ import annotations

import ctypes
import functools
import math
import weakref
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from harvester.base.errors import HarvesterError, SimulationError, SpringRangeLeft
from harvester.base.temporary import TemporaryFolder
from harvester.interop.compiling import LIBRARY, compile_library
from harvester.scene.calling import takes_scene

if TYPE_CHECKING:
    from harvester.scene.model import Scene

# Number of excitation knots read at a time.
KNOTS = 4096
# Numbers of these variables in `sources/fmi.h`.
TERMINAL, START_STATE = 2, 6


class Energies(NamedTuple):
    """Energies since the beginning (J); `input` is the sum of all other energies.

    Attributes
    ----------
    input
        From the base.
    stored
        Increase in mass, spring, contacts and transducer.
    damper, contacts, transducer
        Losses in these parts.
    delivered
        Out of the terminals.
    """

    input: float
    stored: float
    damper: float
    contacts: float
    transducer: float
    delivered: float


@takes_scene
def coupled(scene: Scene, *, realization: int = 0, load_resistance: float = 0.0) -> Coupled:
    """A scene's device, stepped by the caller, under the scene's excitation.

    The caller of `advance` is the load; the scene's load is ignored.

    Parameters
    ----------
    scene : Scene, str or Path
        A scene in SI units.
    realization : int
        Number of the realization that defines excitation and start.
    load_resistance : float
        Resistor across a piezo, or in series with a coil (Ω); 0: none.

    Returns
    -------
    Coupled

    Raises
    ------
    ExportError
        The scene cannot be exported, see `harvester export --as c`.
    ProgramNotFound
        There is no C compiler.

    Examples
    --------
    A resistor of 100 kΩ, with exchanges every millisecond::

        device = harvester.coupled("paper_si")
        while device.time < 10.0:
            device.advance(device.time + 1e-3, device.voltage / 100e3)
    """
    if not 0.0 <= load_resistance < math.inf:
        raise HarvesterError(f"load_resistance = {load_resistance:g}: must be a number of ohms ≥ 0")
    return Coupled(scene, realization, load_resistance)


class Coupled:
    """A piezo whose input is the terminal current, or a coil whose input is the terminal voltage.

    Parameters
    ----------
    scene : harvester.scene.model.Scene
    realization : int
    load_resistance : float
        See `coupled`.

    Attributes
    ----------
    time : float
        Present simulated time (s).
    """

    def __init__(self, scene: Scene, realization: int, load_resistance: float) -> None:
        from harvester.interop.deck import check_realization
        from harvester.interop.fmu import unit_files, variables
        from harvester.scene.paths import noise_path, start_state
        from harvester.scene.prepared import prepared

        check_realization(scene, realization)
        setup = prepared(scene)
        token, files = unit_files(setup, 2)
        self._library, self._folder = _library(tuple(files.items()))
        listed = variables(setup)
        self._places = {variable.name: index for index, variable in enumerate(listed)}
        self._terminal = listed[TERMINAL].name
        self._name, self._range = scene.name, setup.system.spring.range
        self._length = setup.setting.length
        self._path, self._unit = noise_path(setup, realization), -setup.excitation_unit
        self._first, self._knots = 0, self._unit * self._path.read(KNOTS)
        calls = self._library
        self._device = calls.fmi2Instantiate(b"device", 1, token.encode(), b"", None, 0, 0)
        weakref.finalize(self, calls.fmi2FreeInstance, self._device)
        self.time = 0.0
        x, v, state = start_state(setup, realization)
        state *= scene.transducer.state_unit(setup.setting)
        self._set("start_displacement", x * self._length)
        self._set("start_velocity", v * self._length)
        self._set(listed[START_STATE].name, state)
        self._set("load_resistance", load_resistance)
        self._set("base_acceleration", self._knots[0])

    def advance(self, time: float, terminal: float = 0.0) -> float:
        """Advance to a time, with constant current or voltage at the terminals.

        Parameters
        ----------
        time : float
            s, not before `self.time`.
        terminal : float
            Current (A) drawn out of a piezo; voltage (V) across a coil.

        Returns
        -------
        float
            Voltage of the piezo at that time (V), or the coil's current (A).

        Raises
        ------
        HarvesterError
            The time is before `self.time`, or a value is not finite.
        SpringRangeLeft
        SimulationError
        """
        if not (time >= self.time and math.isfinite(time) and math.isfinite(terminal)):
            raise HarvesterError(
                f"{self._name}: advance({time:g}, {terminal:g}): give a time ≥ {self.time:g} s "
                "and a finite value"
            )
        self._set(self._terminal, terminal)
        while self.time < time:
            begin, slope, knot = self._segment()
            end = min(time, knot)
            self._set("base_acceleration", begin)
            order, value = (ctypes.c_int * 1)(1), (ctypes.c_double * 1)(slope)
            reference = self._reference_of("base_acceleration")
            self._library.fmi2SetRealInputDerivatives(self._device, reference, 1, order, value)
            failed = self._library.fmi2DoStep(self._device, self.time, end - self.time, 1)
            self.time = end
            if failed:
                self._fail()
        return self._get("voltage" if self._terminal == "current" else "current")

    @property
    def displacement(self) -> float:
        """Displacement of the mass relative to the base (m)."""
        return self._get("displacement")

    @property
    def velocity(self) -> float:
        """Velocity of the mass relative to the base (m/s)."""
        return self._get("velocity")

    @property
    def voltage(self) -> float:
        """Voltage across the terminals (V)."""
        return self._get("voltage")

    @property
    def current(self) -> float:
        """Current out of the positive terminal (A)."""
        return self._get("current")

    @property
    def base_acceleration(self) -> float:
        """Acceleration of the base (m/s²) from the scene's excitation."""
        return self._get("base_acceleration")

    @property
    def energies(self) -> Energies:
        """Input, lost and stored energies since the beginning (J)."""
        return Energies(*(self._get(f"energy_{name}") for name in Energies._fields))

    def _segment(self) -> tuple[float, float, float]:
        """Present base acceleration, its slope, and the time of the next knot."""
        spacing = self._path.spacing
        # A knot that is ahead only by a rounding error counts as passed.
        knot = math.floor(self.time / spacing + 1e-9)
        while knot + 1 >= self._first + self._knots.size:
            self._first += self._knots.size - 1
            samples = self._unit * self._path.read(KNOTS)
            self._knots = np.concatenate([self._knots[-1:], samples])
        before, after = (float(knot_value) for knot_value in self._knots[knot - self._first :][:2])
        slope = (after - before) / spacing
        return before + slope * (self.time - knot * spacing), slope, (knot + 1) * spacing

    def _reference_of(self, name: str) -> ctypes.Array:
        return (ctypes.c_uint * 1)(self._places[name])

    def _set(self, name: str, value: float) -> None:
        content = (ctypes.c_double * 1)(value)
        self._library.fmi2SetReal(self._device, self._reference_of(name), 1, content)

    def _get(self, name: str) -> float:
        value = (ctypes.c_double * 1)()
        self._library.fmi2GetReal(self._device, self._reference_of(name), 1, value)
        return value[0]

    def _fail(self) -> None:
        low, high = (end * self._length for end in self._range)
        if not low <= self.displacement <= high:
            raise SpringRangeLeft(
                f"{self._name}: at {self.time:g} s the displacement of {self.displacement:g} m is "
                f"outside the spring's range, {low:g} to {high:g} m"
            )
        raise SimulationError(
            f"{self._name}: before {self.time:g} s the device's step became too short: exchange "
            "with the electronics more often, or put part of them into load_resistance"
        )


@functools.lru_cache(maxsize=8)
def _library(files: tuple[tuple[str, str], ...]) -> tuple[ctypes.CDLL, TemporaryFolder]:
    """The compiled device, and its folder, which exists as long as it is used."""
    folder = TemporaryFolder()
    path = Path(folder.name) / f"device{LIBRARY}"
    compile_library(dict(files), path)
    library = ctypes.CDLL(str(path))
    text, number, pointer = ctypes.c_char_p, ctypes.c_double, ctypes.c_void_p
    integer, size = ctypes.c_int, ctypes.c_size_t
    library.fmi2Instantiate.restype = pointer
    library.fmi2Instantiate.argtypes = [text, integer, text, text, pointer, integer, integer]
    library.fmi2DoStep.argtypes = [pointer, number, number, integer]
    library.fmi2FreeInstance.argtypes = [pointer]
    for call in (library.fmi2SetReal, library.fmi2GetReal):
        call.argtypes = [pointer, pointer, size, pointer]
    library.fmi2SetRealInputDerivatives.argtypes = [pointer, pointer, size, pointer, pointer]
    return library, folder
