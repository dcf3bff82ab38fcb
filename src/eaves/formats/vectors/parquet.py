"""Footprints as GeoParquet 1.1, written and read by pyarrow, which the extra `parquet` installs."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from eaves.formats.crs import horizontal_crs
from eaves.formats.errors import InputError
from eaves.formats.format import Format
from eaves.formats.vectors.geopackage import Row, column_of, shapes_in_units
from eaves.formats.vectors.vector_files import VectorLayer
from eaves.formats.whole_files import atomic
from eaves.model import LOCAL_METRES, NOTHING_KNOWN, CoordinateSystem, Provenance, Rectangle

VERSION = "1.1.0"
ROWS_A_GROUP = 50_000
"""Rows of a row group: a reader of one window reads only the groups whose boxes it touches."""


DEGREES = "OGC:CRS84"
"""The system of a file that names none."""


def write_geoparquet(
    path: str | Path,
    rows: Sequence[Row],
    system: CoordinateSystem = LOCAL_METRES,
    provenance: Provenance = NOTHING_KNOWN,
) -> None:
    """Write one row a feature: its attributes, `geometry` (WKB in the system's units) and `bbox`.

    Columns have the types that `write_geopackage` gives them.

    Parameters
    ----------
    path : str or Path
        The file (`.parquet`); it appears when it is whole.
    rows : sequence of Row
        Geometry in world metres and attributes of each feature.
    system : CoordinateSystem
        Reference system of the file.
    provenance : Provenance
        Data the models are made from, recorded in the file.

    Raises
    ------
    InputError
        When pyarrow is not installed, or the folder cannot be written.

    Examples
    --------
    >>> import shapely
    >>> from eaves.formats import write_geoparquet
    >>> from eaves.formats.vectors.geopackage import Row
    >>> square = shapely.box(85000, 447000, 85010, 447010)
    >>> write_geoparquet("shed.parquet", [Row(square, {"id": "shed", "area_m2": 100.0})])
    """
    FORMAT.require()
    import pyarrow
    import pyarrow.parquet

    upright = all(row.geometry is not None and row.geometry.has_z for row in rows)
    shapes = shapes_in_units(rows, system, upright)
    columns: dict[str, Any] = {}
    for name in dict.fromkeys(name for row in rows for name in row.attributes):
        values, missing = column_of([row.attributes.get(name) for row in rows])
        kind = pyarrow.string() if values.dtype == object else None
        columns[name] = pyarrow.array(values, type=kind, mask=missing)
    corners = shapely.bounds(shapes).reshape(-1, 4)
    names = ("xmin", "ymin", "xmax", "ymax")
    boxes = [pyarrow.array(corners[:, axis], from_pandas=True) for axis in range(4)]
    columns["bbox"] = pyarrow.StructArray.from_arrays(boxes, names)
    columns["geometry"] = pyarrow.array(list(shapely.to_wkb(shapes)), pyarrow.binary())
    about = geo_metadata(shapes, corners, system)
    tags = {name.encode(): text.encode() for name, text in provenance.tags.items()}
    table = pyarrow.table(columns).replace_schema_metadata({b"geo": json.dumps(about).encode(), **tags})
    with atomic(path) as temporary:
        pyarrow.parquet.write_table(table, temporary, compression="zstd", row_group_size=ROWS_A_GROUP)


def geo_metadata(
    shapes: np.ndarray[Any, Any], corners: np.ndarray[Any, Any], system: CoordinateSystem
) -> dict[str, Any]:
    """The `geo` entry of the file's metadata, after the specification."""
    crs = horizontal_crs(system)
    column: dict[str, Any] = {
        "encoding": "WKB",
        "geometry_types": sorted(
            {shape.geom_type + " Z" * shape.has_z for shape in shapes if shape is not None}
        ),
        "crs": None if crs is None else crs.to_json_dict(),
        "covering": {"bbox": {name: ["bbox", name] for name in ("xmin", "ymin", "xmax", "ymax")}},
    }
    if len(corners) and not np.isnan(corners).all():
        low, high = np.nanmin(corners[:, :2], axis=0), np.nanmax(corners[:, 2:], axis=0)
        column["bbox"] = [*low.tolist(), *high.tolist()]
    return {"version": VERSION, "primary_column": "geometry", "columns": {"geometry": column}}


def parquet_layer(path: Path) -> VectorLayer:
    """The one layer of a GeoParquet file.

    Raises
    ------
    InputError
        When pyarrow is missing, or the file has no shapes.
    """
    with opened_parquet(path) as (file, about, crs):
        names = [name for name in file.schema_arrow.names if name not in (about["primary_column"], "bbox")]
        kinds = about["columns"][about["primary_column"]].get("geometry_types") or ["Polygon"]
        return VectorLayer(path.stem, ", ".join(kinds), tuple(names), file.metadata.num_rows, crs)


def read_geoparquet(
    path: Path, box_in: Callable[[str | None], Rectangle | None]
) -> tuple[dict[str, Any], np.ndarray[Any, Any], np.ndarray[Any, Any], list[Any]]:
    """A GeoParquet file as pyogrio reads a layer: description, numbers of the rows from 1, shapes as WKB,
    columns.

    `box_in` gives the box wanted in the file's system, or None for all of it. Row groups outside it are not
    read where the file has a column `bbox`. Lists and structures become JSON.

    Raises
    ------
    InputError
        When pyarrow is missing, or the file has no shapes as WKB.
    """
    import pyarrow
    import pyarrow.compute as compute
    import pyarrow.parquet

    with opened_parquet(path) as (file, about, crs):
        place, box, rows = about["primary_column"], box_in(crs), None
        schema = file.schema_arrow
        if box is not None and "bbox" in schema.names and pyarrow.types.is_struct(schema.field("bbox").type):
            west, south, east, north = box
            rows = (
                (compute.field("bbox", "xmin") <= east)
                & (compute.field("bbox", "xmax") >= west)
                & (compute.field("bbox", "ymin") <= north)
                & (compute.field("bbox", "ymax") >= south)
            )
        table = pyarrow.parquet.read_table(path, filters=rows, partitioning=None)
    wkb = np.array(table.column(place).to_pylist() or [], dtype=object)
    number = np.arange(1, len(wkb) + 1)
    if box is not None and rows is None and len(wkb):
        inside = shapely.intersects(shapely.from_wkb(wkb, on_invalid="ignore"), shapely.box(*box))
        number, wkb, table = number[inside], wkb[inside], table.filter(pyarrow.array(inside))
    names = [name for name in table.column_names if name not in (place, "bbox")]
    columns = [plain_column(table.column(name)) for name in names]
    return {"fields": names, "dtypes": ["object"] * len(names), "crs": crs}, number, wkb, columns


def plain_column(column: Any) -> np.ndarray[Any, Any]:
    """A column's values; lists and structures as JSON."""
    values = np.empty(len(column), dtype=object)
    values[:] = [
        json.dumps(value, ensure_ascii=False, default=str) if isinstance(value, list | dict) else value
        for value in column.to_pylist()
    ]
    return values


@contextmanager
def opened_parquet(path: Path) -> Iterator[tuple[Any, dict[str, Any], str | None]]:
    """The file, its `geo` entry, and its reference system as text (None where it says there is none)."""
    FORMAT.require()
    import pyarrow
    import pyarrow.parquet

    refusal = InputError.about(path, "is not GeoParquet with WKB geometry", "write it anew with GDAL")
    try:
        with pyarrow.parquet.ParquetFile(path) as file:
            about = json.loads((file.schema_arrow.metadata or {})[b"geo"])
            column = about["columns"][about["primary_column"]]
            if column["encoding"] != "WKB" or about["primary_column"] not in file.schema_arrow.names:
                raise refusal
            crs = column.get("crs", DEGREES)
            yield (
                file,
                about,
                None if crs is None else crs if isinstance(crs, str) else json.dumps(crs),
            )
    except (pyarrow.ArrowException, KeyError, TypeError, ValueError, OSError) as error:
        if isinstance(error, InputError):
            raise
        raise refusal from None


FORMAT = Format(
    {
        "footprints": ("footprints.parquet", write_geoparquet),
        "roof_planes": ("roof_planes.parquet", write_geoparquet),
    },
    extra=("parquet", "pyarrow", "GeoParquet needs pyarrow"),
)
