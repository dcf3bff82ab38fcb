"""The page of a run of any size as a folder for any web server: the report's own scene, loaded by squares.

Far away a building is a box. `city/boxes.json` has those of all buildings and the terrain, `city/rows.json`
the table, and `city/<number>.json` what the report embeds, of one square: models, points, outlines, terrain.
"""

from __future__ import annotations

import json
import math
import re
import shutil
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from eaves.formats import InputError, read_polygons
from eaves.formats.whole_files import atomic
from eaves.model import LODS, Bounds, Integers, Values
from eaves.report.contents import (
    Contents,
    base_of,
    lay_image,
    middle_of,
    read_terrain,
    system_of_folder,
    terrain_file,
)
from eaves.report.page_file import (
    as_millimetres,
    describe_terrain,
    iter_arrays,
    iter_data,
    iter_page,
    page_data,
    terrain_array,
)
from eaves.report.sample import Sample, classified_files, sample_points
from eaves.report.view import describe_run, refuse_no_run
from eaves.run.manifest import add_to_manifest, read_facts

SQUARE = 480.0
"""Side (m) of the squares, fixed to the world."""
SITE_POINTS = 6_000_000
"""More points are thinned over the whole run."""
SITE, CHUNKS = "site", "city"
FLAT = 0.2
"""Height (m) of the box of a building without a model."""
STEP = 0.1
"""The boxes' corners are rounded to this (m): nobody sees it from afar, and it halves the file."""
OPEN_FILES = 64
"""Models are dealt out to so many squares at a time."""
FEATURE_ID = re.compile(r'"id":\s*("(?:[^"\\]|\\.)*")')

Shape: TypeAlias = Polygon | MultiPolygon
Rows = list[dict[str, Any]]


def write_site(folder: str | Path, target: str | Path, basemap: str | Path | None = None) -> Path:
    """Write the page of a run and its squares into a folder for any web server; the path of the page.

    Raises
    ------
    InputError
        When the folder holds no run, `target` is it, or the image is none of it.
    """
    folder, target = Path(folder), Path(target)
    refuse_no_run(folder)
    if target.resolve() == folder.resolve():
        raise InputError.about(target, "is the folder of the run", "give another one to --site")
    polygons, _, rows, system = read_polygons(folder / "footprints.gpkg", layer="footprints")
    system = system_of_folder(folder, named=False) or system
    terrain, bounds = read_terrain(terrain_file(folder), system, None)
    sample = sample_points(classified_files(folder), system, SITE_POINTS, bounds)
    frame = Contents(
        folder=target,
        origin=middle_of(bounds, polygons, sample),
        base=base_of(terrain, sample),
        system=system,
        buildings=len(rows),
        basemap=None if basemap is None else lay_image(folder, basemap, system, bounds),
        run=read_facts(folder),
    )
    overview = frame.filled([], [], None, Sample.empty(), terrain, bounds)
    squares = squares_of(polygons)
    shutil.rmtree(target / CHUNKS, ignore_errors=True)
    (target / CHUNKS).mkdir(parents=True)
    lods = {0}
    with tempfile.TemporaryDirectory(dir=target) as workplace:
        square_models = split_models(folder / "buildings.city.jsonl", rows, squares, Path(workplace))
        square_points = split_points(sample, rows, squares)
        for number, (corner, members) in enumerate(squares.items()):
            part = frame.filled(
                [rows[k] for k in members],
                [polygons[k] for k in members],
                square_models[number],
                sample.take(square_points[number]),
                *read_terrain(terrain_file(folder), system, square_bounds(corner)),
            )
            lods.update(part.faces.lod.tolist())
            about = {"terrain": describe_terrain(part.terrain)}
            write_json(target / CHUNKS / f"{number}.json", about, square_arrays(part, members))
    write_json(
        target / CHUNKS / "boxes.json",
        {"buildings": len(rows)},
        box_arrays(overview, polygons, rows, squares),
    )
    data = page_data(replace(overview, others=rows)) | {
        "modelled": True,
        "city": {
            "folder": CHUNKS,
            "squares": [local_square(corner, len(members), frame) for corner, members in squares.items()],
        },
    }
    write_json(target / CHUNKS / "rows.json", data.pop("others"))
    labels = {
        "heading": f"{len(rows):,} buildings",
        "shown": f"{len(sample):,} of {sample.total:,} points; buildings far away are boxes",
    }
    text = describe_run(folder)
    with atomic(target / "index.html") as temporary, temporary.open("w", encoding="utf-8") as file:
        file.writelines(iter_page(overview, text, labels, data | {"others": None}, (), lods))
    return target / "index.html"


def open_site(folder: str | Path, again: bool = False, basemap: str | Path | None = None) -> Path:
    """The site in the folder of a run; made when missing, older than the run, `again` or with an image."""
    folder = Path(folder)
    refuse_no_run(folder)
    page = folder / SITE / "index.html"
    if again or basemap or not page.exists() or page.stat().st_mtime < modified(folder):
        write_site(folder, page.parent, basemap)
        add_to_manifest(folder, [page, *(page.parent / CHUNKS).iterdir()])
    return page.parent


def modified(folder: Path) -> float:
    """The time of a run's footprints."""
    return (folder / "footprints.gpkg").stat().st_mtime


def write_json(path: Path, data: dict[str, Any], arrays: Iterable[tuple[str, NDArray[Any]]] = ()) -> None:
    """Write data with arrays as the page embeds them."""
    with path.open("w", encoding="utf-8") as file:
        file.writelines(iter_data(data, arrays))


