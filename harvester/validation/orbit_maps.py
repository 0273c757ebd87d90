"""The paper's Figs. 2 and 3: orbits of the unperturbed system of Eq. 13, without noise.

Fig. 2 shows the energy H (Eqs. 14 and 15) and the frequency ω(H) (Eqs. 16 and 17) over displacement
and velocity. Fig. 3 shows the extremes of the voltage of Eq. 10 along each orbit over the orbit's
frequency, with and without stoppers. The paper does not give energies or axes; here the orbits end
at `HIGHEST`. Symbols in Fig. 3 are the periodic solution of Eq. 4b along the same orbits, which Eq.
10 approximates by one harmonic.
"""

import time
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from scipy.integrate import solve_ivp

from harvester.averaging.density import Layer
from harvester.averaging.orbits import edges as edges_of
from harvester.averaging.orbits import settled_orbits
from harvester.base.serialising import key
from harvester.results.panels import Panel, Series, draw_panels, set_title
from harvester.results.view import Picture, ResultBase, View
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.validation.paper_drawing import COLOURS

# Energy of the outermost orbit above U(0), scaled; it corresponds to speeds up to 2.8.
HIGHEST = 4.0
LEVELS, NODES = 200, 24
GRID = 121
# Size of the drawn rectangle relative to that within the outermost orbit.
MARGIN = 0.995
# Number of orbits per edge along which Eq. 4b is solved, and of points per orbit.
CHECKED, POINTS = 5, 512
# In Fig. 2 the frequency falls to 0 at the separatrix; below this value (rad/s) the dip is narrower
# than the grid.
TRENCH = 1.0


class _PaperMap(ResultBase):
    """Base class of both figures.

    Attributes
    ----------
    name, computed : str
        The figure and its content.
    """

    name: ClassVar[str]
    computed: ClassVar[str]

    highest = HIGHEST
    IN_JSON: ClassVar = {
        "figure": "name",
        "highest_energy_above_barrier": "highest",
        "computed": "computed",
    }


@dataclass(frozen=True, repr=False)
class Surfaces(_PaperMap):
    """Fig. 2: arrays over a grid of displacements (columns) and velocities (rows), scaled."""

    scene: Scene
    displacement: np.ndarray
    velocity: np.ndarray
    energy: np.ndarray
    frequency: np.ndarray = field(metadata=key("angular_frequency"))
    wall_seconds: float

    name = "fig2"
    computed = "H and ω(H) of Eqs. 14-17 over X and X', N2(H) solved for on each orbit"

    def view(self) -> View:
        """Table, findings and pictures."""
        return View(self._table(), self._findings(), pictures=[Picture(_draw_surfaces, self)])

    def _table(self) -> tuple[list[str], list[list[str]]]:
        fastest, highest = np.nanmax(self.frequency), np.nanmax(self.energy)
        return ["figure", "what", "greatest"], [
            [self.name, "H", f"{highest:.3g}"],
            [self.name, "ω", f"{fastest:.3g} rad/s"],
        ]

    def _findings(self) -> list[str]:
        return [f"{self.name}: orbits of Eq. 13 up to H − U(0) = {HIGHEST:g}; no noise enters"]


@dataclass(frozen=True)
class EdgeVoltages:
    """Voltages along the orbits of one edge in Fig. 3: arrays over orbits.

    `lowest` and `highest` are the voltage's extremes by Eq. 10; `checked` contains rows (ω, lowest,
    highest) by Eq. 4b.
    """

    frequency: np.ndarray = field(metadata=key("angular_frequency"))
    lowest: np.ndarray = field(metadata=key("lowest_voltage"))
    highest: np.ndarray = field(metadata=key("highest_voltage"))
    checked: np.ndarray

    def worst(self) -> list[float]:
        """Largest deviations of Eq. 10 from Eq. 4b: swing, and centre in units of the swing."""
        order = np.argsort(self.frequency)
        low, high = (
            np.interp(self.checked[:, 0], self.frequency[order], column[order])
            for column in (self.lowest, self.highest)
        )
        exact = self.checked[:, 2] - self.checked[:, 1]
        middle = 0.5 * (low + high - self.checked[:, 1] - self.checked[:, 2])
        shares = ((high - low) / exact - 1.0, middle / exact)
        return [float(share[np.argmax(np.abs(share))]) for share in shares]


