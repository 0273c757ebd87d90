"""`explore`: sliders for a scene's values, and a picture updated within a second.

Values and waveform come from a short Monte Carlo run, densities from the stationary solver on a
coarse grid; both run in worker processes.
"""

from __future__ import annotations

import html
import importlib.util
import math
import time
import weakref
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from harvester.averaging.fokker_planck import outline
from harvester.averaging.of_scene import averaged_device
from harvester.base.arguments import listed
from harvester.base.errors import HarvesterError
from harvester.base.formatting import with_error
from harvester.base.plain_text import one_line, shown
from harvester.base.worker_pool import WorkerPool
from harvester.device import timescales
from harvester.engines.simulate import simulate
from harvester.results import figures
from harvester.results.drawing import axis_label, draw_density, frame
from harvester.results.palette import CIRCUIT, LINES, MONTE_CARLO
from harvester.results.result import Result
from harvester.scene.calling import takes_scene
from harvester.scene.model import Scene
from harvester.scene.numbers import number, numbers
from harvester.scene.prepared import Prepared, prepared
from harvester.scene.steps import knot_spacing, steps_per_sample
from harvester.statistics.estimate import Density

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Default sliders, if the scene has these keys.
USUAL_KEYS = (
    "intensity", "correlation_time", "damping", "gap", "coupling", "resistance", "decay_rate",
)  # fmt: skip
# Default range of a slider: the scene's value divided and multiplied by this.
RANGE_RATIO = 3.0
# A slider whose range exceeds this ratio is logarithmic.
LOGARITHMIC_RATIO = 3.0
# Monte Carlo's steps per picture, about a quarter of a second, and fewest realizations.
STEPS_SHOWN, FEWEST_REALIZATIONS = 1_000_000, 2
# Run time per step relative to a resistor: of a netlist, and of a switching load.
NETLIST_COST, SWITCHING_COST = 4, 20
# Length of the waveform in periods of small oscillations.
WAVEFORM_PERIODS = 25
# Wall-clock limit of one realization, in seconds; slower settings are rejected.
TIME_LIMIT = 60.0
# Margins of the picture.
MARGINS = {"left": 0.115, "right": 0.98, "bottom": 0.1, "top": 0.93, "hspace": 0.34}
# Steps of a slider.
SLIDER_STEPS = 100
# Opacity of a picture that does not match the sliders' present setting.
LOST = "0.35"
QUANTITIES = ("mean_power", "power_conversion_efficiency", "mean_output_power", "rms_voltage")


@dataclass(frozen=True)
class SliderSetting:
    """Results and densities at one setting of the sliders.

    Attributes
    ----------
    scene : Scene
        The scene with the sliders' values and a shortened run.
    result : Result
        The result of Monte Carlo.
    outline : dict of str to Density
        Densities by the stationary solver, on a coarse grid; empty if it is not valid.
    refusal : str
        Why the solver is not valid, in one line.
    seconds : float
        Wall time of the computation (s).
    """

    scene: Scene
    result: Result
    outline: dict[str, Density]
    refusal: str
    seconds: float

    def sentence(self) -> str:
        """Power, efficiency and rms voltage with their standard errors, in one line."""
        estimates = {name: self.result[name] for name in QUANTITIES if name in self.result}
        phrases = [
            f"{name.replace('_', ' ')} {with_error(estimate, self.result.unit(estimate.dimension))}"
            for name, estimate in estimates.items()
        ]
        return ", ".join(phrases)

    def figure(self) -> Figure:
        """Densities by both methods, above displacement and voltage over time."""
        return figures.drawn(_draw, self)


