"""Footprints and roof planes as GeoPackage, FlatGeobuf or GeoJSON; polygons of any vector file read."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import chain, islice
from math import isfinite
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from eaves.formats.atomic import atomic
from eaves.formats.crs import describe_system, horizontal_crs, parse_crs, system_of
from eaves.formats.errors import InputError
from eaves.formats.points.chunk import FARTHEST
from eaves.formats.qgis.tables import describe_layers
from eaves.formats.vectors.vector_files import OFFLINE, REMEDY, checked_vector
from eaves.model import (
    LOCAL_METRES,
    NOTHING_KNOWN,
    Bounds,
    CoordinateSystem,
    Integers,
    Provenance,
    Rectangle,
)
from eaves.model.columns import COLUMNS, DETAILS, LAYERS

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
BOX_MARGIN = 0.001
"""Share of its side by which a box reprojected through points on its rim is widened: it bends between."""
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
) -> None:
    """Write the layers `footprints`, `roof_planes` and, where they have rows, `review` and `doubts` of a
    GeoPackage, geometry in the system's units; and the table `attributes`, further columns by `id`.

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
    lists = {"review": review, "doubts": doubts}
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
    with atomic(path) as temporary:
        for layer, rows in layers.items():
            _write_layer(temporary, rows, system, "GPKG", layer)
        describe_layers(temporary, system, provenance, note)


def read_upright(path: Path, layer: str, system: CoordinateSystem) -> list[Row]:
    """The features of a layer that a run wrote in a system, with their heights, in world metres; one a part
    of what has several, none where there is no such layer.

    Raises
    ------
    InputError
        When the file is missing or damaged.
    """
    if not path.exists():
        raise InputError.about(path, "does not exist", "give a folder that `eaves build` wrote")
    if layer not in [entry.name for entry in list_vector_layers(path)]:
        return []
    meta, _, wkb, columns = _read_layer(path, layer, None, None)
    shapes = shapely.transform(shapely.from_wkb(wkb), lambda xyz: xyz * system.unit_m, include_z=True)
    return [
        Row(part, row)
        for shape, row in zip(shapes, plain_rows(meta, columns, range(len(shapes))), strict=True)
        for part in (() if shape is None else shapely.get_parts(shape))
    ]


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


def read_polygons(
    path: str | Path,
    layer: str | None = None,
    id_field: str | None = None,
    target: CoordinateSystem | None = None,
    keep_all: bool = False,
    within: Bounds | None = None,
) -> tuple[list[Polygon | MultiPolygon], list[str], list[dict[str, Any]], CoordinateSystem]:
    """The polygons of a vector file in world metres, their ids, their attributes, and their reference system.

    Parameters
    ----------
    path : str or Path
        Shapefile, GeoPackage, GeoJSON, FlatGeobuf or, with pyarrow, GeoParquet; no other driver is used, no
        address reached.
    layer : str or None
        The layer of a file of several; by default its first layer of polygons.
    id_field : str or None
        The field that names the features; by default they are numbered from 1.
    target : CoordinateSystem or None
        The system wanted: polygons in another one are reprojected. When one of the two has no place on Earth,
        both are taken to be the same.
    keep_all : bool
        Keep features without coordinates, too, as empty polygons.
    within : Bounds or None
        Read only features whose boxes meet these bounds (metres of `target`): files of a whole country.

    Returns
    -------
    polygons : list of Polygon or MultiPolygon
        As they are, invalid ones too; features without coordinates are left out, with a warning.
    ids : list of str
        One a polygon.
    attributes : list of dict
        One a polygon.
    system : CoordinateSystem
        `target` when given, else the file's own.

    Raises
    ------
    InputError
        For a missing or unreadable file, a missing layer or field, a layer that holds no polygons.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> from eaves.formats import read_polygons
    >>> from eaves.simulate import write_simulation
    >>> files = write_simulation(truth, "nine")
    >>> polygons, ids, rows, system = read_polygons(files["vectors"], layer="footprints")
    >>> len(polygons), system.horizontal_unit_m
    (9, 1.0)
    """
    path = Path(path)
    if not path.exists():
        raise InputError.about(path, "does not exist", "give a vector file of polygons")
    meta, number, wkb, columns = _read_layer(path, layer, within, target)
    names = [str(name) for name in meta["fields"]]
    if id_field is not None and id_field not in names:
        raise InputError.about(
            path, f"has no field '{id_field}'", f"choose one of: {', '.join(names) or 'none'}"
        )
    # "fix" mends the structure only: it closes rings that a writer left open.
    with np.errstate(invalid="ignore"):  # coordinates that are no numbers are dealt with below
        shapes = shapely.force_2d(shapely.from_wkb(wkb, on_invalid="fix"))
    kinds = {shape.geom_type for shape in shapes if shape is not None}
    if kinds - {"Polygon", "MultiPolygon"}:
        raise InputError.about(
            path, f"holds {', '.join(sorted(kinds))} and must hold polygons", "choose another layer or file"
        )
    placed = [n for n, shape in enumerate(shapes) if _is_placed(shape)]
    if keep_all:
        shapes[[n for n in range(len(shapes)) if n not in set(placed)]] = Polygon()
        placed = list(range(len(shapes)))
    if len(placed) < len(shapes):
        log.warning("%s: %d features without coordinates are left out", path, len(shapes) - len(placed))
    polygons, system = _shapes_in_metres(path, shapes[placed], meta["crs"], target)
    attributes = plain_rows(meta, columns, placed)
    if layer == "footprints":
        details = read_details(path)
        attributes = [row | details.get(row.get("id"), {}) for row in attributes]
    ids = [str(row[id_field] if id_field else number[n]) for n, row in zip(placed, attributes, strict=True)]
    return polygons, ids, attributes, system


