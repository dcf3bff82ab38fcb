"""How GeoPackage, GeoJSON and CityJSON files are hurt by one who knows them: tables, geometries, indices."""

from __future__ import annotations

import json
import math
import random
import sqlite3
import struct
from typing import Any

from benchmarks.scale.mutations import hurt_bytes

NUMBERS = (0, -1, 1, 0.5, 2**31, 2**63, 10**30, 1e18, 1e300, -1e308, float("nan"), float("inf"))
LATER = "\x00later"
"""Stands for what `json` cannot write, and is exchanged in the text."""
WRITTEN_LATER = (
    "1e400",
    "-1e400",
    "9" * 5000,
    "[" * 100_000,
    "[" * 500 + "]" * 500,
    '{"a":' * 3000,
    '"\\ud800"',
)
OTHER_TEXTS = ("", "a" * 100_000, "..", "\u202e\n", "Solid", "MultiSurface", "CityJSON", "EPSG:4326", "2.0")
MANY_VERTICES = 1_000_000
MANY_SHARE = 0.003
"""So many GeoJSON inputs are a footprint of MANY_VERTICES."""


def hurt_database(data: bytes, chance: random.Random) -> bytes:
    """A GeoPackage of which one to three rows, tables or geometries are not what they should be."""
    base = sqlite3.connect(":memory:", isolation_level=None)
    base.deserialize(data)
    base.execute("PRAGMA writable_schema = ON")
    base.execute("DELETE FROM sqlite_master WHERE type = 'trigger'")  # they ask for functions of a library
    (layer,) = base.execute("SELECT table_name FROM gpkg_contents ORDER BY table_name").fetchone()
    for _ in range(chance.choice((1, 1, 2, 3))):
        act = chance.choice((hurt_meta, hurt_shape, hurt_shape, hurt_column, hurt_schema))
        try:
            act(base, layer, chance)
        except (sqlite3.Error, IndexError):  # an earlier act took what this one hurts
            continue
    return base.serialize()


def hurt_meta(base: sqlite3.Connection, layer: str, chance: random.Random) -> None:
    """What the GeoPackage says of its layers and systems."""
    columns = {
        "gpkg_contents": ("table_name", "data_type", "srs_id", "min_x", "max_y", "identifier"),
        "gpkg_spatial_ref_sys": ("srs_id", "organization", "organization_coordsys_id", "definition"),
        "gpkg_geometry_columns": ("table_name", "column_name", "srs_id", "geometry_type_name", "z", "m"),
    }
    table = chance.choice(list(columns))
    column = chance.choice(columns[table])
    systems = (4326, 4979, 3857, 2263, 0, -1, 99999, 2**40)
    values = (*systems, None, "", "POINT", "CURVEPOLYGON", "tiles", b"\0", 1e308)
    base.execute(f"UPDATE OR REPLACE {table} SET {column} = ?", (chance.choice(values),))


def hurt_shape(base: sqlite3.Connection, layer: str, chance: random.Random) -> None:
    """One geometry, or all."""
    numbers = [row[0] for row in base.execute(f"SELECT fid FROM {layer}")]
    some = numbers if chance.random() < 0.2 else [chance.choice(numbers)]
    for number in some:
        (blob,) = base.execute(f"SELECT geom FROM {layer} WHERE fid = ?", (number,)).fetchone()
        base.execute(
            f"UPDATE {layer} SET geom = ? WHERE fid = ?", (strange_shape(blob or b"", chance), number)
        )


def strange_shape(blob: bytes, chance: random.Random) -> bytes | str | None:
    """A geometry in the GeoPackage's binary form that is damaged, empty, of another kind, or impossible."""
    head = blob[:3] + b"\x01" + blob[4:8]  # without envelope
    huge = 2**32 - 1

    def ring(points: list[tuple[float, float]], said: int | None = None) -> bytes:
        flat = [value for point in points for value in point]
        return struct.pack(f"<I{len(flat)}d", len(points) if said is None else said, *flat)

    x, y = chance.uniform(-50, 150), chance.uniform(-50, 150)
    box = [(x, y), (x + 9, y), (x + 9, y + 9), (x, y + 9), (x, y)]
    extreme = chance.choice((math.nan, math.inf, 1e300, 1e18, 1e9, -1e6))
    polygon = struct.pack("<BII", 1, 3, 1)
    many = [(x + k * 1e-3, y + (k % 2)) for k in range(2000)]
    shapes: tuple[bytes | str | None, ...] = (
        None,
        "POLYGON ((0 0, 1 0, 1 1, 0 0))",
        b"",
        blob[: chance.randrange(len(blob) + 1)],
        hurt_bytes(blob, chance),
        head + struct.pack("<BI", 1, chance.choice((0, 1, 2, 5, 8, 10, 15, 16, 17, 1003, 3003, huge))),
        head + struct.pack("<BII", 1, 3, chance.choice((0, huge))),
        head + polygon + ring(box, chance.choice((0, 1, 2, 3, huge))),
        head + polygon + ring(box[: chance.randrange(1, 4)]),
        head + polygon + ring([*box[:2], (extreme, y), *box[2:]]),
        head + polygon + ring([(x, y)] * 5),
        head + polygon + ring([box[0], box[2], box[1], box[3], box[0]]),
        head + polygon + ring([*many, many[0]]),
        head + polygon + ring([(x * 1e6, y * 1e6) for x, y in box]),
        head + struct.pack("<BII", 1, 3, 3) + ring(box) * 3,
        head + struct.pack("<BII", 1, 6, 300) + (polygon + ring(box)) * 300,
        head + struct.pack("<BII", 1, 7, 1) * 2000 + polygon + ring(box),
        head + struct.pack("<BI2d", 1, 1, x, y),
        head + struct.pack("<BI", 1, 2) + ring(box),
    )
    return chance.choice(shapes)


