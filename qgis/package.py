"""Makes the forms of the plug-in from the commands and the registry, and the ZIP that QGIS installs.

python -m qgis.package            forms.json only
python -m qgis.package dist       and dist/eaves-qgis-VERSION.zip; after dist the address of the repository
                                  and an email, without which the plug-in site takes none
"""

from __future__ import annotations

import html
import inspect
import json
import sys
import zipfile
from importlib.metadata import version
from pathlib import Path
from typing import Any, get_args, get_origin

from typer.models import ArgumentInfo

from eaves.change.command import compare
from eaves.cli import app as compute
from eaves.cli import results
from eaves.cli.runs import with_signature
from eaves.exports.command import export
from eaves.methods import DEFAULTS, REGISTRY, Method, method_class, methods_of
from eaves.solar.command import solar

PLUGIN = Path(__file__).parent / "eaves"
FIXED_DATE = (1980, 1, 1, 0, 0, 0)
EVERYTHING = ["FOOTPRINTS", "ROOF_PLANES", "DTM", "DSM", "MASK", "MODELS", "REPORT", "PROJECT"]
COMMANDS = {
    "build": ("Build footprints and 3D models", EVERYTHING),
    "reconstruct": ("Model given footprints", EVERYTHING),
    "detect": ("Detect buildings", ["FOOTPRINTS", "MASK", "PROJECT"]),
    "ground": ("Classify ground", []),
}
"""The commands that are tools, with title and outputs."""
ON_RESULTS = {
    "validate": (results.validate, "Validate results", []),
    "export": (export, "Export results", ["CONTOURS"]),
    "solar": (solar, "Sunlight on roofs", ["SOLAR"]),
    "compare": (compare, "Compare two epochs", ["CHANGE"]),
    "update": (
        compute.update,
        "Update results with new points",
        ["FOOTPRINTS", "ROOF_PLANES", "MODELS", "PROJECT"],
    ),
}
"""The commands that begin with the folder of a run, likewise."""
OF_STAGE = {
    "ground": "ground",
    "detect": "detect",
    "outline": "detect",
    "units": "build",
    "roof": "build",
    "reconstruct": "build",
}
"""The command that shows what a method of each stage does."""
KINDS = {
    "crs": "crs", "bounds": "extent", "clip": "polygons", "footprints": "polygons",
    "party_walls": "polygons", "id_field": "field", "config": "file", "reference": "file", "weather": "file",
}  # fmt: skip
CHOICES = {"lod": ["0", "1.2", "1.3", "2.0", "2.2", "2.3"]}
LEFT_OUT = {
    "out",
    "inputs",
    "quiet",
    "verbose",
    "settings",
    "methods",
    "scheduler",
    "resume",
    "strict",
    "per_tile",
    "help",
    "site",
    "basemap",
    "edits",
}
"""Options that a tool has no use for, or gives itself."""
BASIC = {"footprints", "id_field", "crs", "bounds", "lod", "use_classes", "method"}


def make_forms() -> dict[str, Any]:
    """All tools: the commands, and every method with its parameters."""
    commands = {name: with_signature(getattr(compute, name)) for name in COMMANDS}
    options = {
        name: list(inspect.signature(command).parameters.values()) for name, command in commands.items()
    }
    tools = []
    for name, (title, outputs) in COMMANDS.items():
        fields = [field_of(option, name) for option in options[name] if option.name not in LEFT_OUT]
        text = inspect.getdoc(commands[name]) or ""
        tools.append(tool(name, title, "Runs", text, name, fields, outputs))
    for name, (command, title, outputs) in ON_RESULTS.items():
        given = inspect.signature(command, eval_str=True).parameters.values()
        fields = [field_of(option, name) for option in given if option.name not in LEFT_OUT - {"inputs"}]
        made = tool(name, title, "Results", inspect.getdoc(command) or "", name, fields, outputs)
        tools.append(made | {"points": False, "out": name in ("compare", "update")})
    for stage, methods in ((stage, methods_of(stage)) for stage in REGISTRY):
        for name in methods:
            cls = method_class(stage, name)
            command = OF_STAGE[stage]
            common = [
                field_of(option, command)
                for option in options[command]
                if option.name in ("crs", "bounds", "clip", "use_classes", "jobs")
            ]
            made = tool(
                f"{stage}_{name}",
                f"{stage.capitalize()}: {name.replace('_', ' ')}",
                f"Methods of {stage}",
                cls.idea,
                command,
                [*parameters_of(cls), *common],
                COMMANDS[command][1],
            )
            flag = "--method" if command == stage else "--units" if stage == "units" else f"--{stage}-method"
            made |= {"stage": stage, "method": name, "always": [flag, name], "help": help_of(cls)}
            tools.append(made)
    return {"tools": tools}


def tool(
    name: str,
    title: str,
    group: str,
    text: str,
    command: str,
    fields: list[dict[str, Any]],
    outputs: list[str],
) -> dict[str, Any]:
    """One tool's form; the examples of the command line are left out of its text."""
    text = text.split("\n\nExamples:")[0]
    return {
        "name": name,
        "title": title,
        "group": group,
        "summary": text,
        "help": f"<p>{html.escape(text)}</p>",
        "command": command,
        "always": [],
        "points": True,
        "out": True,
        "fields": fields,
        "outputs": outputs,
    }