class Explorer:
    """The result of `explore`: sliders in a notebook, elsewhere one picture.

    Attributes
    ----------
    view : SliderSetting
        The view at the last valid setting.
    picture : bytes
        The picture of the view as PNG.
    """

    def __init__(self, scene: Scene, ranges: dict[str, tuple[float, float]]) -> None:
        self._origin, self.ranges = scene, ranges
        self._pool = WorkerPool(workers=2)
        weakref.finalize(self, self._pool.close)
        self.at({})
        self.widget: Any = None
        if importlib.util.find_spec("ipywidgets"):
            self.widget = _widget(self)

    @property
    def scene(self) -> Scene:
        """The scene with the sliders' values and its full run."""
        return self.view.scene.replace(run=self._origin.to_tables()["run"])

    def at(self, values: Mapping[str, float]) -> SliderSetting:
        """Compute the view for other values of the scene, and store it as `view`.

        Parameters
        ----------
        values : dict of str to float
            Values by dotted key; other keys keep the scene's values.

        Raises
        ------
        HarvesterError
            A value is invalid, or the run failed.
        """
        clock = time.perf_counter()
        shown = cut_short(prepared(self._origin.replace(dict(values))))
        solving = self._pool.submit(outlined, {"prepared_scene": shown}, TIME_LIMIT)
        result = self._simulated(shown)
        densities, refusal = _answer(solving)
        view = SliderSetting(shown.scene, result, densities, refusal, math.nan)
        self.picture = figures.image(view.figure(), "png")
        self.view = replace(view, seconds=time.perf_counter() - clock)
        return self.view

    def _simulated(self, shown):
        scene = shown.scene
        period = 2.0 * math.pi / (timescales.angular_frequency(shown.system) or math.inf)
        start = scene.run.settle
        window = start, start + min(WAVEFORM_PERIODS * period or math.inf, scene.run.duration)
        return simulate(
            scene, method="monte-carlo", window=window, time_limit=TIME_LIMIT, runner=self._pool
        )

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict[str, Any]:
        plain = {"text/plain": repr(self), "image/png": self.picture}
        if self.widget is None:
            return plain
        return plain | self.widget._repr_mimebundle_()

    def __repr__(self) -> str:
        return one_line(f"<Explorer of {self.view.scene.name}: {self.view.sentence()}>")


@takes_scene
def explore(
    scene: Scene, over: Iterable[str] | Mapping[str, tuple[float, float]] | None = None
) -> Explorer:
    """Sliders for a scene's values in a notebook, with a picture that follows them.

    As the last line of a cell it displays p(X), p(X') and p(V) by the stationary solver and by
    Monte Carlo, power and efficiency with standard errors, and a waveform. The first picture takes
    about ten seconds for compilation, later ones less than a second with a resistor as load.
    Without ipywidgets (extra `notebooks`) there is one picture; `Explorer.at` gives others.

    Parameters
    ----------
    scene : Scene, str or Path
        A scene, its file or the name of a built-in one.
    over : iterable of str, or dict of str to (float, float), optional
        Dotted keys, such as "stoppers.gap", or keys with the ends of their sliders; by default a
        third to three times the scene's value. None: noise, damping, gap, coupling, load.

    Returns
    -------
    Explorer
        `view.result` and `scene` belong to the current positions of the sliders.

    Raises
    ------
    HarvesterError
        A key or range is invalid, or the scene cannot be simulated.
    """
    usual = [key for key in numbers(scene) if key.rpartition(".")[2] in USUAL_KEYS]
    keys = usual if over is None else [over] if isinstance(over, str) else over
    ranges = dict(keys) if isinstance(keys, Mapping) else {}
    keys = ranges or listed(keys, "over", '["load.resistance"]', str)
    return Explorer(scene, {key: _range(scene, key, ranges.get(key)) for key in keys})


def cut_short(setup: Prepared) -> Prepared:
    """The prepared scene with its run shortened to `STEPS_SHOWN` steps of Monte Carlo."""
    scene = setup.scene
    per_second = steps_per_sample(setup, engine="monte-carlo") / knot_spacing(setup)
    load = scene.load.circuit
    if load and load.resistance is None:
        per_second *= SWITCHING_COST if load.switches else NETLIST_COST
    longest = STEPS_SHOWN / FEWEST_REALIZATIONS / per_second - scene.run.settle
    duration = min(scene.run.duration, max(longest, scene.run.settle, knot_spacing(setup)))
    count = int(STEPS_SHOWN / per_second / (scene.run.settle + duration))
    realizations = min(scene.run.realizations, max(count, FEWEST_REALIZATIONS))
    return setup.with_run(duration=duration, realizations=realizations)


def outlined(prepared_scene: Prepared, report: Callable) -> dict[str, Density]:
    """Densities of displacement, velocity and voltage by the stationary solver, in a worker.

    Raises
    ------
    HarvesterError
        The solver is not valid for this scene.
    """
    density = outline(averaged_device(prepared_scene))
    # On a coarse grid densities oscillate from node to node; the joint density is smoothed.
    x, v, joint = density.tabulated_joint()
    marginals = {
        "displacement": (x, joint.sum(axis=1) * (v[1] - v[0])),
        "velocity": (v, joint.sum(axis=0) * (x[1] - x[0])),
        "voltage": density.tabulated("voltage"),
    }
    return {name: Density(*curve, None, name) for name, curve in marginals.items()}


def _answer(solving):
    """The solver's densities and "", or no densities and the reason."""
    try:
        answer = solving.result()
    except HarvesterError as error:
        answer = error
    return ({}, str(answer)) if isinstance(answer, HarvesterError) else (answer, "")


