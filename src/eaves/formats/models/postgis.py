"""A run's results as plain PostGIS tables, by psycopg, which the extra `postgis` installs.

`footprints` and `roof_planes` are the layers of footprints.gpkg, `surfaces` a row for each surface of each
building at each level of detail. Geometry is in the run's own reference system and unit; columns have their
meaning as comments.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from eaves.formats.crs import horizontal_crs, parse_crs, system_of
from eaves.formats.errors import InputError, require_extra
from eaves.formats.models.cityjson_read import iter_cityjson
from eaves.formats.vectors.geopackage import PIECE_ROWS, plain_rows, read_details
from eaves.model import LOCAL_METRES, CoordinateSystem
from eaves.model.columns import COLUMNS

TYPES = {"bool": "boolean", "int": "bigint", "float": "double precision"}
"""Of columns, by the beginning of numpy's name; the rest is text."""
SURFACES = {"id": "text", "lod": "text", "surface": "text"}
GEOMETRY = {"footprints": "geometry(Geometry,{0})", "roof_planes": "geometry(PolygonZ,{0})"}
SURFACE_GEOMETRY = "geometry(MultiPolygonZ,{0})"


def write_postgis(
    folder: str | Path, address: str, schema: str = "eaves", replace: bool = False
) -> dict[str, int]:
    """Write what a run's folder holds into a database, all or nothing; the number of rows by table.

    Parameters
    ----------
    folder : str or Path
        The folder that `eaves build` wrote.
    address : str
        `postgresql://user@host:port/database`; the extension postgis is made when it is missing.
    schema : str
        Where the tables go; made when missing.
    replace : bool
        Whether tables that are there already are made anew.

    Returns
    -------
    dict of str to int
        The number of rows by table.

    Raises
    ------
    InputError
        When psycopg is missing, the folder holds no run, the database cannot be reached, or has the tables.

    Examples
    --------
    >>> from eaves.formats import write_postgis
    >>> write_postgis("out", "postgresql://me@localhost/city")  # doctest: +SKIP
    {'footprints': 24, 'roof_planes': 1039, 'surfaces': 288}
    """
    require_extra("postgis")
    import psycopg
    from psycopg import sql

    place = Path(folder)
    if not (place / "footprints.gpkg").exists():
        raise InputError.about(place, "holds no footprints.gpkg", "give the folder of a run of eaves build")
    counts: dict[str, int] = {}
    try:
        with psycopg.connect(address) as connection, connection.cursor() as cursor:
            cursor.execute("CREATE EXTENSION IF NOT EXISTS postgis")
            cursor.execute(sql.SQL("CREATE SCHEMA IF NOT EXISTS {}").format(sql.Identifier(schema)))
            for table, columns, geometry, rows in tables_of(place):
                name = sql.Identifier(schema, table)
                if replace:
                    cursor.execute(sql.SQL("DROP TABLE IF EXISTS {} CASCADE").format(name))
                kinds = {column: sql.SQL(kind) for column, kind in columns.items()}
                kinds["geom"] = sql.SQL(geometry)
                listed = [
                    sql.SQL("{} {}").format(sql.Identifier(column), kind) for column, kind in kinds.items()
                ]
                cursor.execute(sql.SQL("CREATE TABLE {} ({})").format(name, sql.SQL(", ").join(listed)))
                names = sql.SQL(", ").join(map(sql.Identifier, kinds))
                counts[table] = 0
                with cursor.copy(sql.SQL("COPY {} ({}) FROM STDIN").format(name, names)) as copy:
                    for row in rows:
                        copy.write_row(row)
                        counts[table] += 1
                cursor.execute(sql.SQL("CREATE INDEX ON {} USING gist (geom)").format(name))
                for column in columns.keys() & COLUMNS.keys():
                    about = COLUMNS[column]
                    text = f"{about.title}: {about.meaning}" + (f" ({about.unit})" if about.unit else "")
                    comment = sql.SQL("COMMENT ON COLUMN {}.{} IS {}")
                    cursor.execute(comment.format(name, sql.Identifier(column), sql.Literal(text)))
    except psycopg.errors.DuplicateTable:
        raise InputError(
            f"{schema}: the schema has these tables already; add --replace, or name another --schema"
        ) from None
    except psycopg.Error as error:
        raise InputError(f"{hidden(address)}: {' '.join(str(error).split())}") from None
    return counts


