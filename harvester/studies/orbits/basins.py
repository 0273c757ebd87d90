"""`basins`: the steady motion that a driven device reaches from each start on a grid."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.arguments import real_numbers
from harvester.base.errors import HarvesterError
from harvester.base.formatting import NOT_KNOWN, Printed, quantity, share_with_error
from harvester.base.plain_text import json_text, shown
from harvester.base.tables import require_xarray
from harvester.results.orbit import REASONS
from harvester.results.panels import set_title
from harvester.results.result import unit_of
from harvester.results.view import Picture, ResultBase, View
from harvester.scene.model import Scene
from harvester.scene.prepared import Prepared
from harvester.scene.starts import energy_range
from harvester.statistics.attractors import QUANTITIES
from harvester.statistics.estimate import Estimate
from harvester.studies.orbits.following import Orbit

if TYPE_CHECKING:
    from xarray import Dataset

# Maximum number of starts along one side of the grid; its square is the maximum of `run.starts`.
MOST_POINTS = 1000
# Maximum number of orbits named in a figure.
MOST_NAMED = 10
COLOURS = (
    "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#F0E442", "#999933",
    "#8C564B", "#882255",
)  # fmt: skip
NOT_FOLLOWED = "0.9"
# Orbits whose powers differ by less than this share, such as mirror images, count as equal.
ALIKE_POWER = 0.01


@dataclass(frozen=True, repr=False)
class Basins(ResultBase):
    """The steady motions of a driven device and their basins of attraction, in the scene's units.

    Attributes
    ----------
    displacements, velocities : ndarray, shapes (n,), (m,)
        Coordinates of the starts. The transducer's state is 0; the load's capacitors and coils have
        the initial values of its netlist.
    orbit : ndarray of int, shape (m, n)
        Index in `orbits` of the orbit reached from each start; −1 if it was not followed.
    orbits
        The orbits, the one with the most starts first.
    periods
        Minimum number of forcing periods for which each start was followed.
    """

    scene: Scene
    method: str
    engine_version: str
    displacements: np.ndarray
    velocities: np.ndarray
    orbit: np.ndarray
    orbits: list[Orbit]
    periods: int
    seconds: float

    def unit(self, dimension: str) -> str:
        """Unit of a dimension in this scene."""
        return unit_of(self.scene, dimension)

    def view(self) -> View:
        """Table, findings and pictures."""
        return View(
            self._table(),
            self._findings(),
            headline="; ".join(orbit_sentences(self.orbits, self.unit)[:2]),
            pictures=[Picture(_draw, self)],
            records=self._records,
            dataset=self._dataset,
        )

    def _table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows as text: one row per orbit."""
        header = ["orbit", "motion", "share of starts", "mean power", "rms voltage"]
        header += ["rms displacement", "displacement at the period's beginning"]
        header += ["largest Lyapunov exponent [1/s]"]
        return header, [
            [
                orbit.name,
                orbit.kind,
                share_with_error(Estimate(orbit.share, orbit.share_error, None, "1"), sign=False),
                *(orbit.text(name, self.unit(dimension)) for name, dimension in QUANTITIES.items()),
                _section(orbit, self.unit("displacement")),
                NOT_KNOWN
                if orbit.lyapunov is None
                else Printed(
                    str(orbit.lyapunov), orbit.lyapunov.exponent, orbit.lyapunov.standard_error
                ),
            ]
            for orbit in self.orbits
        ]

    def _records(self) -> tuple[list[str], list[list[Any]]]:
        """Header and rows: each start and the orbit that it reaches."""
        header = [
            f"displacement [{self.unit('displacement')}]",
            f"velocity [{self.unit('velocity')}]",
            "orbit",
        ]
        names = [*(orbit.name for orbit in self.orbits), ""]
        rows = [
            [float(x), float(v), names[number]]
            for v, row in zip(self.velocities, self.orbit, strict=True)
            for x, number in zip(self.displacements, row, strict=True)
        ]
        return header, rows

    def _findings(self) -> list[str]:
        """Sentences on the findings, one line each."""
        count = int((self.orbit >= 0).sum())
        starts = "1 start" if count == 1 else f"{count} starts"
        lines = [
            f"{self.method}: {self.engine_version}; {starts}, each followed for at least "
            f"{self.periods} periods of the excitation; {self.seconds:.2f} s",
            f"plane of the starts: {self._axis('displacement', self.displacements)}, "
            f"{self._axis('velocity', self.velocities)}, with an "
            "uncharged transducer at the beginning of a period of the excitation; `displacement` "
            "and `velocity` change the grid",
            *orbit_sentences(self.orbits, self.unit),
            "shares count the starts on this grid, and depend on its region",
        ]
        unfollowed = self.orbit.size - count
        if unfollowed:
            lines.append(f"{unfollowed} starts were not followed: the time budget was spent")
        return lines

    def _axis(self, name, values):
        unit = self.unit(name)
        if values.size == 1:
            return f"{name} {quantity(values[0], unit)}"
        ends = f"{quantity(values[0], unit)} to {quantity(values[-1], unit)}"
        return f"{values.size} values of the {name} from {ends}"

    def _dataset(self) -> Dataset:
        """Index of the orbit over velocity and displacement."""
        attributes = {"scene": json_text(self.scene.to_dict()), "method": self.method}
        return require_xarray().Dataset(
            {"orbit": (("velocity", "displacement"), self.orbit)},
            {"displacement": self.displacements, "velocity": self.velocities},
            attributes,
        )