def _range(scene, key, ends):
    """Range (low, high) of a slider, widened to contain the scene's value.

    If `ends` is None, it is the value divided and multiplied by RANGE_RATIO, within the key's
    limits. Raises HarvesterError if the ends are not a range.
    """
    value, spec = number(scene, key, "explore")
    try:
        low, high = (
            sorted((value / RANGE_RATIO, value * RANGE_RATIO)) if ends is None else map(float, ends)
        )
    except (TypeError, ValueError):
        raise HarvesterError(f"{key}: {shown(ends)} is not a range; give (low, high)") from None
    if ends is None:
        low, high = max(low, spec.low), min(high, spec.high)
    if not low < high:
        raise HarvesterError(f"{key}: no range from {low:g} to {high:g}; give it as (low, high)")
    return min(low, value), max(high, value)


def _draw(view: SliderSetting) -> Figure:
    """Draw p(X), p(X') and p(V) by Monte Carlo and the stationary solver; X and V over time."""
    from matplotlib import rc_context

    # Typesetting tick labels as formulas would take as long as the rest of the drawing.
    with rc_context({"axes.formatter.use_mathtext": False}):
        return _drawn(view)


def _drawn(view):
    from matplotlib.figure import Figure

    result = view.result
    figure = Figure(figsize=(8.0, 4.8))
    figure.set_layout_engine("none")
    halves = figure.add_gridspec(2, 1, **MARGINS)
    across = halves[0].subgridspec(1, len(result.densities), wspace=0.28)
    for column, name in enumerate(result.densities):
        axes = figure.add_subplot(across[column])
        draw_density(axes, result, name, "Monte Carlo", colour=MONTE_CARLO)
        if name in view.outline:
            solver = replace(result, densities=view.outline)
            colour = LINES["fokker_planck"][0]
            draw_density(axes, solver, name, "stationary solver", colour=colour, line=":")
        axes.set_xlabel(axis_label(result, name))
        axes.set_ylim(bottom=0.0)
        axes.locator_params(axis="x", nbins=5)
        frame(axes, [result], name)
        if column == 0:
            axes.set_ylabel("probability density")
            figure.legend(*axes.get_legend_handles_labels(), loc="upper right", ncols=2)
    motion = halves[1].subgridspec(2, 1, hspace=0.18)
    above = figure.add_subplot(motion[0])
    below = figure.add_subplot(motion[1], sharex=above)
    for axes, name in ((above, "displacement"), (below, "voltage")):
        axes.plot(result.waveform.time, result.waveform[name], color=CIRCUIT, linewidth=0.8)
        axes.set_ylabel(axis_label(result, name).replace(" ", "\n"), fontsize=8)
    figure.align_ylabels((above, below))
    above.tick_params(labelbottom=False)
    below.set_xlabel("time [s]")
    return figure


def _widget(explorer: Explorer) -> Any:
    """Build sliders, a line of text and the picture."""
    from ipywidgets import HTML, GridBox, Image, Layout, VBox

    line, picture = HTML(), Image(format="png")
    picture.layout.max_width = "100%"
    origin = explorer.scene
    sliders = {
        key: _slider(key, number(origin, key, "explore")[0], *ends)
        for key, ends in explorer.ranges.items()
    }

    def show() -> None:
        view = explorer.view
        solver = f" No stationary solver: {view.refusal}" if view.refusal else ""
        line.value = _line(f"{view.sentence()} ({view.seconds:.1f} s).{solver}")
        picture.value, picture.layout.opacity = explorer.picture, "1"

    def follow(_: object) -> None:
        line.value = _line("…")
        try:
            explorer.at({key: slider.value for key, slider in sliders.items()})
        except HarvesterError as error:
            line.value, picture.layout.opacity = _line(str(error), "#A50026"), LOST
        else:
            show()

    for slider in sliders.values():
        slider.observe(follow, "value")
    show()
    columns = Layout(grid_template_columns="repeat(auto-fit, minmax(min(30em, 100%), 1fr))")
    return VBox([GridBox([*sliders.values()], layout=columns), line, picture])


def _slider(key, value, low, high):
    """One slider, logarithmic if its range is wide; it reports when it is released."""
    from ipywidgets import FloatLogSlider, FloatSlider, Layout

    common = {
        "value": value,
        "description": key,
        "continuous_update": False,
        "readout_format": ".4g",
        "style": {"description_width": "14em"},
        "layout": Layout(width="auto"),
    }
    if low > 0.0 and high / low >= LOGARITHMIC_RATIO:
        low, high = math.log10(low), math.log10(high)
        return FloatLogSlider(min=low, max=high, step=(high - low) / SLIDER_STEPS, **common)
    return FloatSlider(min=low, max=high, step=(high - low) / SLIDER_STEPS, **common)


def _line(text, colour="inherit"):
    return f'<span style="color: {colour}">{html.escape(one_line(text))}</span>'
