"""The parts that commands share: configuration, log, progress, exit statuses, and the run itself."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import typer

if TYPE_CHECKING:
    from eaves.model.summary import Summary
    from eaves.recipe.recipe import Recipe
    from eaves.run.options import RunOptions

COMPLETE, INCOMPLETE, MISUSE, INTERRUPTED, TERMINATED = 0, 1, 2, 130, 143
"""Exit statuses; the last two are the shell's for Ctrl-C and for `kill`."""
WHERE_TO_OPEN = {
    "to review": "review.csv",
    "in a browser": "report.html",
    "in QGIS": "buildings.qgz",
    "in Blender": "buildings.glb",
    "in Cesium": "tileset.json",
}
"""The files that the last lines of a run name, where they were written."""


@contextmanager
def count_interrupts() -> Iterator[list[int]]:
    """A list that grows with every Ctrl-C and every `kill`, by the signal's number: libraries turn the
    exception into errors of their own."""
    interrupts: list[int] = []

    def interrupt(number: int, frame: object) -> None:
        interrupts.append(number)
        raise KeyboardInterrupt

    watched = [signal.SIGINT, signal.SIGTERM]
    before = [signal.signal(number, interrupt) for number in watched]
    try:
        yield interrupts
    finally:
        for number, handler in zip(watched, before, strict=True):
            signal.signal(number, handler)


ABORTED = (
    b"error: a library gave up, most often because memory ran out; nothing is half-written: use --memory or "
    b"fewer --jobs, and run again with --resume\n"
)
_kept: list[object] = []
"""References that keep the functions called by the C library from being collected."""


def report_aborts() -> None:
    """Make one line and status 1 of an abort within a compiled library, where there is such a thing."""
    if sys.platform == "win32":
        return
    import ctypes
    import os

    def end(number: int) -> None:
        os.write(2, ABORTED)
        os._exit(INCOMPLETE)

    _kept[:] = [ctypes.CFUNCTYPE(None, ctypes.c_int)(end)]
    ctypes.CDLL(None).signal(int(signal.SIGABRT), _kept[0])


def report_error(error: Exception) -> int:
    """Print in one line what went wrong; the exit status. Unforeseen errors are raised again."""
    from eaves.formats.whole_files import DiskFullError

    status, line = MISUSE, " ".join(str(error).split())
    # a wrong option; typer contains its own click, so its classes have no fixed name
    format_message = getattr(error, "format_message", None)
    if isinstance(error, MemoryError):
        from eaves.run.memory import REMEDY

        status, line = INCOMPLETE, f"memory ran out ({line}); {REMEDY}"
    elif isinstance(error, EOFError):
        status, line = INCOMPLETE, f"a file ended too early ({line}); run again without --resume"
    elif isinstance(error, ValueError | OSError) or type(error).__name__ == "ContractError":
        if "--verbose" in sys.argv or "-v" in sys.argv:
            raise error
        status = INCOMPLETE if isinstance(error, DiskFullError) else MISUSE
    elif format_message is None:
        raise error
    elif type(error).__name__ == "NoArgsIsHelpError":
        typer.echo(format_message())
        return status
    else:
        line = " ".join(format_message().split()).rstrip(".") + "; see --help"
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
        raise ValueError(f"{path}: not valid TOML ({error}); fix the file") from None
    for stage, table in tables.items():
        if stage not in REGISTRY or not isinstance(table, dict):
            raise ValueError(f"{path}: unknown table '{stage}'; choose among: {', '.join(REGISTRY)}")
    return tables


def read_settings(words: Sequence[str]) -> dict[str, dict[str, Any]]:
    """The tables by stage that `stage.parameter=value` make; values as in TOML, else text. Of a method that
    is a parameter of another one, a parameter is `stage.method.parameter`.

    Raises
    ------
    ValueError
        When one is not written so, or its stage does not exist.
    """
    import tomllib

    from eaves.methods import REGISTRY, merged

    tables: dict[str, dict[str, Any]] = {}
    for word in words:
        name, equals, text = word.partition("=")
        stage, dot, parameter = name.partition(".")
        if not (equals and dot and stage in REGISTRY):
            raise ValueError(f"--set {word}: write STAGE.PARAMETER=VALUE; stages: {', '.join(REGISTRY)}")
        try:
            value = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            value = text
        for part in reversed(parameter.split(".")):
            value = {part: value}
        tables = merged(tables, {stage: value})
    return tables


