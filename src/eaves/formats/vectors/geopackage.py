"""Footprints, roof planes and other rows written as GeoPackage, FlatGeobuf, GeoJSON or KML."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import chain, islice
from math import isfinite
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from eaves.formats.columns import COLUMNS, DETAILS, LAYERS
from eaves.formats.crs import horizontal_crs
from eaves.formats.errors import InputError
from eaves.formats.format import Format
from eaves.formats.qgis.tables import describe_layers
from eaves.formats.whole_files import atomic
from eaves.model import (
    LOCAL_METRES,
    NOTHING_KNOWN,
    CoordinateSystem,
    Provenance,
)

log = logging.getLogger("eaves")

DRIVERS = {
    ".gpkg": "GPKG",
    ".fgb": "FlatGeobuf",
    ".geojson": "GeoJSON",
    ".json": "GeoJSON",
    ".kml": "KML",
}
DATASET_OPTIONS = {"GPKG": {"VERSION": "1.3"}, "KML": {"AltitudeMode": "absolute"}}
"""GeoPackage 1.4 makes GDAL 3.6 and QGIS 3.22 warn at every layer."""
GEOJSON_OPTIONS = {"RFC7946": "YES", "COORDINATE_PRECISION": "8"}
"""Eight decimals of a degree are a millimetre."""
UNFORCED = {"OGR_SQLITE_SYNCHRONOUS": "OFF", "OGR_SQLITE_JOURNAL": "MEMORY"}
"""With these SQLite leaves it to `atomic` to bring a file to the disk, once and not step by step."""
PLAIN_TYPES = frozenset((type(None), str, bool, int))
PIECE_ROWS = 20_000
"""Rows of a GeoPackage in memory at a time; the other formats cannot be added to and take all at once."""


@dataclass(frozen=True, eq=False)
class Row:
    """A feature: its geometry in world metres (None for none) and its attributes."""

    geometry: Polygon | MultiPolygon | None
    attributes: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Columns:
    """Rows of footprints with their main columns in the order of the layer, or as a table of the others."""

    rows: Iterable[Row]
    details: bool

    def __iter__(self) -> Iterator[Row]:
        for row in self.rows:
            attributes = row.attributes
            if self.details:
                yield Row(
                    None, {name: attributes.get(name) for name in LAYERS["attributes"] if name in attributes}
                )
            else:
                first = {name: attributes[name] for name in LAYERS["footprints"] if name in attributes}
                remainder = {name: value for name, value in attributes.items() if name not in DETAILS}
                yield Row(row.geometry, first | remainder)


def write_geopackage(
    path: str | Path,
    footprints: Iterable[Row],
    roof_planes: Iterable[Row] = (),
    system: CoordinateSystem = LOCAL_METRES,
    review: Iterable[Row] = (),
    doubts: Iterable[Row] = (),
    provenance: Provenance = NOTHING_KNOWN,
    primitives: Iterable[Row] = (),
) -> None:
    """Write the layers `footprints`, `roof_planes` and, where they have rows, `review`, `doubts` and
    `primitives` of a GeoPackage, geometry in the system's units; and the table `attributes`, further columns
    by `id`.

    A column's type is that of its values: whole numbers, numbers, truth, text; what is missing or NaN is
    null. The columns have the order in which the rows name them first. Styles for QGIS and the columns'
    titles and units are in the file (`eaves.formats.qgis`). Rows are written piece by piece, and
    where there is more than a piece gone through twice: an iterable that makes them anew each time needs the
    memory of one piece.

    Parameters
    ----------
    path : str or Path
        The file (`.gpkg`); it appears when it is whole.
    footprints, roof_planes : iterable of Row
        Geometry in world metres and attributes of each feature; a layer without rows is left out.
    system : CoordinateSystem
        Reference system of the layers.
    review : iterable of Row
        Buildings to review first; a layer of its own where it has rows.
    doubts : iterable of Row
        Places where the scan could not decide, and why; likewise.
    provenance : Provenance
        Data the rows are made from, recorded in the file.
    primitives : iterable of Row
        Parametric houses of which buildings are made; likewise.

    Raises
    ------
    InputError
        When the folder cannot be written.

    Examples
    --------
    >>> import shapely
    >>> from eaves.formats import write_geopackage
    >>> from eaves.formats.crs import parse_crs, system_of
    >>> from eaves.formats.vectors.geopackage import Row
    >>> dutch = system_of(parse_crs("EPSG:28992"), "--crs", (85000.0, 447000.0))
    >>> square = shapely.box(85000, 447000, 85010, 447010)
    >>> write_geopackage("shed.gpkg", [Row(square, {"id": "shed", "area_m2": 100.0})], system=dutch)
    """
    layers: dict[str, Iterable[Row]] = {"footprints": Columns(footprints, False), "roof_planes": roof_planes}
    if any(DETAILS & row.attributes.keys() for row in footprints):
        layers["attributes"] = Columns(footprints, True)
    lists = {"review": review, "doubts": doubts, "primitives": primitives}
    layers |= {layer: rows for layer, rows in lists.items() if list(islice(rows, 1))}
    write_layers(path, layers, system, provenance)


def write_layers(
    path: str | Path,
    layers: Mapping[str, Iterable[Row]],
    system: CoordinateSystem,
    provenance: Provenance = NOTHING_KNOWN,
    note: str = "",
) -> None:
    """Write any layers of a GeoPackage, with the styles and titles that are known for them; `note` is said in
    their descriptions and legends."""
    with atomic(path) as temporary, gdal_options(UNFORCED):
        for layer, rows in layers.items():
            _write_layer(temporary, rows, system, "GPKG", layer)
        describe_layers(temporary, system, provenance, note)


@contextmanager
def gdal_options(options: Mapping[str, str]) -> Iterator[None]:
    """Give GDAL some options until the block ends."""
    import pyogrio  # late: as below

    before = {name: pyogrio.get_gdal_config_option(name) for name in options}
    pyogrio.set_gdal_config_options(options)
    try:
        yield
    finally:
        pyogrio.set_gdal_config_options(before)


def write_polygons(
    path: str | Path,
    rows: Iterable[Row],
    system: CoordinateSystem = LOCAL_METRES,
    layer: str = "footprints",
    provenance: Provenance = NOTHING_KNOWN,
) -> None:
    """Write one layer in the format of the file's extension: .gpkg, .fgb, .geojson.

    GeoJSON is in longitude and latitude (WGS 84) as RFC 7946 has it; a local system has none, and stays as
    it is, with a warning.

    Raises
    ------
    InputError
        For another extension.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in DRIVERS:
        raise InputError.about(path, f"'{suffix}' is no known vector format", f"use {', '.join(DRIVERS)}")
    if DRIVERS[suffix] == "GeoJSON" and system.wkt is None:
        log.warning("%s: the data have no reference system, so they are not in WGS 84; use --crs", path)
    with atomic(path) as temporary:
        _write_layer(temporary, rows, system, DRIVERS[suffix], layer, provenance)
        if suffix == ".kml" and provenance:  # the driver has no place for it
            head, start, tail = temporary.read_text("utf-8").partition("<Schema")
            description = f"<description>{escape(provenance.sentence)}</description>\n"
            temporary.write_text(head + description + start + tail, "utf-8")