def field_of(option: inspect.Parameter, command: str) -> dict[str, Any]:
    """The field of one option of a command."""
    annotation, about = get_args(option.annotation)[:2]
    name, default = option.name, option.default
    kind, choices = KINDS.get(name, "text"), CHOICES.get(name)
    types = get_args(annotation) if get_origin(annotation) else (annotation,)
    if name.endswith("method"):
        stage = command if name == "method" else name.removesuffix("_method")
        choices, default = list(methods_of(stage)), DEFAULTS[stage]
    elif name == "units":
        choices, default = [*methods_of(name), "off"], DEFAULTS[name]
    if choices:
        kind = "choice"
    elif bool in types:
        kind = "flag"
    elif int in types or float in types:
        kind = "integer" if int in types else "number"
    long = [word for word in about.param_decls or () if word.startswith("--")]
    named: str | None = long[0] if long else "--" + name.replace("_", "-")
    if isinstance(about, ArgumentInfo):
        kind, named = "points" if name == "inputs" else "folder", None
    return {
        "name": name,
        "option": named,
        "key": name,
        "kind": kind,
        "title": words_of(name),
        "help": about.help or "",
        "default": str(default)
        if kind != "flag" and default not in (None, inspect.Parameter.empty)
        else None,
        "choices": choices,
        "min": about.min,
        "max": about.max,
        "of": "footprints" if kind == "field" else None,
        "advanced": named is not None and name not in BASIC,
    }


def words_of(name: str) -> str:
    """`id_field` as `Id field`."""
    return name.replace("_", " ").capitalize().replace("Crs", "Reference system").replace("Lod", "LoD")


def parameters_of(cls: type[Method]) -> list[dict[str, Any]]:
    """The fields of a method's parameters."""
    fields = []
    for name, field in cls.model_fields.items():
        if isinstance(field.default, Method):  # its own parameters stand in its own tool
            continue
        extra: Any = field.json_schema_extra or {}
        unit = "" if extra.get("unit") in (None, "1") else f" ({extra['unit']})"
        limits = {key: value for one in field.metadata for key in ("ge", "gt", "le", "lt")
                  if (value := getattr(one, key, None)) is not None}  # fmt: skip
        kind = kind_of(field.annotation)
        fields.append(
            {
                "name": f"parameter_{name}",
                "option": None,
                "key": name,
                "kind": kind,
                "title": words_of(name) + unit,
                "help": field.description or "",
                "default": None if field.default is None else json.dumps(field.default),
                "choices": ["true", "false"] if kind == "choice" else None,
                "min": limits.get("ge", limits.get("gt")),
                "max": limits.get("le", limits.get("lt")),
                "of": None,
                "advanced": False,
            }
        )
    return fields


def kind_of(annotation: Any) -> str:
    """How a parameter of this type is asked for; several values and words as TOML."""
    text = str(annotation)
    if "tuple" in text or "list" in text:
        return "text"
    if "bool" in text:
        return "choice"
    return "number" if "float" in text else "integer" if "int" in text else "text"


def help_of(cls: type[Method]) -> str:
    """The docstring of a method down to its parameters, as HTML."""
    text = inspect.cleandoc(cls.__doc__ or cls.idea).split("\nParameters\n")[0]
    paragraphs = "".join(f"<p>{html.escape(part)}</p>" for part in text.split("\n\n"))
    return f"{paragraphs}<p>After {html.escape(cls.paper)}.</p>"


def as_text(forms: dict[str, Any]) -> str:
    """The forms as they stand in forms.json."""
    return json.dumps(forms, indent=0, ensure_ascii=False) + "\n"


def metadata(address: str, email: str) -> str:
    """metadata.txt with what only a release has: version, and where its makers are reached."""
    facts = {"version": version("eaves"), "email": email, "homepage": address, "repository": address}
    facts["tracker"] = f"{address}/issues" if address else ""
    text = (PLUGIN / "metadata.txt").read_text("utf-8")
    return text + "".join(f"{name}={value}\n" for name, value in facts.items())


def write_plugin(folder: Path, address: str = "", email: str = "") -> Path:
    """Write the ZIP; the same sources give the same bytes."""
    path = folder / f"eaves-qgis-{version('eaves')}.zip"
    folder.mkdir(parents=True, exist_ok=True)
    sources = sorted(file for file in PLUGIN.iterdir() if file.is_file())
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in [*sources, PLUGIN.parents[1] / "LICENSE"]:
            entry = zipfile.ZipInfo(f"eaves/{file.name}", FIXED_DATE)
            published = file.name == "metadata.txt"
            content = metadata(address, email).encode() if published else file.read_bytes()
            archive.writestr(entry, content, zipfile.ZIP_DEFLATED)
    return path


if __name__ == "__main__":
    (PLUGIN / "forms.json").write_text(as_text(make_forms()), encoding="utf-8")
    if sys.argv[1:]:
        print(write_plugin(Path(sys.argv[1]), *sys.argv[2:]))