def run_build(
    inputs: list[str],
    out: Path,
    options: RunOptions,
    given: tuple[Path | None, Sequence[str] | None],
    quiet: bool,
    verbose: bool,
    ground_only: bool = False,
) -> Summary:
    """Build with progress on screen. `given`: a configuration file, which the command line's methods and the
    `--set` words overrule."""
    from eaves.run.memory import keep_all

    start_log(quiet, verbose)
    with keep_all():
        from eaves.run.workers import import_libraries_alone

        import_libraries_alone()
        from eaves.pipeline import build as build_files

        recipe = read_recipe(options, given, ground_only)
    with run_display(quiet, ground_only) as progress:
        return build_files(inputs, out, recipe, progress, allow_failures=True, **options)


def read_recipe(
    options: RunOptions, given: tuple[Path | None, Sequence[str] | None], ground_only: bool = False
) -> Recipe:
    """The recipe of the command line, the configuration file and the `--set` words; the methods' tables stand
    in the options then."""
    from dataclasses import replace

    from eaves.flow.run import recipe_of
    from eaves.methods import merged
    from eaves.run.options import METHOD_OPTIONS, check_options

    options.update(check_options(options))
    tables, settings = read_config(given[0]), read_settings(given[1] or ())
    for stage in {*tables, *settings}:
        named = merged({**tables.get(stage, {}), **(options.get(stage) or {})}, settings.get(stage, {}))  # type: ignore[dict-item]
        options[stage] = named  # type: ignore[literal-required]
    given_methods: dict[str, Any] = {stage: options.get(stage) for stage in METHOD_OPTIONS}
    look_in_this_folder([str(table.get("method")) for table in given_methods.values() if table])
    recipe = recipe_of(options)
    return replace(recipe, detect=None) if ground_only else recipe


def look_in_this_folder(names: Sequence[str]) -> None:
    """Let Python find the modules of methods named `module:Class` in this folder, too, after all others; say
    which are imported. Processes that are started take this over."""
    import logging
    import os

    for name in names:
        if ":" in name:
            logging.getLogger("eaves").info("the method %s is imported", name)
            sys.path += [os.getcwd()] * (os.getcwd() not in sys.path)


def show_plan(
    inputs: list[str],
    out: Path,
    options: RunOptions,
    given: tuple[Path | None, Sequence[str] | None],
    quiet: bool,
    verbose: bool,
) -> NoReturn:
    """Check what a run would check before its first point, and print the figures of its scan; nothing is
    computed or written."""
    from tempfile import TemporaryDirectory

    from eaves.flow.refusals import warn_of_memory
    from eaves.flow.run import plan_run

    start_log(quiet, verbose)
    with TemporaryDirectory() as cache:
        options.setdefault("cache", cache)
        run = plan_run(inputs, out, read_recipe(options, given), **options)
        typer.echo(run.facts.as_text())
        warn_of_memory(run)
    for reason in run.failed:
        typer.echo(f"incomplete: {reason}", err=True)
    raise typer.Exit(INCOMPLETE if run.failed else COMPLETE)


def show_facts(
    inputs: list[str], crs: str | None, to_crs: str | None, as_json: bool, quiet: bool, verbose: bool
) -> NoReturn:
    """Print the figures of a scan and what may go wrong in a run; nothing is computed or written."""
    import json
    from tempfile import TemporaryDirectory

    from eaves.flow.advice import scan_facts
    from eaves.formats.inputs import list_inputs
    from eaves.formats.points.converted import remarks_on
    from eaves.formats.points.remote import localise
    from eaves.run.index import index_inputs

    start_log(quiet, verbose)
    failed: list[str] = []
    remarks: list[str] = []
    with TemporaryDirectory() as folder:
        local, _ = localise(inputs, Path(folder))
        paths = list_inputs(local)
        index = index_inputs(paths, crs, failed, to_crs=to_crs, remarks=remarks)
        facts = scan_facts(index)
        remarks += [remark for path in paths for remark in remarks_on(path)]
    if as_json:
        facts_and_more = facts.as_json()
        facts_and_more["remarks"] += remarks
        typer.echo(json.dumps(facts_and_more, indent=2))
    else:
        typer.echo("\n".join([facts.as_text(), *(f"note: {remark}" for remark in remarks)]))
    raise typer.Exit(INCOMPLETE if failed else COMPLETE)