@dataclass
class _Schema:
    """The types that all rows of a layer share."""

    kinds: dict[str, set[type]] = field(default_factory=dict)
    """Types of the known values by column, in the order of their coming."""
    several: bool = False
    upright: bool = True
    count: int = 0

    @classmethod
    def of(cls, rows: Iterable[Row]) -> _Schema:
        schema = cls()
        for row in rows:
            schema.count += 1
            schema.several |= row.geometry is not None and row.geometry.geom_type == "MultiPolygon"
            schema.upright &= row.geometry is not None and bool(row.geometry.has_z)
            for name, value in row.attributes.items():
                kinds = schema.kinds.setdefault(name, set())
                if value is not None and type(value) not in kinds:  # those of a layer are few
                    plain = plain_value(value)
                    if plain is not None:
                        kinds.add(type(plain))
        schema.upright &= schema.count > 0
        return schema

    def completed(self, layer: str) -> _Schema:
        """The schema with the types of columns that hold nothing, and of a layer without rows all columns."""
        if not self.count:
            self.kinds |= {name: set() for name in LAYERS.get(layer, ())}
        for name, kinds in self.kinds.items():
            if not kinds and name in COLUMNS:
                kinds.add(COLUMNS[name].kind)
        return self


def append_rows(
    path: Path,
    rows: Sequence[Row],
    system: CoordinateSystem,
    layer: str,
    kinds: Mapping[str, type],
) -> None:
    """Add rows of upright polygons to a layer of a GeoPackage, both made where missing; `kinds` are the types
    of the columns."""
    schema = _Schema({name: {kind} for name, kind in kinds.items()}, several=True, count=len(rows))
    _write_rows(path, rows, schema, system, "GPKG", layer, path.exists())