def hurt_column(base: sqlite3.Connection, layer: str, chance: random.Random) -> None:
    """What stands in a column of the layer."""
    names = [row[1] for row in base.execute(f"PRAGMA table_info({layer})") if row[1] not in ("fid", "geom")]
    values = (None, "", "x" * 100_000, b"\xff\xfe", -1, 2**62, 1e308, "same", "../../etc", "a\0b")
    some = chance.choice(("", f"WHERE fid = {chance.randrange(1, 4)}"))
    base.execute(f'UPDATE {layer} SET "{chance.choice(names)}" = ? {some}', (chance.choice(values),))


def hurt_schema(base: sqlite3.Connection, layer: str, chance: random.Random) -> None:
    """Tables gone, empty or renamed, and the marks of the file format."""
    table = chance.choice((layer, "gpkg_contents", "gpkg_geometry_columns", "gpkg_spatial_ref_sys"))
    acts = (
        f"DROP TABLE {table}",
        f"DELETE FROM {table}",
        f'ALTER TABLE {table} RENAME TO "other; name"',
        f"ALTER TABLE {layer} RENAME COLUMN geom TO shape",
        f'ALTER TABLE {layer} RENAME COLUMN id TO "i\'d"',
        f"ALTER TABLE {layer} DROP COLUMN id",
        "PRAGMA application_id = 1",
        "PRAGMA user_version = 99999",
        f"UPDATE sqlite_master SET rootpage = {chance.choice((0, 1, 2, 9999))} WHERE name = '{table}'",
        f"UPDATE sqlite_master SET sql = 'CREATE TABLE {table} (a)' WHERE name = '{table}'",
    )
    base.execute(chance.choice(acts))


def hurt_json(data: bytes, chance: random.Random) -> bytes:
    """A JSON text, or one line of many, with one to three of its values exchanged."""
    if b'"FeatureCollection"' in data and chance.random() < MANY_SHARE:
        return many_vertices(data)
    text = data.decode("utf-8")
    lines = text.splitlines() if '"CityJSONFeature"' in text else [text]
    number = 0 if chance.random() < 0.3 else chance.randrange(len(lines))
    document, later = json.loads(lines[number]), []
    for _ in range(chance.choice((1, 1, 2, 3))):
        places = walk(document)
        if not places:  # an earlier act emptied it
            break
        holder, key = chance.choice(by_depth(places, chance))
        value = strange_value(holder[key], document, chance)
        if value == LATER:
            later.append(chance.choice(WRITTEN_LATER))
        elif isinstance(holder, dict) and chance.random() < 0.15:
            del holder[key]
            continue
        holder[key] = value
    text = json.dumps(document)
    for written in later:
        text = text.replace(json.dumps(LATER), written, 1)
    lines[number] = text
    return "\n".join(lines).encode("utf-8", "surrogatepass")


def walk(node: Any, depth: int = 0) -> list[tuple[Any, Any, int]]:
    """Every place of a document: what holds it, its key or number, its depth."""
    found: list[tuple[Any, Any, int]] = []
    members = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in list(members):
        found.append((node, key, depth))
        if depth < 12:
            found += walk(value, depth + 1)
    return found


def by_depth(places: list[tuple[Any, Any, int]], chance: random.Random) -> list[tuple[Any, Any]]:
    """The places of one depth: most are coordinates, which would otherwise have all the mutations."""
    depth = chance.choice(sorted({place[2] for place in places}))
    return [(holder, key) for holder, key, at in places if at == depth]


def strange_value(value: Any, document: dict[str, Any], chance: random.Random) -> Any:
    """What stands in place of a value: another kind, an extreme, or its own kind and wrong."""
    if chance.random() < 0.15:
        return LATER
    objects = document.get("CityObjects")
    names = list(objects) if objects and isinstance(objects, dict) else ["building"]
    if chance.random() < 0.3:
        return chance.choice((None, True, [], {}, [[]], "", 0, 1.5, names, [names[0]] * 3))
    if isinstance(value, bool) or value is None:
        return chance.choice(NUMBERS)
    if isinstance(value, int | float):
        return chance.choice((*NUMBERS, value + 1, -value, value * 1000, str(value)))
    if isinstance(value, str):
        return chance.choice((*OTHER_TEXTS, *names, value[: len(value) // 2], value * 2))
    if isinstance(value, list):
        return chance.choice(
            (value[::-1], value[:-1], value * 2, [value], value[:1], value * 20, value[1:] + names)
        )
    members = list(value.items())
    family = {"parents": names, "children": names, "geometry": [{}], "attributes": []}
    return chance.choice(
        (dict(members[:-1]), {**value, **family}, {key: value for key, _ in members}, [value])
    )


def many_vertices(data: bytes) -> bytes:
    """The first feature with a ring of MANY_VERTICES instead of its own."""
    document = json.loads(data)
    feature = document["features"][0]
    coordinates = feature["geometry"]["coordinates"]
    while isinstance(coordinates[0], list):
        coordinates = coordinates[0]
    x, y = coordinates[:2]
    angles = (2 * math.pi * k / MANY_VERTICES for k in range(MANY_VERTICES))
    ring = [[x + 9 * math.cos(angle), y + 9 * math.sin(angle)] for angle in angles]
    feature["geometry"] = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
    return json.dumps(document).encode()