def hidden(address: str) -> str:
    """The address without a password."""
    head, _, tail = address.rpartition("@")
    start, _, user = head.rpartition("//")
    return f"{start}//{user.split(':')[0]}@{tail}" if head else address


Table = tuple[str, dict[str, str], str, Iterator[Sequence[Any]]]


def tables_of(folder: Path) -> Iterator[Table]:
    """Name, columns with types, type of the geometry and rows of each table."""
    import pyogrio

    path = folder / "footprints.gpkg"
    system, code = LOCAL_METRES, 0
    for layer, geometry in GEOMETRY.items():
        about = pyogrio.read_info(path, layer=layer)
        if about["crs"] and system is LOCAL_METRES:
            system = system_of(parse_crs(about["crs"]), path, (0.0, 0.0))
            plane = horizontal_crs(system)
            code = (plane.to_epsg() or 0) if plane is not None else 0
        fields = list(zip(about["fields"], about["dtypes"], strict=True))
        details = read_details(path) if layer == "footprints" else {}
        if details:
            more = pyogrio.read_info(path, layer="attributes")
            fields += [one for one in zip(more["fields"], more["dtypes"], strict=True) if one[0] != "id"]
        columns = {
            str(name): next((kind for start, kind in TYPES.items() if str(dtype).startswith(start)), "text")
            for name, dtype in fields
        }
        rows = layer_rows(path, layer, about["features"], code, details, list(columns))
        yield layer, columns, geometry.format(code), rows
    models = folder / "buildings.city.jsonl"
    if models.exists():
        yield "surfaces", SURFACES, SURFACE_GEOMETRY.format(code), surface_rows(models, system, code)


def layer_rows(
    path: Path, layer: str, count: int, code: int, details: dict[Any, dict[str, Any]], names: Sequence[str]
) -> Iterator[Sequence[Any]]:
    """The rows of a layer, piece by piece, with their `details` by id: columns of these names, the geometry
    last."""
    import pyogrio.raw

    for first in range(0, count, PIECE_ROWS):
        meta, _, wkb, columns = pyogrio.raw.read(
            path, layer=layer, skip_features=first, max_features=PIECE_ROWS
        )
        shapes = as_ewkb(shapely.from_wkb(wkb), code)
        for shape, row in zip(shapes, plain_rows(meta, columns, range(len(shapes))), strict=True):
            row |= details.get(row.get("id"), {})
            yield [*map(row.get, names), shape]


def surface_rows(path: Path, system: CoordinateSystem, code: int) -> Iterator[Sequence[Any]]:
    """A row for each kind of surface of each solid, in the system's unit, under the building's id."""
    unit = np.array(system.unit_m)
    for found in iter_cityjson(path):
        vertices = found.vertices / unit
        for geometry in found.geometries:
            if not geometry.is_solid:
                continue
            by_kind: dict[str, list[Polygon]] = {}
            for shells in geometry.solids:
                for face in shells[0]:
                    rings = [vertices[list(ring)] for ring in face.rings]
                    by_kind.setdefault(face.surface, []).append(Polygon(rings[0], rings[1:]))
            name = found.parents[0] if found.parents else found.id
            for kind, polygons in by_kind.items():
                yield [name, geometry.lod, kind, as_ewkb([MultiPolygon(polygons)], code)[0]]


def as_ewkb(shapes: Any, code: int) -> list[str | None]:
    """Geometries as the hexadecimal text that PostGIS reads."""
    placed = shapely.set_srid(np.asarray(shapes, dtype=object), code)
    return list(shapely.to_wkb(placed, hex=True, include_srid=True))
