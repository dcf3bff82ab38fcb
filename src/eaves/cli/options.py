"""The options of the commands: those of a run as `eaves.run.options` declares them, and what only a command
line has; and the help that lists them."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer
from typer.core import TyperCommand

from eaves.extensions import FORMATS, installed

if TYPE_CHECKING:
    from eaves.run.options import Declared

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
SourceName = Annotated[
    str | None, typer.Option(help="Run a complete published system; see `eaves methods --sources`.")
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
