"""Commands: a function whose signature gives the options, with common steps before and after it."""

from __future__ import annotations

import contextlib
import inspect
import pkgutil
import re
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from harvester.base.errors import SimulationError
from harvester.base.signatures import File, Folder, Option, RunnerOptions, options_of
from harvester.cli.options import WORD, is_scene, options_shown, parameter_of
from harvester.cli.output import check_places, show, study_runner, write_result
from harvester.cli.shown import quiet, say

if TYPE_CHECKING:
    from harvester.engines.runner import Runner
    from harvester.scene.model import Scene


@dataclass(frozen=True)
class Command:
    """A command that only calls its function, which prints the result itself.

    Attributes
    ----------
    function : str
        MODULE:NAME, imported when the command or its help is called. It returns the exit code, or
        None for 0.
    example : str
        Arguments of an example call.
    bar : str
        Content of the progress bar; left out: there is none.
    """

    function: str
    example: str
    bar: str = ""

    @property
    def name(self) -> str:
        """The function's name as the command line has it."""
        return self.function.partition(":")[2].replace("_", "-")

    @property
    def target(self) -> Callable:
        """The function that the command calls."""
        return pkgutil.resolve_name(self.function)

    def options(self) -> Iterator[tuple[Option, str]]:
        """The command's options, each with its help."""
        yield from options_shown(self.target)
        yield Option.of("quiet", bool, False), "Show errors only, and what goes to -."

    def callback(self, scenes: Collection[str] = ()) -> Callable[..., int | None]:
        """The function that cyclopts reads the options from; `scenes`: see `parameter_of`."""

        def call(**values: Any) -> int | None:
            for name, option in options_of(self.target).items():
                if option.type is bool and name in values:
                    # The option of a setting that is on by default turns it off.
                    values[name] ^= option.default is True
            with quiet(values.pop("quiet", False)):
                return self.run(values)

        parameters = [parameter_of(option, text, scenes) for option, text in self.options()]
        parameters.sort(key=lambda parameter: parameter.kind)
        call.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        call.__annotations__ = {item.name: item.annotation for item in parameters}
        return call

    def run(self, values: dict[str, Any]) -> int | None:
        """Carry the command out; returns the exit code, or None for 0."""
        from harvester.cli.console import progress

        with progress() if self.bar else contextlib.nullcontext() as follow:
            if follow:
                follow(self.bar, None)
            return self._call(self._scene(values), values)

    def _scene(self, values: dict[str, Any]) -> Scene | None:
        """The scene that the call names, overrides and seed put in; None where there is none."""
        scene = next(filter(is_scene, options_of(self.target).values()), None)
        if scene is None:
            return None
        from harvester.scene.model import Scene

        overrides = values.pop("overrides", [])
        if "seed" in values:
            overrides.append(f"run.seed={values.pop('seed')}")
        return Scene.read(values.pop("scene", scene.default), overrides)

    def _call(self, scene: Scene | None, values: dict[str, Any]) -> Any:
        """Call the function; the scene and the words of the call are its positional arguments."""
        words = [
            values.pop(option.name)
            for option in options_of(self.target).values()
            if option.passing is WORD and option.name in values
        ]
        return self.target(*([] if scene is None else [scene]), *words, **values)


def named_after(scene: str, stem: str) -> str:
    """Name of a result's files; a scene that is such a result itself is counted on.

    Examples
    --------
    >>> named_after("beam", "identified"), named_after("beam-identified", "identified")
    ('beam-identified', 'beam-identified-2')
    """
    again = re.fullmatch(rf"(.+-{re.escape(stem)})(-\d+)?(-proposed)?", scene)
    if not again:
        return f"{scene}-{stem}"
    return f"{again[1]}-{int((again[2] or '-1')[1:]) + 1}"


def _say_costs(scene):
    """Print, before anything runs, how long a load that switches fast will take."""
    if scene is None or scene.load.circuit is None:
        return
    from circuits.netlist.load_notes import following_notes

    for note in following_notes(scene.load.circuit, scene.run.settle + scene.run.duration):
        say(note)


