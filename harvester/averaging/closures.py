"""Stationary means by three methods: two average over orbits, one does not."""

import pkgutil
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, NamedTuple

from harvester.averaging.averages import Averages
from harvester.averaging.method import DEFAULT_CLOSURE
from harvester.base.errors import AveragingError
from harvester.base.plain_text import nearest
from harvester.base.registry import Registry
from harvester.device.system import System


class StationaryMethod(NamedTuple):
    """A stationary method, which computes means without simulation.

    Attributes
    ----------
    average : callable
        Function of a device, a tolerance and whether to compute the memory between wells; returns
        `Averages`. With `of_spectrum`: function of the prepared scene and a tolerance.
    tolerance : float
        Default of the largest accepted relative numerical error.
    of_spectrum : bool
        Whether the excitation may have any spectrum (argument: the prepared scene), instead of the
        noise of Eq. 6 only.
    jump_rates : bool
        Whether the method can compute the rates of jumps between wells.
    """

    average: Callable
    tolerance: float
    of_spectrum: bool = False
    jump_rates: bool = False


def notes_on_errors(methods: Iterable[str]) -> list[str]:
    """Note on the meaning of ± for stationary methods; empty if none of these methods is one."""
    names = [name for name in dict.fromkeys(methods) if name.partition(" (")[0] in CLOSURES]
    meaning = "± is the numerical error alone, without the error of the approximation"
    return [f"{', '.join(names)}: {meaning}"] if names else []


def average(
    device: System,
    closure: str = DEFAULT_CLOSURE,
    tolerance: float | None = None,
    memory: bool = False,
) -> Averages:
    """Means and densities of a device by stochastic averaging, or by the Fokker–Planck equation.

    Parameters
    ----------
    device : harvester.device.system.System
    closure : {"paper", "consistent", "fokker_planck"}
    tolerance : float, optional
        Largest accepted relative numerical error; by default the method's own. `fokker_planck`
        refines its grid until it is met.
    memory : bool
        For `fokker_planck`: also find the slowest decay rate between wells.

    Raises
    ------
    AveragingError
        Unknown method; unconfined or undamped motion; means that the grid does not resolve. For
        `paper` and `consistent` also: a device unlike the source paper's, a noise correlation time
        above the relaxation time (contacts included), β ≥ ω0² of a bistable device.

    Notes
    -----
    `paper` is Eqs. 10–37 with κ in Eq. 15, the stoppers' spring opposed on either side and 2T in
    Eq. 26 below the barrier. `consistent` keeps the force −N2 X* of Eq. 11 in the potential, takes
    V about each well's rest position, and lets g = p/T obey d ln g/dH = −B/(πSJ), the flux form,
    where Eqs. 21, 22 and 25 have a further 1/S(ω) in g: the drift πS(ω) lacks dS/dH. The page
    docs/explanation/theory.md compares these choices.

    `consistent` is for motion inside a well: it neglects the slow part of V after a jump. Noise and
    contact must be weak per period; on a preloaded stopper (gap 0.95, D = 0.01) it is 11 % low. The
    densities of `paper` have a step at the separatrix. In `consistent` wells and outer orbits
    overlap in the phase plane, and the densities have a step at the end of each.
    """
    if closure not in CLOSURES:
        names = ", ".join(CLOSURES)
        hint = nearest(closure, CLOSURES) or ", and engines are for `simulate`"
        raise AveragingError(f"{closure}: no such method{hint}; use {names}")
    chosen = CLOSURES[closure]
    if chosen.of_spectrum:
        raise AveragingError(f"{closure}: takes a scene: harvester.average(scene, method=…)")
    return chosen.average(device, chosen.tolerance if tolerance is None else tolerance, memory)


def _by(function: str, *arguments: Any) -> Averages:
    """Call a function of `harvester.averaging`, whose module is imported at the first call."""
    averaged: Averages = pkgutil.resolve_name(f"harvester.averaging.{function}")(*arguments)
    return averaged


CLOSURES: Registry[StationaryMethod] = Registry(
    "harvester.closures",
    {
        "paper": StationaryMethod(partial(_by, "over_orbits:over_orbits", "paper"), 1e-3),
        "consistent": StationaryMethod(partial(_by, "over_orbits:over_orbits", "consistent"), 1e-3),
        "fokker_planck": StationaryMethod(
            partial(_by, "fokker_planck:fokker_planck"), 1e-2, jump_rates=True
        ),
        "spectral": StationaryMethod(partial(_by, "spectral:spectral"), 1e-6, of_spectrum=True),
    },
)
# Stationary methods that support the noise of Eq. 6, also for nonlinear devices.
NOISE_CLOSURES = tuple(name for name, closure in CLOSURES.items() if not closure.of_spectrum)
