"""The files of a comparison: a layer, a table, and its figures."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.change.epoch import Epoch
from eaves.change.faced import outline_of
from eaves.change.verdict import UNCHANGED, VERDICTS, BuildingChange, Comparison
from eaves.formats import COLUMNS, Row, atomic, write_layers
from eaves.model import Points
from eaves.report import (
    BUILDINGS_SHOWN,
    MILLIMETRES,
    POINTS_SHOWN,
    TERRAIN_CELLS,
    Contents,
    as_millimetres,
    iter_arrays,
    iter_page,
    page_data,
    read_contents,
    say_shown,
    terrain_array,
)

LAYER, TABLE, SUMMARY = "changes.gpkg", "changes.csv", "changes.json"


def write_comparison(comparison: Comparison, folder: Path) -> list[Path]:
    """Write changes.gpkg (layers `changes`, a row a building, and `parts`, where roofs differ), changes.csv
    and changes.json into a folder; the files."""
    paths = [folder / name for name in (LAYER, TABLE, SUMMARY)]
    layers = {"changes": [Row(one.polygon, one.row) for one in comparison.changes]}
    parts = part_rows(comparison)
    layers |= {"parts": parts} if parts else {}
    write_layers(paths[0], layers, comparison.old.system)
    with atomic(paths[1]) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        names = list(comparison.changes[0].row) if comparison.changes else ["id", "change"]
        writer = csv.DictWriter(file, names)
        writer.writeheader()
        writer.writerows(one.row for one in comparison.changes)
    with atomic(paths[2]) as temporary:
        temporary.write_text(
            json.dumps(describe_comparison(comparison), indent=1, allow_nan=False), encoding="utf-8"
        )
    return paths


def part_rows(comparison: Comparison) -> list[Row]:
    """The parts of changed buildings where a roof came, went or moved."""
    spacing = max(comparison.spacings)
    rows = []
    for change in comparison.changes:
        for patch in change.verdict.patches:
            outline = outline_of(patch, spacing)
            if not outline.is_empty:
                values = {"id": change.id, "change": change.verdict.change, "points": len(patch)}
                rows.append(Row(outline, values))
    return rows


def describe_comparison(comparison: Comparison) -> dict[str, Any]:
    """The inputs, settings and results of a comparison, as JSON."""
    shift = comparison.shift
    return {
        "eaves": version("eaves"),
        "old": {"folder": comparison.old.name, "density": round(comparison.densities[0], 2)},
        "new": {"folder": comparison.new.name, "density": round(comparison.densities[1], 2)},
        "crs": comparison.old.system.code,
        "new_against_old_m": {
            "east": round(shift.east, 3),
            "north": round(shift.north, 3),
            "up": round(shift.up, 3),
            "pairs": shift.pairs,
        },
        "noise_m": round(shift.noise, 3),
        "same_within_m": round(comparison.tolerance, 3),
        "counts": comparison.counts,
        "buildings": [change.row for change in comparison.changes],
    }


def as_text(comparison: Comparison) -> str:
    """The closing lines of a comparison."""
    shift, counts = comparison.shift, comparison.counts
    words = ", ".join(f"{counts[name]} {name}" for name in VERDICTS if name in counts)
    changed = sum(one.verdict.change != UNCHANGED for one in comparison.changes)
    lines = [
        f"{len(comparison.changes):,} buildings, {changed:,} changed: {words or 'none'}",
        f"the new epoch lies {shift.east:+.2f} m east, {shift.north:+.2f} m north, {shift.up:+.2f} m up of "
        f"the old one ({shift.pairs:,} pairs, noise {shift.noise:.2f} m) and was moved back; surfaces within "
        f"{comparison.tolerance:.2f} m are the same",
    ]
    return "\n".join(lines)


SHOWN = (
    *("id", "change", "also", "certainty", "reason", "height_difference_m", "volume_difference_m3"),
    *("built_m2", "gone_m2", "moved_m2", "points_old", "points_new"),
)
"""Columns of the table."""


def write_change_page(comparison: Comparison, folder: Path) -> Path:
    """Write changes.html into a folder; its path."""
    path = folder / "changes.html"
    with atomic(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.writelines(iter_change_page(comparison, folder))
    return path


def iter_change_page(comparison: Comparison, folder: Path) -> Iterator[str]:
    """The page piece by piece. A triangle or point names the row of its change and its epoch, 1 or 2."""
    changes = worst_first(comparison.changes)
    drawn, listed = changes[: BUILDINGS_SHOWN // 2], changes[BUILDINGS_SHOWN // 2 :]
    epochs = comparison.old, comparison.new
    places = [{name: place for place, one in enumerate(drawn, 1) for name in one.old_ids}]
    places += [{name: place for place, one in enumerate(drawn, 1) for name in one.new_ids}]
    old, new = (
        read_contents(epoch.folder, points=POINTS_SHOWN // 2, only=ids)
        for epoch, ids in zip(epochs, places, strict=True)
    )
    frame = np.array([*old.origin, old.base])
    about = describe_comparison(comparison)
    page = replace(
        old,
        folder=folder,
        rows=[one.row for one in drawn],
        others=[one.row for one in listed],
        buildings=len(changes),
        run={name: about[name] for name in about if name != "buildings"},
    )
    names = [epoch.folder.resolve().name for epoch in epochs]
    terrain, heights = common_terrain((old, new), epochs, frame)
    arrays: dict[str, NDArray[Any]] = {"terrain": heights}
    parts = [epoch_arrays(*each, frame) for each in zip((old, new), epochs, places, strict=True)]
    for name in parts[0]:
        arrays[name] = np.concatenate([part[name] for part in parts])
    for kind in ("point", "triangle", "edge", "outline"):
        counts = [len(part[f"{kind}_building"]) for part in parts]
        arrays[f"{kind}_epoch"] = np.repeat(np.array([1, 2], np.uint8), counts)
    titles = {name: COLUMNS[name].label for name in SHOWN}
    text = as_text(comparison)
    labels = {
        "title": f"Changes: {names[0]}, {names[1]}",
        "headline": text.split("\n")[0],
        "shown": " | ".join(
            f"{name}: {say_shown(one, 'those that changed most and their surroundings')}"
            for name, one in zip(names, (old, new), strict=True)
        ),
    }
    data = page_data(page, titles) | {"epochs": names, "modelled": False, "terrain": terrain}
    yield from iter_page(page, text, labels, data, arrays.items())


def worst_first(changes: tuple[BuildingChange, ...]) -> list[BuildingChange]:
    """Buildings in order: the changed ones by volume; then the others by distance from the changes'
    middle."""
    if not changes:
        return []
    centres = shapely.get_coordinates(shapely.centroid([change.polygon for change in changes]))
    changed = np.array([change.verdict.change != UNCHANGED for change in changes])
    away = np.hypot(*(centres - np.median(centres[changed] if changed.any() else centres, axis=0)).T)
    rank = np.where(changed, [-abs(change.verdict.volume_m3) for change in changes], away)
    return [changes[place] for place in np.lexsort((rank, ~changed))]


def epoch_arrays(
    contents: Contents, epoch: Epoch, place_of: dict[str, int], frame: Points
) -> dict[str, NDArray[Any]]:
    """The arrays of an epoch's own page, but for its terrain, about the origin of the common one (3,);
    buildings are the places of their changes, from 1."""
    rows = np.array([0, *(place_of[str(row["id"])] for row in contents.rows)], np.uint32)
    arrays: dict[str, NDArray[Any]] = dict(iter_arrays(contents))
    del arrays["terrain"]
    for name, values in arrays.items():
        if name.endswith("_building"):
            arrays[name] = rows[values]
        elif name.endswith("_xyz"):
            world = values.reshape(-1, 3) / MILLIMETRES + [*contents.origin, contents.base]
            world[:, :2] = epoch.plane(world[:, :2], 0)
            arrays[name] = as_millimetres(world - frame).reshape(values.shape)
    return arrays


def common_terrain(
    contents_pair: tuple[Contents, Contents], epochs: tuple[Epoch, Epoch], frame: Points
) -> tuple[dict[str, Any], NDArray[np.int32]]:
    """One grid over the terrains of both epochs as the page describes it, and the heights of each on it."""
    rasters = [
        contents.terrain.with_(
            west=contents.terrain.west + contents.origin[0], north=contents.terrain.north + contents.origin[1]
        )
        for contents in contents_pair
    ]
    areas = [
        epoch.moved(raster.bounds, 0)
        for epoch, raster in zip(epochs, rasters, strict=True)
        if raster.values.size
    ]
    if not areas:
        return {"rows": 0, "columns": 0, "cell": 1.0, "west": 0.0, "north": 0.0}, np.zeros(0, np.int32)
    west, south = min(area.west for area in areas), min(area.south for area in areas)
    east, north = max(area.east for area in areas), max(area.north for area in areas)
    cell = max(max(east - west, north - south) / TERRAIN_CELLS, min(raster.cell for raster in rasters))
    rows, columns = max(1, round((north - south) / cell)), max(1, round((east - west) / cell))
    y, x = np.mgrid[:rows, :columns] + 0.5
    places = np.column_stack([west + cell * x.ravel(), north - cell * y.ravel()])
    heights = np.full((2, rows * columns), np.nan)
    for values, epoch, contents, raster in zip(heights, epochs, contents_pair, rasters, strict=True):
        places_beside = epoch.plane(places, 1)
        inside = (
            raster.bounds.contains(places_beside)
            if raster.values.size
            else np.zeros(len(places_beside), bool)
        )
        values[inside] = raster.at(places_beside[inside]) + contents.base - frame[2]
    corner = {"west": west - frame[0], "north": north - frame[1]}
    return {"rows": rows, "columns": columns, "cell": cell, **corner}, terrain_array(heights)
