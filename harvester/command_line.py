"""The `harvester` command. Exit codes: 0 done, 1 a run failed, 2 a mistake in the call."""

import argparse
import sys
from contextlib import closing
from pathlib import Path

from harvester import __version__
from harvester.errors import EngineNotFound, HarvesterError, SimulationError

CLOSURES = ("paper", "consistent")


def main(arguments=None):
    """Run the command line; returns the exit code."""
    options = _parser().parse_args(arguments)
    try:
        return options.command(options) or 0
    except SimulationError as error:
        _say(f"harvester: {type(error).__name__}: {error}")
        _keep_partial(options, error)
        return 1
    except EngineNotFound as error:
        _say(f"harvester: {error}")
        return 1
    except HarvesterError as error:
        _say(f"harvester: {error}")
        return 2
    except KeyboardInterrupt:
        _say("harvester: interrupted; nothing was written")
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 0


def _parser():
    parser = argparse.ArgumentParser(
        prog="harvester",
        description="Vibration energy harvesters as circuits: ngspice, Monte Carlo and "
        "stochastic averaging of one scene, with error bars.",
    )
    parser.add_argument("--version", action="version", version=f"harvester {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    _add_validate(commands)
    _add_simulate(commands)
    _add_average(commands)
    _add_work_precision(commands)
    _add_stability(commands)
    _add_netlist(commands)
    _add_engine(commands)
    return parser


def _add_validate(commands):
    command = _scene_command(
        commands,
        "validate",
        _validate,
        "compare circuit, Monte Carlo and averaging on one scene",
        "harvester validate paper --output results",
    )
    _add_engine_options(command)
    _add_results(command)


def _add_simulate(commands):
    command = _scene_command(
        commands,
        "simulate",
        _simulate,
        "run one scene through one engine",
        "harvester simulate paper --engine circuit --set excitation.intensity=0.1 --json -",
    )
    command.add_argument(
        "--engine", default="circuit", help="circuit (default) or monte-carlo", metavar="NAME"
    )
    command.add_argument(
        "--source",
        default="external",
        metavar="NAME",
        help="circuit only: external (default), or pwl for a source in the netlist with "
        "ngspice's own steps",
    )
    _add_engine_options(command)
    _add_keep_going(command)
    _add_results(command)


def _add_average(commands):
    command = _scene_command(
        commands,
        "average",
        _average,
        "stochastic averaging of one scene",
        "harvester average paper --closure consistent",
    )
    command.add_argument(
        "--closure",
        default="consistent",
        metavar="NAME",
        help=f"{' or '.join(CLOSURES)} (default: consistent)",
    )
    _add_results(command)


def _add_work_precision(commands):
    command = _scene_command(
        commands,
        "work-precision",
        _work_precision,
        "error against run time of every method on one scene",
        "harvester work-precision paper --output results",
    )
    command.add_argument("--workers", type=int, metavar="N", help="processes (default: one a core)")
    command.add_argument(
        "--thorough", action="store_true", help="more paths, steps and realizations"
    )
    _add_results(command)


def _add_stability(commands):
    command = _scene_command(
        commands,
        "stability",
        _stability,
        "judge stiff and extreme variations of one scene; exit code 1 where one is wrong",
        "harvester stability paper --output results",
        default_scene="paper",
    )
    command.add_argument("--step", default="default", help=_STEP_HELP)
    command.add_argument("--workers", type=int, metavar="N", help="processes (default: one a core)")
    _add_results(command)


def _add_netlist(commands):
    command = _scene_command(
        commands,
        "netlist",
        _netlist,
        "write a stand-alone .cir that plain `ngspice -b` runs",
        "harvester netlist paper --set run.duration=100 --output paper.cir",
    )
    command.add_argument(
        "--output",
        default="-",
        metavar="FILE",
        help="file, or folder for SCENE.cir (default: standard output)",
    )
    command.add_argument("--step", default="default", help=_STEP_HELP)
    command.add_argument(
        "--realization", type=int, default=0, metavar="N", help="whose noise path (default: 0)"
    )


def _add_engine(commands):
    command = commands.add_parser("engine", help="show the ngspice that was found")
    command.add_argument("--json", metavar="FILE", help="write JSON; - for standard output")
    command.set_defaults(command=_engine, output=None)


_STEP_HELP = "default, fine, finest, or the longest step in seconds"


def _scene_command(commands, name, function, text, example, default_scene=None):
    command = commands.add_parser(name, help=text, description=text, epilog=f"example: {example}")
    optional = {"nargs": "?", "default": default_scene} if default_scene else {}
    command.add_argument(
        "scene",
        help="a TOML file or the name of a built-in scene"
        + (f" (default: {default_scene})" if default_scene else ""),
        **optional,
    )
    command.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="TABLE.KEY=VALUE",
        help="override a value of the scene; TABLE=none removes a table",
    )
    command.add_argument("--seed", type=int, help="same as --set run.seed=SEED")
    command.set_defaults(command=function)
    return command


def _add_engine_options(command):
    command.add_argument("--step", default="default", help=_STEP_HELP)
    command.add_argument("--workers", type=int, metavar="N", help="processes (default: one a core)")
    command.add_argument(
        "--time-limit",
        type=float,
        default=3600.0,
        metavar="SECONDS",
        help="wall-clock limit of one realization (default: 3600)",
    )


