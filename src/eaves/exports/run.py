"""Formats of a finished run, and lines of one height of its ground, written from its files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path

import numpy as np
from shapely import LineString

from eaves.flow import (
    check_formats,
    export_content,
    export_footprints,
    export_points,
    files_of_formats,
    format_of,
)
from eaves.formats import (
    InputError,
    Row,
    is_classified,
    read_head,
    read_models,
    read_polygons,
    read_upright,
    system_of_head,
    write_polygons,
)
from eaves.model import BuildingModel, Failure, Provenance
from eaves.model.checks import check_positive
from eaves.run import add_to_manifest, files_of_run, read_manifest, set_aside, work_of_persons

HELD_BYTES = 32_000_000
"""The models of so many bytes are held while all formats are written; more are decoded for each of them."""


def models_of(sources: Iterable[Path]) -> Iterator[BuildingModel | Failure]:
    """The models of some files, one after the other."""
    return chain.from_iterable(map(read_models, sources))


def export_run(folder: Path, names: Sequence[str]) -> list[Path]:
    """Write formats of a finished run from its files, without its points; the files written.

    Coordinates are those of `buildings.city.jsonl` and `footprints.gpkg`. The manifest lists the new files.

    Raises
    ------
    InputError
        When the folder holds no complete run, or lacks the files that a format follows from.
    ValueError
        For an unknown name, or a format whose library is missing.
    """
    check_formats(names)
    about = read_manifest(folder)
    if not about["complete"]:
        raise InputError.about(folder, "holds a run that did not end", "run eaves build again with --resume")
    sources, table = files_of_run(folder, "buildings.city.jsonl"), folder / "footprints.gpkg"
    points = [folder / name for name in about["written"] if is_classified(name)]
    wanted = set(chain.from_iterable(format_of(name).files for name in names))
    sources_of = {
        "models": ("buildings.city.jsonl", sources),
        "footprints": (table.name, table.exists()),
        "points": ("classified points", points),
    }
    for content, (file, exists) in sources_of.items():
        if content in wanted and not exists:
            raise InputError.about(folder, f"holds no {file}", "build again with that output")
    planned = files_of_formats(names)
    in_the_way = (path for path, _ in work_of_persons(folder, planned))
    set_aside(folder, [path for path in in_the_way if path.relative_to(folder).parts[0] in planned])
    head = read_head(sources[0]) if sources else {}
    made_from, written = Provenance.of(head.get("metadata")), []
    system_of_models = system_of_head(head, sources[0]) if sources else None
    if "models" in wanted:
        assert system_of_models is not None
        few = sum(path.stat().st_size for path in sources) <= HELD_BYTES
        models = list(models_of(sources)) if few else []
        written += export_content(
            folder,
            "models",
            lambda: iter(models or models_of(sources)),
            system_of_models,
            names,
            made_from,
        )
    if "footprints" in wanted:
        shapes, _, values, system = read_polygons(table, layer="footprints", keep_all=True)
        rows = [
            Row(None if shape.is_empty else shape, row) for shape, row in zip(shapes, values, strict=True)
        ]
        roofs = read_upright(table, "roof_planes", system)
        written += export_footprints(folder, rows, roofs, system, names, made_from)
    written += export_points(points, system_of_models, names)
    add_to_manifest(folder, written)
    return written


def write_contours(folder: Path, interval: float) -> Path:
    """Write lines of one height of a finished run's dtm.tif, one each `interval` (m), to contours.gpkg.

    Raises
    ------
    InputError
        When the folder holds no dtm.tif.
    ValueError
        When the interval is not above 0.
    """
    from eaves.formats import read_raster
    from eaves.raster import trace_contours

    check_positive(interval, "--contours")
    read_manifest(folder)
    if not (folder / "dtm.tif").exists():
        raise InputError.about(folder, "holds no dtm.tif", "build again with --outputs rasters")
    terrain, system = read_raster(folder / "dtm.tif")
    levels = interval * np.arange(*np.floor(np.nanquantile(terrain.values, [0, 1]) / interval + [1, 2]))
    rows = (
        Row(
            LineString(np.vstack([contour.xy, contour.xy[:1]]) if contour.closed else contour.xy),
            {"height_m": contour.level},
        )
        for contour in trace_contours(terrain, np.round(levels, 6))
        if len(contour.xy) > 2
    )
    write_polygons(folder / "contours.gpkg", list(rows), system, layer="contours")
    add_to_manifest(folder, [folder / "contours.gpkg"])
    return folder / "contours.gpkg"