def _write_layer(
    path: Path,
    rows: Iterable[Row],
    system: CoordinateSystem,
    driver: str,
    layer: str,
    provenance: Provenance = NOTHING_KNOWN,
) -> None:
    waiting = iter(rows)
    first = list(islice(waiting, PIECE_ROWS if driver == "GPKG" else None))
    schema = _Schema.of(chain(first, waiting)).completed(layer)
    _write_rows(path, first, schema, system, driver, layer, path.exists(), provenance)
    waiting = islice(rows, len(first), None) if schema.count > len(first) else iter(())
    while piece := list(islice(waiting, PIECE_ROWS)):
        _write_rows(path, piece, schema, system, driver, layer, append=True)


def _write_rows(
    path: Path,
    rows: Sequence[Row],
    schema: _Schema,
    system: CoordinateSystem,
    driver: str,
    layer: str,
    append: bool,
    provenance: Provenance = NOTHING_KNOWN,
) -> None:
    import pyogrio.raw

    shapes = shapes_in_units(rows, system, schema.upright)
    columns = [
        _column([row.attributes.get(name) for row in rows], kinds) for name, kinds in schema.kinds.items()
    ]
    shape = "LineString" if layer == "contours" else "MultiPolygon" if schema.several else "Polygon"
    with warnings.catch_warnings():  # a local system has no projection; the reader has warned
        warnings.filterwarnings("ignore", message="'crs' was not provided")
        wkt, options = system.wkt, {}
        if driver == "GeoJSON" and wkt is not None:
            plane = horizontal_crs(system)
            wkt, options = plane.to_wkt() if plane else wkt, GEOJSON_OPTIONS
        if driver not in ("GPKG", "KML") and provenance:
            options = {**options, "DESCRIPTION": provenance.sentence}
        pyogrio.raw.write(
            path,
            geometry=None if layer == "attributes" else shapely.to_wkb(shapes) if len(shapes) else shapes,
            field_data=[values for values, _ in columns],
            field_mask=[missing for _, missing in columns],
            fields=np.array(list(schema.kinds), dtype=object),
            layer=layer,
            driver=driver,
            geometry_type=None if layer == "attributes" else shape + (" Z" if schema.upright else ""),
            promote_to_multi=schema.several,
            crs=None if layer == "attributes" else wkt,
            append=append,
            layer_options=options,
            dataset_options=DATASET_OPTIONS.get(driver) if driver != "KML" or schema.upright else None,
        )


def shapes_in_units(rows: Sequence[Row], system: CoordinateSystem, upright: bool) -> NDArray[np.object_]:
    """The shapes of rows (N,) in a system's units, all of them with heights where they are `upright`."""
    shapes = np.array([row.geometry for row in rows] or [], dtype=object)
    if system.unit_m == (1.0, 1.0, 1.0) or not len(shapes):
        return shapes
    unit = np.array(system.unit_m if upright else system.unit_m[:2])
    return np.asarray(shapely.transform(shapes, lambda xyz: xyz / unit, include_z=upright), object)


def column_of(values: list[Any]) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """An array of the one type that holds all values, and where they are missing."""
    return _column(values, {type(plain) for value in values if (plain := plain_value(value)) is not None})


def _column(values: list[Any], kinds: set[type]) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """An array of values, of a column whose known ones have these types, and where they are missing."""
    plain = [plain_value(value) for value in values]
    missing = np.array([value is None for value in plain], bool)
    for allowed, dtype, filler in (
        ({bool}, np.bool_, False),
        ({int}, np.int64, 0),
        ({int, float}, np.float64, 0.0),
    ):
        if kinds and kinds <= allowed:
            return np.array([filler if value is None else value for value in plain], dtype), missing
    return np.array([None if value is None else str(value) for value in plain], dtype=object), missing


def plain_value(value: Any, kind: str = "") -> Any:
    """A Python value; None for NaN and for what is missing.

    `kind` is the column's type: whole numbers and truths come as floats from a column with gaps.
    """
    if type(value) in PLAIN_TYPES:  # most of a layer's values; asked for each of them
        return value
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, float) and not isfinite(value):
        return None
    if isinstance(value, float) and kind == "bool":
        return bool(value)
    return int(value) if isinstance(value, float) and kind.startswith(("int", "uint")) else value


write_roof_planes = partial(write_polygons, layer="roof_planes")
GEOJSON = Format({"footprints": ("footprints.geojson", write_polygons)})
FLATGEOBUF = Format(
    {
        "footprints": ("footprints.fgb", write_polygons),
        "roof_planes": ("roof_planes.fgb", write_roof_planes),
    }
)
