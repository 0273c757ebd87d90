"""Class of a command: derives options from a function's signature and handles its result."""

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
from harvester.cli.output import check_outputs, show, study_runner, write_result
from harvester.cli.shown import quiet, say

if TYPE_CHECKING:
    from harvester.scene.model import Scene


@dataclass(frozen=True)
class Command:
    """A command that calls a function; if this returns a result, the command shows and writes it.

    The parameter `progress`, if any, receives a function that draws the progress bar. Functions
    with `**running: Unpack[RunnerOptions]` receive an open runner.

    Attributes
    ----------
    function : str
        MODULE:NAME, imported when the command or its help is called. It returns a result, the exit
        code, or None for 0. Its docstring is the help, with an example of a call.
    title : str or callable
        Title of the table, or a function of the result that returns it; empty: the command's name.
    stem : str
        Name of the files after the scene's name: a word, or an option in braces; empty: the
        command's name.
    failed : callable or None
        Function of the result that returns whether the exit code is 1.
    is_run : bool
        Whether it is one run of an engine: --waveform writes the result's `waveform`, and the
        progress bar shows the rate of the simulated time.
    running : callable or None
        Function of the options that returns defaults of the runner's settings.
    """

    function: str
    title: str | Callable[[Any], str] = ""
    stem: str = ""
    failed: Callable[[Any], bool] | None = None
    is_run: bool = False
    running: Callable[[dict[str, Any]], RunnerOptions] | None = None

    @property
    def name(self) -> str:
        """The function's name with hyphens, as on the command line."""
        return self.function.partition(":")[2].replace("_", "-")

    @property
    def target(self) -> Callable:
        """The function that the command calls."""
        return pkgutil.resolve_name(self.function)

    @property
    def returns_result(self) -> bool:
        return inspect.signature(self.target).return_annotation not in ("None", "int")

    @property
    def takes_runner(self) -> bool:
        return RunnerOptions.__annotations__.keys() <= options_of(self.target).keys()

    def options(self) -> Iterator[tuple[Option, str]]:
        """The command's options, each with its help."""
        yield from options_shown(self.target)
        if self.returns_result:
            yield Option.of("json", File), "File for JSON; - is standard output."
            if not self.takes_runner:
                yield Option.of("output", Folder), "Folder for JSON and figure."
            if self.is_run:
                text = "Write a realization over time (see --window, --node): .csv, .nc, .png, .svg"
                yield Option.of("waveform", File), f"{text} or .pdf."
            yield Option.of("report", File), "Write one self-contained HTML page with all results."
        yield Option.of("quiet", bool, False), "Print errors only, and output whose file is -."

    def callback(self, scenes: Collection[str] = ()) -> Callable[..., int | None]:
        """Return the function whose signature cyclopts reads; `scenes`: see `parameter_of`."""

        def call(**values: Any) -> int | None:
            for name, option in options_of(self.target).items():
                if option.type is bool and name in values:
                    # The option of a setting that is on by default turns the setting off.
                    values[name] ^= option.default is True
            with quiet(values.pop("quiet", False)):
                return self.run(values)

        parameters = [parameter_of(option, text, scenes) for option, text in self.options()]
        parameters.sort(key=lambda parameter: parameter.kind)
        call.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        call.__annotations__ = {item.name: item.annotation for item in parameters}
        return call

    def run(self, values: dict[str, Any]) -> int | None:
        """Run the command; return the exit code, or None for 0."""
        from harvester.cli.console import progress

        scene = self._scene(values)
        if not self.returns_result:
            return self._call(scene, values)
        if scene and scene.load.circuit:
            from circuits.netlist.load_notes import following_notes

            # State the computing time of a load with fast switching.
            for note in following_notes(scene.load.circuit, scene.run.settle + scene.run.duration):
                say(note)
        outputs = {
            kind: values.pop(kind, None) for kind in ("json", "output", "report", "waveform")
        }
        parameters = options_of(self.target)
        defaults = {name: option.default for name, option in parameters.items()}
        stem = (self.stem or self.name).format(**defaults | values)
        name = named_after(scene.name, stem) if scene else stem
        check_outputs(**outputs, names=[name])
        # The progress bar of a single run names its method.
        label, seconds = self.name.replace("-", " "), 0.0
        if self.is_run and scene:
            run = scene.run
            label, seconds = stem, (run.settle + run.duration) * run.realizations
        with contextlib.ExitStack() as opened:
            with progress(label, seconds) as report:
                if "progress" in parameters:
                    values["progress"] = report
                if self.takes_runner:
                    # The runner's folder stays locked until the result's files are written into it.
                    running = {**self._running(values), "output": outputs["output"]}
                    opening = study_runner(**running, progress=report)
                    values["runner"] = opened.enter_context(opening)
                result = self._computed(scene, values, outputs["json"])
            self._deliver(result, name, **outputs)
        return 1 if self.failed and self.failed(result) else 0

    def _scene(self, values: dict[str, Any]) -> Scene | None:
        """The scene of the call, with overrides and seed applied; None if the command takes no
        scene.
        """
        scene = next(filter(is_scene, options_of(self.target).values()), None)
        if scene is None:
            return None
        from harvester.scene.model import Scene

        overrides = values.pop("overrides", [])
        if "seed" in values:
            overrides.append(f"run.seed={values.pop('seed')}")
        return Scene.read(values.pop("scene", scene.default), overrides)

    def _running(self, values: dict[str, Any]) -> dict[str, Any]:
        """Pop the runner's options from the options of the function."""
        running: Any = self.running(values) if self.running else {}
        names = RunnerOptions.__annotations__.keys() & values.keys() - {"progress"}
        return running | {name: values.pop(name) for name in names}

    def _call(self, scene: Scene | None, values: dict[str, Any]) -> Any:
        """Call the function with the scene and the positional arguments first."""
        words = [
            values.pop(option.name)
            for option in options_of(self.target).values()
            if option.passing is WORD and option.name in values
        ]
        return self.target(*([] if scene is None else [scene]), *words, **values)

    def _computed(self, scene, values, json):
        """Compute the result; if the run fails, write its partial result as JSON."""
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
                say(f"written: {waveform}, {result.waveform.summary()}")
            if report:
                from harvester.base.writing import write_text
                from harvester.results.report import page_of

                write_text(report, page_of(result, title))
                say(f"written: {report}")


def named_after(scene: str, stem: str) -> str:
    """Name of a result's files; if the scene is such a result, the name gets the next number.

    Examples
    --------
    >>> named_after("beam", "identified"), named_after("beam-identified", "identified")
    ('beam-identified', 'beam-identified-2')
    """
    again = re.fullmatch(rf"(.+-{re.escape(stem)})(-\d+)?(-proposed)?", scene)
    if not again:
        return f"{scene}-{stem}"
    return f"{again[1]}-{int((again[2] or '-1')[1:]) + 1}"