def finish(summary: Summary, quiet: bool, options: RunOptions, strict: bool = False) -> NoReturn:
    """Say what came out, and leave with the right status.

    Empty is a run that had no point to work on; a forest without a building is a result.
    """
    if not quiet:
        typer.echo(summary.as_text())
        for program, name in WHERE_TO_OPEN.items():
            there = [path for path in summary.files if path.name == name]
            if there:
                typer.echo(f"  {program:<14} {there[0]}")
        if summary.modelled:
            typer.echo(f"  other formats  eaves export {summary.folder} --formats citygml,glb,dxf")
    missing = summary.missing(options.get("allow_empty", False), strict)
    for line in missing:
        typer.echo(line, err=True)
    raise typer.Exit(INCOMPLETE if missing else COMPLETE)


def start_log(quiet: bool, verbose: bool = False) -> None:
    """Warnings (and more, if wanted) go to standard error, a line each."""
    import logging
    import warnings

    level = logging.DEBUG if verbose else logging.WARNING if quiet else logging.INFO
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(levelname)s: %(message)s"))
    logger = logging.getLogger("eaves")
    logger.handlers[:] = [handler]
    if not verbose:  # the remarks of other libraries are repeated in this package's words where they matter
        warnings.simplefilter("ignore")
        logging.getLogger().handlers[:] = logging.getLogger().handlers or [logging.NullHandler()]
    logger.setLevel(level)
    logging.getLogger("eaves.kernels").setLevel(logging.ERROR)  # `run_display` says it


def start_run_log(quiet: bool, verbose: bool) -> None:
    """Start the log, and import libraries without what they bring along, which would double the start."""
    from eaves.run.workers import import_libraries_alone

    import_libraries_alone()
    start_log(quiet, verbose)


@contextmanager
def run_display(quiet: bool, ground_only: bool = False) -> Iterator[Any]:
    """The progress of a run; in a first run also that of compiling."""
    from eaves.flow.progress import compilation_shown
    from eaves.kernels import FIRST_USE, is_first_use

    compiling = is_first_use()
    if compiling and not quiet:
        typer.echo(FIRST_USE, err=True)
    with (
        progress_display(quiet, compiling, ground_only) as progress,
        compilation_shown(compiling and not quiet, progress),
    ):
        yield progress


def progress_display(quiet: bool, compiling: bool = False, ground_only: bool = False) -> Any:
    """A context manager whose value takes progress: bars on a terminal, plain lines in a log, nothing if
    quiet."""
    from eaves.flow.progress import GROUND_SHARES, SHARES, bars, lines, nothing

    if quiet:
        return nothing()
    show = bars if sys.stderr.isatty() else lines
    return show(compiling, GROUND_SHARES if ground_only else SHARES)


def describe_sources() -> Iterator[str]:
    """Lines on every published system: what it delivers, its paper, and the command that runs it."""
    from eaves.recipe.sources import sources

    for source in sources().values():
        yield f"{source.name}: {source.delivers}"
        yield f"  {source.title} [{source.paper}]"
        yield "  " + ", ".join(f"{stage} {name}" for stage, name in source.methods.items())
        yield f"  eaves build INPUT -o OUT --source {source.name} [--as-published]"


def describe_methods(stage: str | None) -> Iterator[str]:
    """Lines on every method, or on those of one stage with their parameters."""
    from eaves.methods import DEFAULTS, REGISTRY, ContractError, method_class, methods_of

    if stage is not None and stage not in REGISTRY:
        raise ValueError(f"unknown stage '{stage}'; choose one of: {', '.join(REGISTRY)}")
    for name in [stage] if stage else list(REGISTRY):
        yield name
        for method, place in methods_of(name).items():
            try:
                cls = method_class(name, method)
            except (ValueError, ContractError) as error:
                yield f"  {method}: {error}"
                continue
            mark = " (default)" if DEFAULTS[name] == method else ""
            source = cls.paper or place
            yield f"  {method}{mark}: {cls.idea} [{source}]"
            for key, field in cls.model_fields.items() if stage else ():
                extra: Any = field.json_schema_extra or {}
                unit = "" if extra.get("unit") in (None, "1") else f" {extra['unit']}"
                default = "derived" if field.default is None else f"{field.default}{unit}"
                printed = extra.get("published")
                published = "" if printed is None else f"; published {printed}{unit} ({extra['printed_in']})"
                yield f"      {key} = {default}{published}: {field.description}"
