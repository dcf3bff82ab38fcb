"""Vector files as GDAL may open them: formats that hold their data themselves, and lead nowhere else.

GDAL chooses among eighty drivers by a file's content. Some follow names of other files, addresses on the
network or commands in it, so content is looked at first.
"""

from __future__ import annotations

import json
import mmap
import re
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from eaves.formats.errors import InputError

KNOWN = {
    b"\x00\x00\x27\x0a": "ESRI Shapefile",
    b"fgb\x03": "FlatGeobuf",
    b"SQLite format 3\0": "GPKG",
}
"""Driver by the first bytes; GeoJSON begins with an object."""
REMEDY = (
    "give a shapefile (.shp), GeoPackage, GeoJSON or FlatGeobuf; unzip an archive, and convert other formats "
    "with ogr2ogr: ogr2ogr map.gpkg FILE"
)
OWN_TABLES = ("rtree", "fts", "virtualspatialindex", "virtualelementary", "virtualknn")
"""Modules of virtual tables that read no other file; the last ones are SpatiaLite's."""
GEOJSON_TYPES = (
    *("FeatureCollection", "Feature", "Polygon", "MultiPolygon", "GeometryCollection"),
    *("Point", "MultiPoint", "LineString", "MultiLineString"),
)
LEADING = re.compile(
    rb'"(links|stac_version|stac_extensions|conformsTo|command_line|objectIdFieldName|geometryType|arcs)"'
    rb"|gdal_streamed_alg|\\u00[2-7]"
)
"""Members by which other drivers take a JSON file for one of their own, or words in which they could hide."""
OFFLINE = {
    "GDAL_HTTP_PROXY": "http://127.0.0.1:9",
    "CPL_VSIL_CURL_ALLOWED_EXTENSIONS": "{none}",
}
"""Settings of GDAL under which no address is reached."""


@dataclass(frozen=True)
class VectorLayer:
    """A layer of a vector file: its name, the kind of its shapes (empty where it has none), its columns, how
    many features it has, and its reference system."""

    name: str
    kind: str
    columns: tuple[str, ...]
    count: int
    crs: str | None


@contextmanager
def checked_vector(path: Path) -> Iterator[tuple[Path, str]]:
    """The file to give to GDAL for `path`, and the driver that must open it.

    A GeoJSON file with members that lead elsewhere is copied without them.

    Raises
    ------
    InputError
        When it is none of the known formats, or a database with tables that read other files.
    """
    if not path.is_file():
        raise InputError.about(path, "is not a vector file that can be read", REMEDY)
    with path.open("rb") as file:
        head = file.read(512)
    driver = next((name for mark, name in KNOWN.items() if head.startswith(mark)), None)
    if driver == "GPKG":
        driver = driver_of_database(path)
    if driver is not None:
        yield path, driver
        return
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    if not text.startswith((b"{", b"\x1e")):
        raise InputError.about(path, "is not a vector file that can be read", REMEDY)
    if not has_word(path, LEADING):
        yield path, "GeoJSON"
        return
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "copy.geojson"
        copy.write_text(json.dumps(plain_geojson(path)), encoding="utf-8")
        yield copy, "GeoJSON"


def has_word(path: Path, word: bytes | re.Pattern[bytes]) -> bool:
    """True if a JSON file has a word somewhere."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
        return re.search(word, text) is not None


def plain_geojson(path: Path) -> dict[str, object]:
    """The members of a JSON file that are GeoJSON: features, system, name."""
    try:
        document = json.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError):
        raise InputError.about(path, "is not a vector file that can be read", REMEDY) from None
    if not isinstance(document, dict) or document.get("type") not in GEOJSON_TYPES:
        raise InputError.about(path, "is JSON, but no GeoJSON", REMEDY)
    members = ("type", "features", "crs", "name", "geometry", "properties", "coordinates", "geometries", "id")
    return {key: document[key] for key in members if key in document}


def driver_of_database(path: Path) -> str:
    """The driver of an SQLite database: a GeoPackage, or one as SpatiaLite and GDAL make them.

    Raises
    ------
    InputError
        When it has a table made by a module that could read other files.
    """
    try:
        connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
        try:
            tables = dict(
                connection.execute("SELECT lower(name), sql FROM sqlite_master WHERE type = 'table'")
            )
        finally:
            connection.close()
    except sqlite3.DatabaseError:
        raise InputError.about(path, "is not a vector file that can be read", REMEDY) from None
    for text in tables.values():
        statement = re.match(
            r"\s*CREATE\s+VIRTUAL\s+TABLE\s.*?\sUSING\s+(\w+)", text or "", re.IGNORECASE | re.DOTALL
        )
        if statement is not None and not statement[1].lower().startswith(OWN_TABLES):
            raise InputError.about(path, f"has a table that reads other files ({statement[1]})", REMEDY)
    return "SQLite" if "geometry_columns" in tables and "gpkg_contents" not in tables else "GPKG"