@dataclass(frozen=True, repr=False)
class OrbitVoltages(_PaperMap):
    """Fig. 3: {"with stoppers": {"wells": EdgeVoltages, "outer": EdgeVoltages}, "without": …}."""

    scene: Scene
    responses: dict[str, dict[str, EdgeVoltages]] = field(metadata=key("devices"))
    wall_seconds: float

    name = "fig3"
    computed = (
        "extremes of the voltage (Eq. 10) along each orbit of Eq. 13 over its "
        "frequency, with stoppers and with K = 0; checked: Eq. 4b solved along the orbit"
    )

    def view(self) -> View:
        """Table, findings and pictures."""
        return View(self._table(), self._findings(), pictures=[Picture(_draw_orbit_voltages, self)])

    def _table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows: the frequency range of each kind of orbit."""
        header = ["figure", "device", "orbits", "lowest ω", "highest ω", "greatest |V|"]
        header += ["Eq. 10 against Eq. 4b: swing", "middle, in swings"]
        rows = []
        for device, edges in self.responses.items():
            for edge, r in edges.items():
                reach = np.maximum(-r.lowest, r.highest)
                values = r.frequency.min(), r.frequency.max(), reach.max()
                rows.append([self.name, device, edge, *(f"{value:.3g}" for value in values)])
                rows[-1] += [f"{worst:+.1%}" for worst in r.worst()]
        return header, rows

    def _findings(self) -> list[str]:
        return [
            f"{self.name}: extremes of V (Eq. 10) along the orbits of Eq. 13 up to H − U(0) = "
            f"{HIGHEST:g}; symbols: Eq. 4b itself along the same orbits; no noise enters",
            f"{self.name}: Eq. 10 measures V from the well's bottom, Eq. 4b from the orbit's mean "
            "position (a periodic V has no mean), so the middles differ inside the wells",
        ]


def surfaces(scene: Scene) -> Surfaces:
    """Fig. 2 of a bistable scene."""
    clock = time.perf_counter()
    wells, outer = _families(scene)
    # The corners of the rectangle are on the outermost orbit, with equal potential and kinetic
    # energy.
    speed = MARGIN * np.sqrt(outer.height[-1])
    reach = MARGIN * np.interp(0.5 * outer.height[-1], outer.height, outer.right)
    x, v = np.linspace(-reach, reach, GRID), np.linspace(-speed, speed, GRID)
    return Surfaces(
        scene=scene,
        displacement=x,
        velocity=v,
        energy=_over_plane(x, v, [(orbits, orbits.height) for orbits in (wells, outer)]),
        frequency=_over_plane(x, v, [(orbits, orbits.frequency) for orbits in (wells, outer)]),
        wall_seconds=time.perf_counter() - clock,
    )


def orbit_voltages(scene: Scene) -> OrbitVoltages:
    """Fig. 3 of a bistable scene with stoppers."""
    clock = time.perf_counter()
    devices = {"with stoppers": scene, "without": scene.replace(stoppers=None)}
    responses = {}
    for device, changed in devices.items():
        families = zip(("wells", "outer"), _families(changed), strict=True)
        responses[device] = {edge: _response(orbits) for edge, orbits in families}
    return OrbitVoltages(scene, responses, time.perf_counter() - clock)


def _families(scene):
    """Orbits in the wells and outer orbits, in the common potential of Eq. 15."""
    (wells, low, high), (outer, first, _) = edges_of(prepared(scene).system, "paper")
    return (
        settled_orbits(wells, np.linspace(low, high, LEVELS), NODES),
        settled_orbits(outer, np.linspace(first, np.log(HIGHEST), LEVELS), NODES),
    )


def _over_plane(x, v, families):
    """Map a quantity with one value per orbit to all points; nan outside the outermost orbit."""
    wells, outer = (
        Layer(orbits, np.log(values)).at(np.abs(x)[None, :], v[:, None])
        for orbits, values in families
    )
    values = np.where(wells > 0.0, wells, outer)
    return np.where(values > 0.0, values, np.nan)


def _response(orbits):
    """Voltages of Eq. 10 along the orbits of one edge."""
    edge, right = orbits.edge, orbits.right[:, None]
    start = orbits.left[:, None] if edge.inside else -right
    x = start + (right - start) * np.linspace(0.0, 1.0, POINTS)
    kinetic = orbits.energy[:, None] - edge.energy(x, orbits.added[:, None])
    speed = np.sqrt(2.0 * np.maximum(kinetic, 0.0))
    centre = edge.bottom(orbits.added) if edge.inside else np.zeros_like(orbits.added)
    slow = orbits.gain[:, None] * (x - centre[:, None])
    decay_rate = edge.system.transducer.decay_rate()
    fast = (decay_rate * orbits.gain / orbits.frequency**2)[:, None] * speed
    chosen = np.linspace(0, len(orbits.level) - 1, CHECKED + 2).astype(int)[1:-1]
    return EdgeVoltages(
        frequency=orbits.frequency,
        lowest=(slow - fast).min(axis=1),
        highest=(slow + fast).max(axis=1),
        checked=np.array([_solved(orbits, k) for k in chosen]),
    )


def _solved(orbits, k):
    """(ω, lowest, highest V) of Eq. 4b along one orbit, harmonic by harmonic."""
    edge, frequency, added = orbits.edge, orbits.frequency[k], orbits.added[k]
    period = 2.0 * np.pi / frequency
    path = solve_ivp(
        lambda _, state: [state[1], -edge.slope(state[0], added)],
        (0.0, period), [orbits.right[k], 0.0],
        t_eval=period * np.arange(POINTS) / POINTS, rtol=1e-9, atol=1e-10,
    )  # fmt: skip
    # V_n = iω_n X_n/(λ + iω_n).
    rates = 2j * np.pi * np.fft.rfftfreq(POINTS, period / POINTS)
    shares = rates / (edge.system.transducer.decay_rate() + rates)
    voltage = np.fft.irfft(np.fft.rfft(path.y[0]) * shares, POINTS)
    return frequency, voltage.min(), voltage.max()


def _draw_surfaces(content):
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.2))
    set_title(figure, "Fig. 2: energy and frequency of the undisturbed system")
    x, v = np.meshgrid(content.displacement, content.velocity)
    panels = (
        (content.energy, "$H$", "(a)"),
        (np.maximum(content.frequency, TRENCH), r"$\omega$", f"(b) cut off below {TRENCH:g} rad/s"),
    )
    for number, (surface, label, title) in enumerate(panels, 1):
        axes: Any = figure.add_subplot(1, 2, number, projection="3d")
        look = {"cmap": "viridis", "linewidth": 0, "antialiased": False}
        axes.plot_surface(x, v, surface, rcount=GRID, ccount=GRID, **look)
        axes.set(title=title, xlabel="$X$", ylabel=r"$\dot X$", zlabel=label)
        axes.set_box_aspect((1.0, 1.0, 0.75), zoom=0.9)
    return figure


def _draw_orbit_voltages(content):
    (stoppers,) = content.scene.stoppers
    looks = {
        "without": ("black", "--", "s", "without impact, $K = 0$"),
        "with stoppers": (COLOURS[1], "-", "o", f"with impact, $K = {stoppers.stiffness:g}$"),
    }
    series = []
    for device, (colour, line, mark, label) in looks.items():
        for response in content.responses[device].values():
            frequency = np.concatenate([response.frequency, response.frequency[::-1]])
            outline = np.concatenate([response.highest, response.lowest[::-1]])
            series.append(Series(frequency, outline, label, colour, line))
            checked, hollow = response.checked.T, np.full(len(response.checked), True)
            for voltage in checked[1:]:
                points = Series(checked[0], voltage, None, colour, "", mark, hollow=hollow)
                series.append(points)
    title = (
        "Fig. 3: voltage over frequency with and without impact\n"
        "lines: Eq. 10 along each orbit; symbols: Eq. 4b itself, whose V has no mean:\n"
        "inside a well Eq. 10 measures it from the well's bottom"
    )
    return draw_panels([Panel(r"$\omega$ [rad/s]", "$V$", series)], title, size=(6.0, 3.6))