def _section(orbit, unit):
    """Text on the range of the section's displacements, which distinguishes mirror images."""
    if not orbit.steady or not orbit.points.size:
        return NOT_KNOWN
    displacements = orbit.points[:, 0]
    ends = float(displacements.min()), float(displacements.max())
    texts = dict.fromkeys(quantity(end, unit, 3) for end in ends)
    return Printed(" … ".join(texts), unit=unit, ends=ends)


def orbit_sentences(orbits: Sequence[Orbit], unit: Any) -> list[str]:
    """Sentences on the number of motions, and the share of the motion with the largest power."""
    if not orbits:
        return []
    steady = [orbit for orbit in orbits if orbit.steady]
    kinds = Counter(orbit.kind for orbit in steady)
    named = ", ".join(f"{count} of {kind}" if count > 1 else kind for kind, count in kinds.items())
    plural = "" if len(steady) == 1 else "s"
    lines = [f"{len(steady) or 'no'} steady motion{plural}{': ' if named else ''}{named}"]
    if steady:
        best = max(steady, key=lambda orbit: orbit.mean_power)
        least = min(steady, key=lambda orbit: orbit.mean_power)
        lines.append(
            f"largest power on orbit {best.name}, {best.text('mean_power', unit('power'))}: "
            f"{best.share:.1%} ± {best.share_error:.1%} of the starts reach it"
        )
        if 0.0 < least.mean_power < (1.0 - ALIKE_POWER) * best.mean_power:
            times = best.mean_power / least.mean_power
            lines[-1] += f"; {times:.3g} times the power of orbit {least.name}"
        lines.append(
            "a motion with a period is averaged over whole cycles once it has converged: its "
            "errors cover the remaining transient and the possible step error"
        )
    for orbit in orbits:
        if not orbit.steady:
            plural = "" if orbit.starts == 1 else "s"
            lines.append(f"{orbit.starts} start{plural}: {orbit.kind}, {REASONS[orbit.kind]}")
    return lines


def axes_of_starts(
    driven: Prepared,
    displacement: Sequence[float] | None,
    velocity: Sequence[float] | None,
    points: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Displacements and velocities of the grid, in the scene's units."""
    span = energy_range(driven)
    if points > MOST_POINTS:
        raise HarvesterError(f"--points {points}: must be at most {MOST_POINTS} starts per side")
    default = {"displacement": (span.low, span.high), "velocity": (-span.speed, span.speed)}
    axes = []
    for name, coordinates in (("displacement", displacement), ("velocity", velocity)):
        if coordinates is None:
            low, high = (end * driven.scales.of(name) for end in default[name])
            axes.append(np.linspace(low, high, points))
            continue
        values = np.array(real_numbers(coordinates, f"--{name}", "[-0.01, 0.0, 0.01]"))
        if not (np.diff(values) > 0.0).all():
            raise HarvesterError(
                f"--{name} {shown(coordinates)}: must be ascending numbers, such as "
                "numpy.linspace(-0.01, 0.01, 41) in Python and -0.01:0.01:41 on the command line"
            )
        axes.append(values)
    return axes[0], axes[1]


def _draw(basins):
    """Draw the plane of the starts in the colours of the orbits."""
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.figure import Figure

    # All orbits from the tenth on have the last colour.
    colour_index = np.minimum(basins.orbit, MOST_NAMED - 1)
    colours = ListedColormap([NOT_FOLLOWED, *COLOURS])
    norm = BoundaryNorm(np.arange(-1.5, MOST_NAMED), colours.N)
    figure = Figure(figsize=(6.2, 4.2))
    axes = figure.add_subplot()
    axes.pcolormesh(
        basins.displacements, basins.velocities, colour_index, cmap=colours, norm=norm,
        shading="nearest", rasterized=True,
    )  # fmt: skip
    low_x, high_x = axes.get_xlim()
    low_y, high_y = axes.get_ylim()
    for number, orbit in enumerate(basins.orbits[:MOST_NAMED]):
        power = quantity(orbit.mean_power, basins.unit("power"), 3) if orbit.steady else ""
        label = f"{orbit.name}, {orbit.kind}: {orbit.share:.1%}, {power}"
        size = 6.0 if orbit.period else 1.5
        axes.plot(
            *orbit.points.T, "o", color=COLOURS[number], markersize=size, label=label,
            markeredgecolor="black", markeredgewidth=0.6 if orbit.period else 0.15,
        )  # fmt: skip
    axes.set_xlim(low_x, high_x)
    axes.set_ylim(low_y, high_y)
    axes.set_xlabel(f"displacement at the start [{basins.unit('displacement')}]")
    axes.set_ylabel(f"velocity at the start [{basins.unit('velocity')}]")
    legend: Any = figure.legend(loc="outside lower center", ncols=2, fontsize=6)
    for handle in legend.legend_handles:
        # The markers of a chaotic motion are too small for a legend.
        handle.set(markersize=6.0, markeredgewidth=0.6)
    set_title(figure, f"{basins.scene.name}: basins (dots: the orbits, at the period's beginning)")
    return figure
