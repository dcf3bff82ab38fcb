"""Polygons and tables of vector files, read."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from eaves.formats.crs import horizontal_crs, parse_crs, system_of
from eaves.formats.errors import InputError
from eaves.formats.points.chunk import FARTHEST
from eaves.formats.vectors.geopackage import Row, plain_value
from eaves.formats.vectors.vector_files import OFFLINE, REMEDY, VectorLayer, checked_vector, has_word
from eaves.model import LOCAL_METRES, Bounds, CoordinateSystem, Integers, Rectangle

log = logging.getLogger("eaves")

ALONE, BESIDE = (".gpkg", ".json", ".geojson", ".fgb", ".parquet", ".kml"), ("-wal",)
"""Suffixes of maps that are one file, and what may be added to their names for changes that are not in it."""
DEGREES = np.array([180.0, 90.0, 180.0, 90.0])
"""The largest longitude and latitude."""
BOX_MARGIN = 0.001
"""Share of its side by which a box reprojected through points on its rim is widened: it bends between."""


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
    ids = [
        text_of(row[id_field] if id_field else number[n]) for n, row in zip(placed, attributes, strict=True)
    ]
    return polygons, ids, attributes, system


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


def list_vector_layers(path: Path) -> list[VectorLayer]:
    """The layers of a vector file. A file that did not change since is not parsed again: GeoJSON is whole.

    Raises
    ------
    InputError
        When it is none that can be read.
    """
    read = _layers_of if path.suffix.lower() in ALONE else _layers_of.__wrapped__
    return list(read(path, tuple(map(_state_of, (path, *(Path(f"{path}{end}") for end in BESIDE))))))


def _state_of(path: Path) -> tuple[int, ...]:
    """What changes with a file; nothing where there is none."""
    try:
        state = path.stat()
    except OSError:
        return ()
    return state.st_dev, state.st_ino, state.st_size, state.st_mtime_ns, state.st_ctime_ns


@lru_cache(maxsize=8)
def _layers_of(path: Path, mark: tuple[tuple[int, ...], ...]) -> tuple[VectorLayer, ...]:
    """The layers of a vector file in a state that the `mark` says."""
    if is_parquet(path):
        from eaves.formats.vectors.parquet import parquet_layer

        return (parquet_layer(path),)
    import pyogrio

    layers = []
    with _opened_vector(path) as (safe, _):
        for name, kind in pyogrio.list_layers(safe):
            info = pyogrio.read_info(safe, layer=name, force_feature_count=True)
            columns, count = tuple(map(str, info["fields"])), int(info["features"])
            layers.append(
                VectorLayer(str(name), str(kind or ""), columns, count, stated_crs(path, safe, info))
            )
    return tuple(layers)


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


def text_of(value: Any) -> str:
    """A value as text: whole numbers without point, nothing for what is missing."""
    if value is None:
        return ""
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    return str(value).strip()


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
        crs = stated_crs(path, safe, info)
        box = _box_in(crs, path, within, target)
        meta, fids, wkb, columns = pyogrio.raw.read(safe, layer=layer, bbox=box, return_fids=box is not None)
        meta["crs"] = crs
    if wkb is None:
        raise InputError.about(path, f"layer '{layer}' has no geometry", "choose a layer of polygons")
    if any(len(column) != len(wkb) for column in columns):
        raise refusal
    if fids is None:
        return meta, np.arange(1, len(wkb) + 1), wkb, columns
    order = np.argsort(fids)  # a spatial index answers in an order of its own
    number = np.asarray(fids[order] + (driver != "GPKG"), np.int64)
    return meta, number, wkb[order], [column[order] for column in columns]


def stated_crs(path: Path, safe: Path, info: Mapping[str, Any]) -> str | None:
    """The reference system that a layer states, which pyogrio describes as `info`. GDAL takes GeoJSON without
    one for degrees; where its numbers are none, it states nothing."""
    import pyogrio

    if not str(info["driver"]).startswith("GeoJSON") or has_word(path, b'"crs"'):
        return info["crs"]  # type: ignore[no-any-return]
    bounds = pyogrio.read_info(safe, layer=info["layer_name"], force_total_bounds=True)["total_bounds"]
    return None if bounds is not None and (np.abs(bounds) > DEGREES).any() else info["crs"]


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


def placing_remedy(path: Path, code: str = "EPSG:CODE") -> str:
    """What gives a map its system, by its code."""
    copy, file = quote(f"{path.stem}_placed{path.suffix}"), quote(str(path))
    return f"give it its own with GDAL: ogr2ogr -a_srs {code} {copy} {file}"


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
    if source is None and target is not None:
        log.info("%s: states no reference system, and is taken to be in that of the points", path)
    if source is not None and target_crs is not None:
        from pyproj import Transformer

        if not source.equals(target_crs, ignore_axis_order=True):
            move = Transformer.from_crs(source, target_crs, always_xy=True).transform
            shapes = shapely.transform(shapes, lambda xy: np.column_stack(move(xy[:, 0], xy[:, 1])))
            if not np.isfinite(shapely.get_coordinates(shapes)).all():
                raise InputError.about(
                    path,
                    f"states {source.name}, and its numbers cannot be of that system",
                    placing_remedy(path),
                )
    system = target
    if system is None:
        corners = shapely.bounds(shapes) if len(shapes) else np.zeros((1, 4))
        centre = (float(corners[:, ::2].mean()), float(corners[:, 1::2].mean()))
        system = LOCAL_METRES if source is None else system_of(source, path, centre)
    unit = system.horizontal_unit_m
    return list(shapely.transform(shapes, lambda xy: xy * unit)) if unit != 1.0 else list(shapes), system
