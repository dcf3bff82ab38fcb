"""The parts that commands share: configuration, log, progress, exit statuses, and the run itself."""

from __future__ import annotations

import inspect
import re
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, get_type_hints

import typer
from typer.core import TyperCommand

from eaves.extensions import FORMATS, installed

if TYPE_CHECKING:
    from eaves.model.summary import Summary
    from eaves.recipe.recipe import Recipe
    from eaves.run.options import Declared, RunOptions

Inputs = Annotated[
    list[str],
    typer.Argument(
        help="LAS, LAZ, COPC, text, PLY, E57 or VPC files, folders, globs or URLs; or a DSM (GeoTIFF).",
        metavar="INPUT…",
    ),
]
Out = Annotated[Path, typer.Option("--out", "-o", help="Path of the output.", rich_help_panel="output")]
Crs = Annotated[
    str | None, typer.Option(help="EPSG code, compound code (28992+5709), or a WKT or PROJJSON file.")
]
ToCrs = Annotated[
    str | None, typer.Option(help="System to which a build would transform the points, as its `--to-crs`.")
]
Jobs = Annotated[
    int, typer.Option(help="Number of processes; 0: one per core, or one for small data.", min=0)
]
Config = Annotated[
    Path | None,
    typer.Option(help="TOML file with a table per stage: method and parameters.", rich_help_panel="expert"),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="Set a parameter of a stage's method, e.g. detect.min_height=2.5; may be repeated.",
        metavar="STAGE.PARAMETER=VALUE",
        rich_help_panel="methods",
    ),
]
Basemap = Annotated[Path | None, typer.Option(help="Aerial image (GeoTIFF) to drape over the terrain.")]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Show only warnings and errors.", rich_help_panel="run")
]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="Also show debug messages.", rich_help_panel="run")
]
Strict = Annotated[
    bool,
    typer.Option("--strict", help="Exit with status 1 if a building has no model.", rich_help_panel="expert"),
]
DryRun = Annotated[
    bool,
    typer.Option(
        "--dry-run",
        help="Check what a run would, and describe the scan as `eaves info` does; compute and write nothing.",
        rich_help_panel="expert",
    ),
]
Profile = Annotated[
    bool,
    typer.Option("--profile", help="Print the time of each stage.", rich_help_panel="expert"),
]


def with_run_options(
    *left_out: str, required: Sequence[str] = (), flags: Mapping[str, str] | None = None
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A decorator that gives a command all options of a run but some, in its keyword `options`.

    Parameters
    ----------
    left_out
        Keywords of a run that the command settles itself.
    required
        Those that must be given.
    flags
        Other names for some of them.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @wraps(command)
        def whole(**values: Any) -> None:
            options = {}
            for name, one in taken(left_out).items():
                value = given_value(one, values.pop(parameter_name((flags or {}).get(name, one.flag))))
                if value is not None:
                    options[name] = value
            command(**values, options=options)

        def signature() -> inspect.Signature:
            shown = [
                parameter_of(one, (flags or {}).get(name, one.flag), name in required)
                for name, one in taken(left_out).items()
            ]
            hints = get_type_hints(command, localns={"RunOptions": dict}, include_extras=True)
            own = [
                one.replace(annotation=hints[name], kind=inspect.Parameter.KEYWORD_ONLY)
                for name, one in inspect.signature(command).parameters.items()
                if name != "options"
            ]
            first = sum(one.default is inspect.Parameter.empty for one in own)
            return inspect.Signature([*own[:first], *shown, *own[first:]])

        whole.late_signature = signature  # type: ignore[attr-defined]
        return whole

    return decorate


def taken(left_out: Sequence[str]) -> dict[str, Declared]:
    """The options of a run without some."""
    from eaves.run.options import DECLARED

    return {name: one for name, one in DECLARED.items() if name not in left_out}


def with_signature(command: Callable[..., None]) -> Callable[..., None]:
    """The command with the options of a run in its signature: to import what they are takes .3 s."""
    late = getattr(command, "late_signature", None)
    if late is not None:
        signature = command.__signature__ = late()  # type: ignore[attr-defined]
        command.__annotations__ = {one.name: one.annotation for one in signature.parameters.values()}
    return command


def parameter_name(flag: str) -> str:
    """The name of a flag's parameter."""
    return flag.strip("-").replace("-", "_")


def parameter_of(one: Declared, flag: str, required: bool) -> inspect.Parameter:
    """An option of a run as a parameter that typer reads."""
    from eaves.run.options import BROUGHT, DECLARED, METHOD_OPTIONS

    words = re.sub(r"`(\w+)`", lambda found: DECLARED[found[1]].flag if found[1] in DECLARED else found[0],
                   one.option.sentence)  # fmt: skip
    if one.name in METHOD_OPTIONS:
        words = "A method's name, see `eaves methods`, or MODULE:CLASS of another."
        words += " With off, blocks stay whole." if one.name == "units" else ""
    if BROUGHT in words:
        words = words.replace(BROUGHT, "".join(f", {name}" for name in installed(FORMATS)))
    default: Any = one.option.default
    kind: Any = str if "str" in one.words or "Sequence" in one.words else one.kind
    kind, default = (kind, default) if isinstance(default, bool | float | int) else (kind | None, None)
    if "Path" in one.words:
        kind = Path if required else Path | None
    about: Any = typer.Option(flag, help=words, metavar=one.option.metavar, rich_help_panel=one.option.panel)
    if one.name == "jobs":
        default, about.min = 0, 0
    return inspect.Parameter(
        parameter_name(flag),
        inspect.Parameter.KEYWORD_ONLY,
        default=inspect.Parameter.empty if required else default,
        annotation=Annotated[kind, about],
    )


def given_value(one: Declared, value: Any) -> Any:
    """The value of an option as a run takes it."""
    from eaves.run.options import METHOD_OPTIONS

    if value == "":
        return None
    return {"method": value} if one.name in METHOD_OPTIONS and value is not None else value


PANELS = ("input", "methods", "output", "run", "expert")
"""The headings, in their order."""


class PanelledCommand(TyperCommand):
    """A command whose help lists the options that most need first, and experts' last."""

    def __init__(self, *args: Any, **words: Any) -> None:
        text = inspect.cleandoc(words.get("help") or "")
        words["help"] = re.sub(r"\n\n(?=  )", "\n\n\b\n", text)  # \b: lines stay lines
        super().__init__(*args, **words)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Arguments, then options by heading; all under one where none is an expert's."""
        panels: dict[str, list[tuple[str, str]]] = {"arguments": [], **{name: [] for name in PANELS}}
        shown = [(one, one.get_help_record(ctx)) for one in self.get_params(ctx)]
        large = any(getattr(one, "rich_help_panel", None) == PANELS[-1] for one, _ in shown)
        for one, record in shown:
            panel = getattr(one, "rich_help_panel", None) if large else None
            if one.param_type_name == "argument":
                panel = "arguments"
            if record is not None:
                panels.setdefault(panel or "options", []).append(record)
        for name, records in panels.items():
            if records:
                with formatter.section(name.capitalize()):
                    formatter.write_dl(records)


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
    from eaves.recipe.recipe import sources

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