@dataclass(frozen=True)
class VectorLayer:
    """A layer of a vector file: its name, the kind of its shapes (empty where it has none), its columns, how
    many features it has, and its reference system."""

    name: str
    kind: str
    columns: tuple[str, ...]
    count: int
    crs: str | None


def list_vector_layers(path: Path) -> list[VectorLayer]:
    """The layers of a vector file.

    Raises
    ------
    InputError
        When it is none that can be read.
    """
    if is_parquet(path):
        from eaves.formats.vectors.parquet import parquet_layer

        return [parquet_layer(path)]
    import pyogrio

    layers = []
    with _opened_vector(path) as (safe, _):
        for name, kind in pyogrio.list_layers(safe):
            info = pyogrio.read_info(safe, layer=name, force_feature_count=True)
            columns = tuple(map(str, info["fields"]))
            layers.append(
                VectorLayer(str(name), str(kind or ""), columns, int(info["features"]), info["crs"])
            )
    return layers


def read_details(path: Path) -> dict[Any, dict[str, Any]]:
    """Id → further columns of a footprint, from the table `attributes` of a run's GeoPackage; empty for
    other files."""
    import pyogrio

    if path.suffix.lower() != ".gpkg" or "attributes" not in pyogrio.list_layers(path)[:, 0]:
        return {}
    return {row["id"]: row for row in read_table(path, "attributes", None) if "id" in row}


def read_table(path: Path, layer: str, columns: Sequence[str] | None) -> list[dict[str, Any]]:
    """Some columns of a layer, or all for None, a row a feature, without shapes."""
    import pyogrio.raw

    with _opened_vector(path) as (safe, _):
        fields = None if columns is None else list(columns)
        meta, _, _, values = pyogrio.raw.read(safe, layer=layer, columns=fields, read_geometry=False)
    return plain_rows(meta, values, range(len(values[0]) if len(values) else 0))


def plain_rows(meta: Mapping[str, Any], columns: Sequence[Any], which: Iterable[int]) -> list[dict[str, Any]]:
    """The rows of these numbers of a layer that pyogrio describes as `meta`, in Python's own types."""
    fields = list(zip(map(str, meta["fields"]), columns, map(str, meta["dtypes"]), strict=True))
    return [{name: plain_value(column[n], kind) for name, column, kind in fields} for n in which]