def squares_of(polygons: Sequence[Shape]) -> dict[tuple[int, int], list[int]]:
    """The numbers of the polygons whose middle lies in each square, by the squares' column and row."""
    squares: dict[tuple[int, int], list[int]] = defaultdict(list)
    for number, (x, y) in enumerate(shapely.get_coordinates(shapely.centroid(polygons))):
        squares[math.floor(x / SQUARE), math.floor(y / SQUARE)].append(number)
    return dict(sorted(squares.items()))


def square_bounds(corner: tuple[int, int]) -> Bounds:
    """World metres of a square."""
    column, row = corner
    return Bounds(column * SQUARE, row * SQUARE, (column + 1) * SQUARE, (row + 1) * SQUARE)


def local_square(corner: tuple[int, int], buildings: int, frame: Contents) -> list[float]:
    """West, south, east and north of a square about the origin, and its number of buildings."""
    local = square_bounds(corner).translated(-frame.origin[0], -frame.origin[1])
    return [local.west, local.south, local.east, local.north, buildings]


def split_models(
    models: Path, rows: Rows, squares: Mapping[tuple[int, int], list[int]], workplace: Path
) -> list[Path | None]:
    """The models of each square in a file of its own, or None where the run has none."""
    if not models.exists():
        return [None] * len(squares)
    square_of = {
        str(rows[k]["id"]): number for number, members in enumerate(squares.values()) for k in members
    }
    paths = [workplace / f"{number}.city.jsonl" for number in range(len(squares))]
    for first in range(0, len(paths), OPEN_FILES):
        with ExitStack() as stack:
            source = stack.enter_context(models.open(encoding="utf-8"))
            head = source.readline()
            batch = paths[first : first + OPEN_FILES]
            files = [stack.enter_context(path.open("w", encoding="utf-8")) for path in batch]
            for file in files:
                file.write(head)
            for line in source:
                named = FEATURE_ID.search(line)
                number = square_of.get(json.loads(named[1]), -1) - first if named else -1
                if 0 <= number < len(files):
                    files[number].write(line)
    return list(paths)


def split_points(sample: Sample, rows: Rows, squares: Mapping[tuple[int, int], list[int]]) -> list[Integers]:
    """The numbers of the points of each square: those of its buildings, and others that lie in it."""
    numbers = {corner: number for number, corner in enumerate(squares)}
    lowest = np.floor(sample.xyz[:, :2] / SQUARE).astype(np.int64)
    corners, place = np.unique(lowest, axis=0, return_inverse=True)
    square_of_corner = np.array([numbers.get((int(x), int(y)), -1) for x, y in corners], np.int64)
    square = square_of_corner[place.ravel()] if len(corners) else np.zeros(0, np.int64)
    most = max([int(row.get("number") or 0) for row in rows] + [int(sample.building.max(initial=0))])
    of_building = np.full(most + 1, -1, np.int64)
    for number, members in enumerate(squares.values()):
        of_building[[int(rows[k].get("number") or 0) for k in members]] = number
    of_building[0] = -1
    square = np.where(of_building[sample.building] >= 0, of_building[sample.building], square)
    order = np.argsort(square, kind="stable")
    ends = np.searchsorted(square[order], np.arange(len(squares) + 1))
    return [order[start:end] for start, end in pairwise(ends.tolist())]


def square_arrays(part: Contents, members: Sequence[int]) -> Iterator[tuple[str, NDArray[Any]]]:
    """The arrays of a square's own page, its buildings numbered from 1 among all."""
    numbers = np.array([0, *(k + 1 for k in members)], np.uint32)
    for name, values in iter_arrays(part):
        yield name, numbers[values] if name.endswith("_building") else values


def box_arrays(
    overview: Contents, polygons: Sequence[Shape], rows: Rows, squares: Mapping[tuple[int, int], list[int]]
) -> Iterator[tuple[str, NDArray[Any]]]:
    """Of every building the box around its outline, (B, 4, 2), its lowest and highest place (B, 2), its level
    of detail and its square; and the terrain."""
    around = shapely.minimum_rotated_rectangle(np.array(polygons, object))
    corners = np.zeros((len(polygons), 4, 2))
    square = np.zeros(len(polygons), np.uint16)
    for number, box in enumerate(around.tolist()):
        ring = shapely.get_coordinates(box)[:4]
        corners[number, : len(ring)] = ring - overview.origin
        corners[number, len(ring) :] = ring[-1] - overview.origin
    for number, members in enumerate(squares.values()):
        square[members] = number
    yield "box_xy", as_millimetres(np.round(corners / STEP) * STEP)
    yield "box_z", as_millimetres(np.round(box_heights(rows, overview.base) / STEP) * STEP)
    yield "box_lod", np.array([LODS.index(str(row.get("lod") or "0")) for row in rows], np.uint8)
    yield "box_square", square
    yield "terrain", terrain_array(overview.terrain.values)


def box_heights(rows: Rows, base: float) -> Values:
    """Lowest and highest place (B, 2) of buildings over `base` (m)."""
    ground = np.array([row.get("h_ground") or base for row in rows], np.float64) - base
    height = np.array([row.get("measuredHeight") or FLAT for row in rows], np.float64)
    return np.column_stack([ground, ground + np.maximum(height, FLAT)])
