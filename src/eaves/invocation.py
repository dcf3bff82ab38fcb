"""From the words of a command line to a recipe, options, and a run that says how it goes."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from eaves.pipeline import Recipe
    from eaves.tiling.build import Options
    from eaves.tiling.outputs import Summary

COMPLETE, INCOMPLETE, MISUSE, INTERRUPTED = 0, 1, 2, 130
"""Exit statuses; 130 is the shell's for Ctrl-C."""
WHERE_TO_OPEN = {
    "in a browser": "report.html",
    "in QGIS": "footprints.gpkg",
    "in Blender": "buildings.glb",
    "in Cesium": "tileset.json",
}
"""What the last lines of a run point to, where it was written."""


@contextmanager
def heard_interrupts() -> Iterator[list[int]]:
    """A list that grows with every Ctrl-C: libraries turn the exception into errors of their own."""
    heard: list[int] = []

    def hear(number: int, frame: object) -> None:
        heard.append(number)
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, hear)
    try:
        yield heard
    finally:
        signal.signal(signal.SIGINT, before)


def tell_error(error: Exception) -> int:
    """Say in one line what went wrong; the exit status. What nobody foresaw is raised again."""
    from eaves.formats.disk import DiskFullError

    status, line = MISUSE, " ".join(str(error).split())
    # a wrong word on the command line; typer brings its own click, so its classes have no fixed name
    told = getattr(error, "format_message", None)
    if isinstance(error, MemoryError):
        status, line = INCOMPLETE, f"memory ran out ({line}); use fewer --jobs, or --bounds for a part"
    elif isinstance(error, ValueError | OSError):
        if "--verbose" in sys.argv or "-v" in sys.argv:
            raise error
        status = INCOMPLETE if isinstance(error, DiskFullError) else MISUSE
    elif told is None:
        raise error
    elif type(error).__name__ == "NoArgsIsHelpError":
        typer.echo(told())
        return status
    else:
        line = " ".join(told().split()).rstrip(".") + "; see --help"
    typer.echo(f"error: {line}", err=True)
    return status


def read_config(path: Path | None) -> dict[str, dict[str, Any]]:
    """The tables of a TOML file by stage; ValueError names a stage that does not exist."""
    import tomllib

    from eaves.methods import REGISTRY

    if path is None:
        return {}
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ValueError(f"{path}: there is no such configuration file; check --config") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: not valid TOML ({error}); mend the file") from None
    for stage, table in tables.items():
        if stage not in REGISTRY or not isinstance(table, dict):
            raise ValueError(f"{path}: unknown table '{stage}'; choose among: {', '.join(REGISTRY)}")
    return tables


def recipe_from(
    names: dict[str, str | None],
    settings: dict[str, dict[str, Any]],
    *,
    as_published: bool,
    use_classes: bool,
    lod: str,
) -> Recipe:
    """The recipe of the command line's names over the configuration file's tables."""
    from eaves.model.building import LODS
    from eaves.pipeline import make_recipe

    if lod not in LODS:
        raise ValueError(f"--lod {lod}: unknown level of detail; choose one of: {', '.join(LODS)}")
    chosen = {stage: table.get("method") for stage, table in settings.items()}
    chosen |= {stage: name for stage, name in names.items() if name}
    parameters = {
        stage: {key: value for key, value in table.items() if key != "method"}
        for stage, table in settings.items()
    }
    return make_recipe(chosen, parameters, published=as_published, use_classes=use_classes, lod=lod)


def options_from(*, bounds: str | None = None, jobs: int = 1, **rest: Any) -> Options:
    """The options with the bounds parsed and the number of jobs settled."""
    import os

    from eaves.model import Bounds
    from eaves.tiling.build import Options

    window = None
    if bounds:
        try:
            west, south, east, north = (float(part) for part in bounds.split(","))
        except ValueError:
            raise ValueError(f"--bounds {bounds}: not four numbers; write west,south,east,north") from None
        if west >= east or south >= north:
            raise ValueError(f"--bounds {bounds}: west must be below east, south below north")
        window = Bounds(west, south, east, north)
    return Options(bounds=window, jobs=jobs or os.cpu_count() or 1, **rest)


def run_build(
    inputs: list[str],
    out: Path,
    recipe: Recipe,
    options: Options,
    quiet: bool,
    verbose: bool,
) -> Summary:
    """Build with progress on screen."""
    from eaves.tiling.build import build as build_files
    from eaves.viewer.build import build as build_with_report

    start_log(quiet, verbose)
    do = build_files if options.outputs else build_with_report
    with progress(quiet) as tell:
        return do(inputs, out, recipe, options, tell)


def finish(summary: Summary, quiet: bool, strict: bool) -> None:
    """Say what came out, and leave with the right status."""
    if not quiet:
        typer.echo(summary.as_text())
        for program, name in WHERE_TO_OPEN.items():
            there = [path for path in summary.files if path.name == name]
            if there:
                typer.echo(f"  {program:<14} {there[0]}")
    for reason in summary.failed:
        typer.echo(f"incomplete: {reason}", err=True)
    failures = strict and summary.found > summary.modelled
    raise typer.Exit(COMPLETE if summary.complete and not failures else INCOMPLETE)


def start_log(quiet: bool, verbose: bool) -> None:
    """Warnings (and more, if wanted) go to standard error, a line each."""
    import logging

    level = logging.DEBUG if verbose else logging.WARNING if quiet else logging.INFO
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(levelname)s: %(message)s"))
    logger = logging.getLogger("eaves")
    logger.handlers[:] = [handler]
    logger.setLevel(level)


def progress(quiet: bool) -> Any:
    """A context manager whose value hears progress: bars on a terminal, plain lines in a log, nothing if
    quiet."""
    from eaves.viewer.progress import bars, lines, nothing

    if quiet:
        return nothing()
    return bars() if sys.stderr.isatty() else lines()


def describe_methods(stage: str | None) -> Iterator[str]:
    """Lines on every method, or on those of one stage with their parameters."""
    from eaves.methods import DEFAULTS, REGISTRY, method_class

    if stage is not None and stage not in REGISTRY:
        raise ValueError(f"unknown stage '{stage}'; choose one of: {', '.join(REGISTRY)}")
    for name in [stage] if stage else list(REGISTRY):
        yield name
        for method in REGISTRY[name]:
            cls = method_class(name, method)
            mark = " (default)" if DEFAULTS[name] == method else ""
            yield f"  {method}{mark}: {cls.idea} [{cls.paper}]"
            for key, field in cls.model_fields.items() if stage else ():
                extra: Any = field.json_schema_extra or {}
                unit = "" if extra.get("unit") in (None, "1") else f" {extra['unit']}"
                default = "derived" if field.default is None else f"{field.default}{unit}"
                printed = extra.get("published")
                published = "" if printed is None else f"; published {printed}{unit} ({extra['printed_in']})"
                yield f"      {key} = {default}{published}: {field.description}"