@dataclass(frozen=True)
class StudyCommand(Command):
    """A command that computes a result, shows it and writes its files.

    A function with `**running: Unpack[RunnerOptions]` is given an open runner, one with `progress`
    what draws the progress bar.

    Attributes
    ----------
    title : str or callable
        Title of the table, or a function of the result that returns it; empty: the command's name.
    stem : str
        Name of the files, behind that of the scene: a word, or an option in braces; left out: the
        command's name.
    failed : callable or None
        Function that tells from the result whether the exit code is 1.
    waveform : bool
        Whether there is --waveform, which gets the result's `waveform`.
    running : callable or None
        Function of the options that gives the runner's settings where the user leaves it out.
    bar : str
        Content of the progress bar: "" the runner's tasks if there is a runner, "function" the
        function's own reports, "simulated time" these with seconds of the scene.
    """

    title: str | Callable[[Any], str] = ""
    stem: str = ""
    failed: Callable[[Any], bool] | None = None
    waveform: bool = False
    running: Callable[[dict[str, Any]], RunnerOptions] | None = None

    def options(self) -> Iterator[tuple[Option, str]]:
        *options, quiet_option = super().options()
        yield from options
        yield Option.of("json", File), "Write JSON; - for standard output."
        if not self._takes_runner():
            yield Option.of("output", Folder), "Folder for JSON and figure."
        if self.waveform:
            text = "Write a realization over time (see --window, --node): a .csv, .nc or .png file."
            yield Option.of("waveform", File), text
        yield Option.of("report", File), "Write one self-contained HTML page with everything."
        yield quiet_option

    def run(self, values: dict[str, Any]) -> int:
        scene = self._scene(values)
        places = {kind: values.pop(kind, None) for kind in ("json", "report", "waveform")}
        # The runner's folder is an option of the function.
        places["output"] = (values.get if self._takes_runner() else values.pop)("output", None)
        _say_costs(scene)
        defaults = {name: option.default for name, option in options_of(self.target).items()}
        stem = (self.stem or self.name).format(**defaults | values)
        name = named_after(scene.name, stem) if scene else stem
        check_places(**places, names=[name])
        # The progress bar of a single simulation names its method.
        label = stem if self.bar == "simulated time" else self.name
        with self._opened(label, scene, values) as runner:
            result = self._computed(scene, values, places["json"])
            if runner:
                # The folder is still locked, so that no other run writes its files among these.
                self._deliver(result, name, **places)
        if not runner:
            self._deliver(result, name, **places)
        return 1 if self.failed and self.failed(result) else 0

    def _computed(self, scene, values, json):
        """Compute the result; if the run fails, its partial result is written as JSON."""
        try:
            return self._call(scene, values)
        except SimulationError as error:
            if json and error.partial is not None:
                write_result(json, None, "", error.partial)
            raise

    def _deliver(self, result, name, json, output, report, waveform):
        title = self.title(result) if callable(self.title) else self.title
        title = title or self.name.replace("-", " ")
        show(result, title, json)
        try:
            write_result(json, output, name, result)
        finally:
            if waveform and result.waveform is None:
                say(f"{waveform}: not written, as the first realization failed")
            elif waveform:
                from harvester.results.files import save

                save(result.waveform, waveform)
                say(f"written: {waveform}, {result.waveform.said()}")
            if report:
                from harvester.base.writing import write_text
                from harvester.cli.report import page_of

                write_text(report, page_of(result, title))
                say(f"written: {report}")

    @contextlib.contextmanager
    def _opened(
        self, label: str, scene: Scene | None, values: dict[str, Any]
    ) -> Iterator[Runner | None]:
        """Add to the options what runs the study; gives the runner where there is one."""
        from harvester.cli.console import progress

        parameters, runner = options_of(self.target), None
        with contextlib.ExitStack() as opened:
            if "progress" in parameters and (self.bar or not self._takes_runner()):
                follow = opened.enter_context(progress())
                values["progress"] = follow(label, scene if self.bar == "simulated time" else None)
            elif not self._takes_runner():
                opened.enter_context(progress())(label, None)
            if self._takes_runner():
                running: RunnerOptions = self.running(values) if self.running else {}
                for name in RunnerOptions.__annotations__.keys() & values.keys() - {"progress"}:
                    running[name] = values.pop(name)  # type: ignore[literal-required]
                words = None if self.bar else self.name.replace("-", " ")
                runner = opened.enter_context(study_runner(words, **running))
                values["runner"] = runner
            yield runner

    def _takes_runner(self):
        """Whether the function takes `**running`, the options of a study's runner."""
        return "time_budget" in options_of(self.target)