def is_parquet(path: Path) -> bool:
    """True if a file is Parquet, by its first bytes."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(4) == b"PAR1"


def _read_layer(
    path: Path, layer: str | None, within: Bounds | None, target: CoordinateSystem | None
) -> tuple[dict[str, Any], Integers, NDArray[np.object_], list[Any]]:
    """A layer as pyogrio reads it: its description, the features' numbers from 1, their geometries as WKB
    and their columns."""
    if is_parquet(path):
        from eaves.formats.vectors.parquet import read_geoparquet

        return read_geoparquet(path, lambda crs: _box_in(crs, path, within, target))
    # imported late: it imports geopandas, pandas and pyarrow, 0.4 s and 130 MB that no block needs
    import pyogrio.raw

    refusal = InputError.about(path, "is not a vector file that can be read", REMEDY)
    with _opened_vector(path) as (safe, driver):
        layer = _chosen_layer(path, safe, layer)
        info = pyogrio.read_info(safe, layer=layer, force_feature_count=False)
        if info["driver"] not in (driver, f"{driver}Seq"):
            raise refusal
        box = _box_in(info["crs"], path, within, target)
        meta, fids, wkb, columns = pyogrio.raw.read(safe, layer=layer, bbox=box, return_fids=box is not None)
    if wkb is None:
        raise InputError.about(path, f"layer '{layer}' has no geometry", "choose a layer of polygons")
    if any(len(column) != len(wkb) for column in columns):
        raise refusal
    if fids is None:
        return meta, np.arange(1, len(wkb) + 1), wkb, columns
    order = np.argsort(fids)  # a spatial index answers in an order of its own
    number = np.asarray(fids[order] + (driver != "GPKG"), np.int64)
    return meta, number, wkb[order], [column[order] for column in columns]


@contextmanager
def _opened_vector(path: Path) -> Iterator[tuple[Path, str]]:
    """The file to give to pyogrio, and the driver that must open it; its errors become InputError."""
    import pyogrio
    from pyogrio import errors

    ogr_errors = (
        errors.DataSourceError,
        errors.DataLayerError,
        errors.FeatureError,
        errors.FieldError,
        errors.GeometryError,
    )
    with warnings.catch_warnings():  # GDAL's remarks on single features: those lost are counted later
        warnings.simplefilter("ignore", RuntimeWarning)
        try:
            with checked_vector(path) as (safe, driver):
                pyogrio.set_gdal_config_options(OFFLINE)
                yield safe, driver
        except InputError:
            raise
        except (*ogr_errors, ValueError, IndexError, OverflowError, MemoryError, OSError):
            raise InputError.about(path, "is not a vector file that can be read", REMEDY) from None


def _box_in(
    crs: str | None, path: Path, within: Bounds | None, target: CoordinateSystem | None
) -> Rectangle | None:
    """Bounds in metres of `target` as west, south, east, north in a file's system; None for no bounds."""
    if within is None:
        return None
    unit = 1.0 if target is None else target.horizontal_unit_m
    box = (within.west / unit, within.south / unit, within.east / unit, within.north / unit)
    target_crs = None if target is None else horizontal_crs(target)
    if crs is None or target_crs is None:
        return box
    from pyproj import Transformer

    source = parse_crs(crs, path)
    west, south, east, north = Transformer.from_crs(target_crs, source, always_xy=True).transform_bounds(*box)
    margin = BOX_MARGIN * max(east - west, north - south)
    return west - margin, south - margin, east + margin, north + margin


def _chosen_layer(path: Path, safe: Path, layer: str | None) -> str | None:
    """The layer asked for, which must be there; else the first of polygons, else the first."""
    import pyogrio

    layers = pyogrio.list_layers(safe)
    names = [str(name) for name, _ in layers]
    if layer is not None and layer not in names:
        raise InputError.about(
            path, f"has no layer '{layer}'", f"choose one of: {', '.join(names) or 'none'}"
        )
    polygonal = [str(name) for name, kind in layers if kind is not None and "Polygon" in str(kind)]
    return layer or next(iter(polygonal or names), None)


def _is_placed(shape: BaseGeometry | None) -> bool:
    """True if there is a shape, not an empty one, and all its coordinates are within `FARTHEST`."""
    if shape is None or shape.is_empty:
        return False
    return bool((np.abs(shapely.get_coordinates(shape)) <= FARTHEST[0]).all())  # false for NaN, too


def _shapes_in_metres(
    path: Path, shapes: NDArray[np.object_], crs: str | None, target: CoordinateSystem | None
) -> tuple[list[Polygon | MultiPolygon], CoordinateSystem]:
    source = parse_crs(crs, path) if crs else None
    target_crs = horizontal_crs(target) if target is not None else None
    if source is not None and target_crs is not None:
        from pyproj import Transformer

        if not source.equals(target_crs, ignore_axis_order=True):
            move = Transformer.from_crs(source, target_crs, always_xy=True).transform
            shapes = shapely.transform(shapes, lambda xy: np.column_stack(move(xy[:, 0], xy[:, 1])))
            if not np.isfinite(shapely.get_coordinates(shapes)).all():
                assert target is not None
                raise InputError.about(
                    path,
                    f"cannot be reprojected to {describe_system(target)}",
                    "reproject it, for example with ogr2ogr",
                )
    system = target
    if system is None:
        corners = shapely.bounds(shapes) if len(shapes) else np.zeros((1, 4))
        centre = (float(corners[:, ::2].mean()), float(corners[:, 1::2].mean()))
        system = LOCAL_METRES if source is None else system_of(source, path, centre)
    unit = system.horizontal_unit_m
    return list(shapely.transform(shapes, lambda xy: xy * unit)) if unit != 1.0 else list(shapes), system


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
