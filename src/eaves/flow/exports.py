"""The formats written on request, by the names of `--formats`.

Each writer is fetched when it is asked for: most runs want none of them.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from shapely import LineString

from eaves import formats
from eaves.formats import InputError, read_polygons
from eaves.formats.atomic import is_full
from eaves.formats.errors import EXTRAS, require_extra
from eaves.formats.inputs import is_classified
from eaves.formats.models.cityjson_read import read_head, read_models, system_of_head
from eaves.formats.vectors.geopackage import Row, write_polygons
from eaves.formats.vectors.polygons import read_upright
from eaves.model import BuildingModel, CoordinateSystem, Failure, Provenance
from eaves.model.checks import check_positive
from eaves.model.columns import LAYERS
from eaves.run.manifest import add_to_manifest, files_of_run, read_manifest, set_aside, work_of_persons

log = logging.getLogger("eaves")
Writer = Callable[..., object]


def citygml3_writer() -> Writer:
    """The writer of CityGML 3.0, which has no name among the public ones."""
    from eaves.formats.models.citygml import write_citygml3

    return write_citygml3


def ifc_writer() -> Writer:
    """The writer of IFC 4, likewise."""
    from eaves.formats.models.ifc import write_ifc

    return write_ifc


FOOTPRINT_FILES: dict[str, tuple[Callable[[], Writer], str]] = {
    "geojson": (lambda: write_polygons, "footprints.geojson"),
    "fgb": (lambda: write_polygons, "footprints.fgb"),
    "parquet": (lambda: formats.write_geoparquet, "footprints.parquet"),
    "kml": (lambda: write_polygons, "footprints.kml"),
}
ROOF_FILES: dict[str, tuple[Callable[[], Writer], str]] = {
    "fgb": (lambda: partial(write_polygons, layer="roof_planes"), "roof_planes.fgb"),
    "parquet": (lambda: formats.write_geoparquet, "roof_planes.parquet"),
    "kml": (lambda: partial(write_polygons, layer="roof_planes"), "roof_planes.kml"),
}
MODEL_FILES: dict[str, tuple[Callable[[], Writer], str]] = {
    "cityjson": (lambda: formats.write_cityjson, "buildings.city.json"),
    "obj": (lambda: formats.write_obj, "buildings.obj"),
    "dxf": (lambda: formats.write_dxf, "roofs.dxf"),
    "glb": (lambda: formats.write_glb, "buildings.glb"),
    "gpkg": (lambda: formats.write_lod_layers, "buildings.gpkg"),
    "citygml": (lambda: formats.write_citygml, "buildings.gml"),
    "citygml3": (citygml3_writer, "buildings3.gml"),
    "ifc": (ifc_writer, "buildings.ifc"),
    "3dtiles": (lambda: formats.write_3dtiles, "3dtiles"),
}

OUTPUT_FILES = {
    "footprints": ("footprints.gpkg", "review.csv", "primitives.csv", "buildings.qgz"),
    "models": ("buildings.city.jsonl",),
    "mask": ("mask.tif", "mask.vrt"),
    "rasters": ("dtm.tif", "dsm.tif", "ndsm.tif", "dtm.vrt", "dsm.vrt", "ndsm.vrt"),
    "report": ("report.html",),
    "steps": ("steps",),
}
"""Files, and folders of files, of each output; those of classified points follow from the inputs."""
TILES = "tiles"
"""Folder of the files of rasters too large for one, tile by tile."""
COPC = "copc"
"""A file beside each of the classified points."""


def check_formats(
    names: Sequence[str], outputs: Sequence[str] = ("footprints", "models", "classified")
) -> None:
    """Check that every name is one of a format that can be written here, beside the `outputs` of the run.

    Raises
    ------
    ValueError
        For an unknown name, a format whose library is missing, or one of what is not among the outputs.
    """
    choices = [*MODEL_FILES, *FOOTPRINT_FILES, COPC]
    for name in names:
        if name not in choices:
            raise ValueError(f"--formats {name}: unknown format; choose among: {', '.join(choices)}")
        needed = "models" if name in MODEL_FILES else "classified" if name == COPC else "footprints"
        if needed not in outputs:
            raise ValueError(f"--formats {name}: it follows from {needed}; add {needed} to --outputs")
    for extra in [extra for extra in EXTRAS if extra in names]:
        require_extra(extra)


def planned_names(outputs: Sequence[str], names: Sequence[str]) -> set[str]:
    """Names in a run's folder of the files and folders that its outputs and formats are, but for classified
    points."""
    return files_of_formats(names) | {name for output in outputs for name in OUTPUT_FILES.get(output, ())}


def files_of_formats(names: Sequence[str]) -> set[str]:
    """Names of the files and folders of some formats, but for classified points."""
    tables = (FOOTPRINT_FILES, ROOF_FILES, MODEL_FILES)
    planned = {file for table in tables for name, (_, file) in table.items() if name in names}
    return planned | ({"buildings.mtl"} if "obj" in names else set())


def classified_name(path: Path, alone: bool, taken: set[str]) -> str:
    """Name of the classified copy of an input; files of one name from two folders get a number behind, also
    where names differ by case only, which is none on many disks. A name too long for a disk is cut."""
    inner = path.stem[:-5] if path.stem.lower().endswith(".copc") else path.stem  # what is written is none
    stem = "classified" if alone else f"classified_{inner}"
    stem = os.fsdecode(os.fsencode(stem)[:LONGEST_NAME])
    number = 1
    while (name := stem if number == 1 else f"{stem}-{number}").casefold() in taken:
        number += 1
    taken.add(name.casefold())
    return f"{name}.laz"


LONGEST_NAME = 200
"""Bytes of 255, so that a number, a suffix and the folder of the file in the making have room."""


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
    sources_of = {
        "buildings.city.jsonl": (MODEL_FILES, sources),
        table.name: (FOOTPRINT_FILES, table.exists()),
        "classified points": ((COPC,), points),
    }
    for file, (choices, exists) in sources_of.items():
        if not set(names).isdisjoint(choices) and not exists:
            raise InputError.about(folder, f"holds no {file}", "build again with that output")
    planned = files_of_formats(names)
    in_the_way = (path for path, _ in work_of_persons(folder, planned))
    set_aside(folder, [path for path in in_the_way if path.relative_to(folder).parts[0] in planned])
    head = read_head(sources[0]) if sources else {}
    made_from, written = Provenance.of(head.get("metadata")), []
    system_of_models = system_of_head(head, sources[0]) if sources else None
    if set(names) & MODEL_FILES.keys():
        assert system_of_models is not None
        few = sum(path.stat().st_size for path in sources) <= HELD_BYTES
        models = list(models_of(sources)) if few else []
        written += export_table(
            folder,
            MODEL_FILES,
            lambda: iter(models or models_of(sources)),
            system_of_models,
            names,
            made_from,
        )
    if set(names) & FOOTPRINT_FILES.keys():
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
    from eaves.formats.rasters.geotiff import read_raster
    from eaves.raster.contours import trace_contours

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


@contextmanager
def noted_failure(
    name: str, failed: list[str] | None, raised: tuple[type[Exception], ...] = (InputError,)
) -> Iterator[None]:
    """Note in `failed` that a file could not be written, so that the others of a run are. Without such a list
    its error is raised, as are those that are to end a run: `raised` (an input changed), a full disk, no
    memory."""
    try:
        yield
    except Exception as error:
        if failed is None or isinstance(error, (MemoryError, *raised)) or is_full(error):
            raise
        failed.append(f"{name}: not written ({type(error).__name__}: {error})")
        log.error("%s", failed[-1], exc_info=log.isEnabledFor(logging.DEBUG))


def export_footprints(
    folder: Path,
    rows: Iterable[Row],
    roofs: Iterable[Row],
    system: CoordinateSystem,
    names: Sequence[str],
    provenance: Provenance,
    failed: list[str] | None = None,
) -> list[Path]:
    """Write the footprints, and the roof planes, in the formats named; the files written."""
    tables = ((FOOTPRINT_FILES, rows), (ROOF_FILES, roofs))
    files = (
        export_table(folder, table, partial(in_order, layer), system, names, provenance, failed)
        for table, layer in tables
    )
    return list(chain.from_iterable(files))


def export_table(
    folder: Path,
    table: Mapping[str, tuple[Callable[[], Writer], str]],
    content: Callable[[], Iterable[Any]],
    system: CoordinateSystem,
    names: Sequence[str],
    provenance: Provenance,
    failed: list[str] | None = None,
) -> list[Path]:
    """Write a content, made anew for each, in those formats of a table that are named; the files written, for
    3D Tiles the tileset."""
    written = []
    for name, (writer, file) in table.items():
        if name not in names:
            continue
        with noted_failure(file, failed):
            writer()(folder / file, content(), system, provenance=provenance)
            written.append(folder / file / "tileset.json" if name == "3dtiles" else folder / file)
            written += [folder / "buildings.mtl"] if name == "obj" else []
    return written


def export_points(
    files: Iterable[Path],
    system: CoordinateSystem | None,
    names: Sequence[str],
    failed: list[str] | None = None,
) -> list[Path]:
    """Write each of the classified points as COPC, where that is named; the files written."""
    if COPC not in names:
        return []
    from eaves.formats.points.copc_writer import write_copc

    written = []
    for path in files:
        copy = path.with_suffix(".copc.laz")
        with noted_failure(copy.name, failed):
            written += [copy] if write_copc(path, copy, system) else []
    return written


def in_order(rows: Iterable[Row]) -> list[Row]:
    """Rows with the columns of all layers in the order of their declaration, others behind them."""
    declared = list(chain(*LAYERS.values()))
    attributes = ((row.geometry, dict(row.attributes)) for row in rows)
    return [
        Row(geometry, {name: values[name] for name in declared if name in values} | values)
        for geometry, values in attributes
    ]