def _add_keep_going(command):
    command.add_argument(
        "--keep-going",
        action="store_true",
        help="try a realization that crashes or runs out of time once more, and go on without it",
    )


def _add_results(command):
    command.add_argument("--json", metavar="FILE", help="write JSON; - for standard output")
    command.add_argument("--output", metavar="DIR", help="folder for JSON and figure")


def _scene(options):
    from harvester.scene import Scene

    overrides = list(options.set)
    if options.seed is not None:
        overrides.append(f"run.seed={options.seed}")
    return Scene.load(options.scene, overrides)


def _check_options(options):
    from harvester.output import check_writable

    if getattr(options, "workers", None) is not None and options.workers < 1:
        raise HarvesterError(f"--workers {options.workers}: must be a whole number ≥ 1")
    limit = getattr(options, "time_limit", 1.0)
    if not limit > 0.0:
        raise HarvesterError(f"--time-limit {limit:g}: must be a number > 0")
    if options.json:
        check_writable(options.json)
    if options.output:
        check_writable(Path(options.output) / "file")


def _validate(options):
    scene = _scene(options)
    _check_options(options)
    from harvester.comparison import validate
    from harvester.console import progress, show_table

    with progress() as follow:
        comparison = validate(
            scene,
            step=options.step,
            workers=options.workers,
            time_limit=options.time_limit,
            progress=follow,
        )
    show_table(comparison, "one scene, the same noise", to_stderr=options.json == "-")
    _write(options, f"{scene.name}-validate", comparison, "draw_comparison")


def _simulate(options):
    scene = _scene(options)
    _check_options(options)
    from harvester.console import progress, show_result
    from harvester.simulation import simulate

    with progress() as follow:
        result = simulate(
            scene,
            options.engine,
            step=options.step,
            source=options.source,
            keep_going=options.keep_going,
            workers=options.workers,
            time_limit=options.time_limit,
            progress=follow(options.engine, scene),
        )
    show_result(result, to_stderr=options.json == "-")
    _write(options, f"{scene.name}-{options.engine}", result, "draw_result")
    return 0 if result.outcome == "complete" else 1


def _average(options):
    scene = _scene(options)
    _check_options(options)
    from harvester.averaged import average
    from harvester.console import show_result

    result = average(scene, options.closure)
    show_result(result, to_stderr=options.json == "-")
    _write(options, f"{scene.name}-{options.closure}", result, "draw_result")


def _work_precision(options):
    scene = _scene(options)
    _check_options(options)
    from harvester.console import progress, show_table
    from harvester.work_precision import work_precision

    with progress() as follow:
        diagram = work_precision(
            scene, thorough=options.thorough, workers=options.workers, progress=follow
        )
    show_table(diagram, "error against run time", to_stderr=options.json == "-")
    _write(options, f"{scene.name}-work-precision", diagram, "draw_work_precision")


def _stability(options):
    scene = _scene(options)
    _check_options(options)
    from harvester.console import progress, show_table
    from harvester.stability import stability

    with progress() as follow:
        matrix = stability(
            scene,
            step=options.step,
            workers=options.workers,
            progress=follow("stability", None),
        )
    show_table(matrix, "stiff and extreme cases", to_stderr=options.json == "-")
    _write(options, f"{scene.name}-stability", matrix, "draw_stability")
    return 1 if matrix.wrong else 0


def _write(options, name, result, draw):
    """The JSON and figure that were asked for; `draw` names the function of `figures`."""
    from harvester.output import write_json, write_text

    if options.json:
        write_json(options.json, result.to_dict())
    if options.output:
        from harvester import figures

        folder = Path(options.output)
        write_json(folder / f"{name}.json", result.to_dict())
        if hasattr(result, "density_table"):
            write_text(folder / f"{name}-densities.csv", result.density_table())
        figures.save(getattr(figures, draw), result, folder / f"{name}.png")
        _say(f"written to {folder}: {name}.*")


def _netlist(options):
    scene = _scene(options)
    from circuits.export import stand_alone
    from harvester.output import write_text
    from harvester.realization import noise_path, starts_right
    from harvester.simulation import check_step

    target = options.output
    if target != "-" and Path(target).is_dir():
        target = Path(target) / f"{scene.name}.cir"
    if not 0 <= options.realization < scene.run.realizations:
        raise HarvesterError(
            f"--realization {options.realization}: must be a whole number in "
            f"[0, {scene.run.realizations - 1}]"
        )
    netlist = stand_alone(
        scene,
        noise_path(scene, options.realization),
        starts_right(options.realization),
        check_step(options.step),
    )
    write_text(target, netlist.text + ".end\n")


def _engine(options):
    from harvester.console import show_engine
    from harvester.output import check_writable, write_json
    from harvester.workers import Worker

    if options.json:
        check_writable(options.json)
    with closing(Worker()) as worker:
        found = worker.call("circuits.engine:describe", {}, time_limit=60.0)
    show_engine(found, to_stderr=options.json == "-")
    if options.json:
        write_json(options.json, found)


def _keep_partial(options, error):
    """Write what a failed run had, with its outcome named, where JSON was asked for."""
    if error.partial is None or not getattr(options, "json", None):
        return
    from harvester.output import write_json

    write_json(options.json, error.partial.to_dict())


def _say(text):
    print(text, file=sys.stderr)
