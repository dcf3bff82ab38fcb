"""One parameter of one method over a range of values, each run held against a reference: table and plot."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eaves.evaluate import Evaluation, evaluate_files
from eaves.methods import make_method, method_class
from eaves.pipeline import build
from eaves.recipe.sources import find_source
from eaves.run.options import RunOptions

COMPARISONS = {
    "ground": ("ground", "classified.laz", ("classified",)),
    "detect": ("detection", "mask.tif", ("footprints", "mask", "classified")),
    "outline": ("footprints", "footprints.gpkg", ("footprints",)),
    "roof": ("models", "buildings.city.jsonl", ("footprints", "models")),
    "reconstruct": ("models", "buildings.city.jsonl", ("footprints", "models")),
}
"""Stage → what is evaluated, the file that is held against the reference, the outputs that are written."""
MOST_PANELS = 9
"""More measures are not drawn; the table has them all."""
Row = dict[str, Any]


def sweep(
    inputs: str | Path | Sequence[str | Path],
    out: str | Path,
    parameter: str,
    values: Sequence[Any],
    reference: str | Path,
    *,
    method: str | None = None,
    source: str | None = None,
    options: RunOptions | None = None,
) -> list[Row]:
    """One row a value: the value and every figure of its run, also written as a table and a plot.

    Parameters
    ----------
    inputs
        As for `eaves.build`; where the reference is a cloud, one file.
    out
        Folder for `sweep.csv`, `sweep.md`, `sweep.png`, and a folder for each run.
    parameter
        Stage and parameter: `detect.max_rmse`.
    values
        What the parameter takes; the method's default is run first, unless it is among them.
    reference
        What `eaves evaluate` takes for the stage: a classified cloud, polygons, models.
    method
        Name of the stage's method; by default the source's, or the default.
    source
        A published system whose chain the other stages take.
    options
        Further options of the runs.

    Returns
    -------
    list of dict
        In the order of the values.

    Raises
    ------
    ValueError
        When the stage, the method or the parameter does not exist, or a value is out of its range.

    Examples
    --------
    >>> from eaves.report.sweep import parse_values
    >>> parse_values("0.1:0.3:3")
    [0.1, 0.2, 0.3]
    """
    stage, _, key = parameter.partition(".")
    if stage not in COMPARISONS or not key:
        raise ValueError(
            f"'{parameter}' is not a parameter; write STAGE.PARAMETER with one of: {', '.join(COMPARISONS)}"
        )
    name = method or (find_source(source).methods.get(stage) if source else None)
    cls = method_class(stage, make_method(stage, name).name)
    default = make_method(stage, name).model_dump().get(key)
    for value in values:
        make_method(stage, name, {key: value})  # says what is wrong before anything is computed
    what, result, outputs = COMPARISONS[stage]
    rows = []
    folder = Path(out)
    for value in [default, *(value for value in values if value != default)]:
        given = {} if value is default else {key: value}
        place = folder / (
            "default" if value is default else f"{value:g}" if is_numeric(value) else str(value)
        )
        chosen: Any = {**(options or {}), "source": source, "outputs": outputs}
        chosen[stage] = {"method": cls.name, **given}
        if what != "models":
            chosen["lod"] = "0"
        build(inputs, place, **chosen)
        found = evaluate_files(what, place / result, Path(reference))
        rows.append(
            {key: "derived" if value is None else value, "is default": value is default, **numbers_of(found)}
        )
    rows.sort(key=lambda row: row[key] if is_numeric(row[key]) else -np.inf)
    write_table(folder, parameter, cls.name, rows, key)
    draw(folder / "sweep.png", f"{stage}/{cls.name}: {key}", key, rows)
    return rows


def is_numeric(value: object) -> bool:
    """Whether a value has a place on an axis."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def parse_values(text: str) -> list[Any]:
    """The values of `0.1,0.2,0.5` or, evenly spread, of `FIRST:LAST:COUNT`.

    Parameters
    ----------
    text
        Numbers, true, false or words.

    Returns
    -------
    list

    Raises
    ------
    ValueError
        When nothing is there, or a range is not two numbers and a count.

    Examples
    --------
    >>> from eaves.report.sweep import parse_values
    >>> parse_values("4,8,true")
    [4, 8, True]
    """
    if ":" in text:
        try:
            first, last, count = text.split(":")
            return [round(float(value), 9) for value in np.linspace(float(first), float(last), int(count))]
        except ValueError:
            raise ValueError(f"--values {text}: not FIRST:LAST:COUNT") from None
    values = []
    for word in filter(None, (part.strip() for part in text.split(","))):
        try:
            values.append(json.loads(word))
        except json.JSONDecodeError:
            values.append(word)
    if not values:
        raise ValueError("--values: none is given; write 0.1,0.2 or FIRST:LAST:COUNT")
    return values


def numbers_of(evaluation: Evaluation) -> Row:
    """The figures of an evaluation that are numbers."""
    return {name: value for name, value in evaluation.figures.items() if is_numeric(value)}


def write_table(folder: Path, parameter: str, method: str, rows: list[Row], key: str) -> None:
    """`sweep.csv` with everything, and `sweep.md` with what changes."""
    columns = list(rows[0])
    with (folder / "sweep.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)
    shown = [key, *changing(rows, key)]
    text = [f"# {parameter} of {method}", "", "| " + " | ".join(shown) + " |", "|" + "---|" * len(shown)]
    for row in rows:
        cells = [f"{row[name]:.4g}" if is_numeric(row[name]) else str(row[name]) for name in shown]
        cells[0] += " (default)" if row["is default"] else ""
        text.append("| " + " | ".join(cells) + " |")
    (folder / "sweep.md").write_text("\n".join(text) + "\n", encoding="utf-8")


def changing(rows: list[Row], key: str) -> list[str]:
    """The measures that differ between rows."""
    names = [name for name in rows[0] if name not in (key, "is default")]
    return [name for name in names if len({row.get(name) for row in rows}) > 1]


def draw(path: Path, title: str, key: str, rows: list[Row]) -> None:
    """The changing measures over the parameter, a panel each; shares first."""
    from matplotlib.figure import Figure

    names = changing(rows, key)
    shares = [name for name in names if all(0.0 <= float(row[name]) <= 1.0 for row in rows)]
    names = [*shares, *(name for name in names if name not in shares)][:MOST_PANELS]
    columns = min(3, max(1, len(names)))
    lines = -(-max(1, len(names)) // columns)
    figure = Figure(figsize=(3.4 * columns, 2.4 * lines + 0.4), layout="constrained")
    panels = np.atleast_1d(figure.subplots(lines, columns)).ravel()
    sets = [row for row in rows if row[key] != "derived"]
    places = [row[key] if is_numeric(row[key]) else number for number, row in enumerate(sets)]
    for panel in panels[len(names) :]:
        panel.set_axis_off()
    for panel, name in zip(panels, names, strict=False):
        heights = [float(row[name]) for row in sets]
        panel.plot(places, heights, "o-", color="0.25", markersize=3.5)
        for row, place, height in zip(sets, places, heights, strict=True):
            if row["is default"]:
                panel.plot([place], [height], "o", color="tab:red")
        for row in rows:
            if row[key] == "derived":
                panel.axhline(float(row[name]), color="tab:red", linewidth=0.8)
        panel.set_title(name, fontsize=9)
        panel.set_xlabel(key, fontsize=8)
        panel.tick_params(labelsize=8)
        panel.grid(alpha=0.3)
    figure.suptitle(f"{title} (red: default)", fontsize=10)
    figure.savefig(path, dpi=150)
