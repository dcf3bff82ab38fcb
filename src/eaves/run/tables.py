"""The tables of a GeoPackage in few words, by which a later run says what a person changed in it."""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

FORMAT_TABLES = ("gpkg_", "rtree_", "sqlite_")
"""Starts of the names of tables that are the format's, which programs change that only show a layer."""
ROWS_AT_A_TIME = 1000
DIGITS = 8
"""Of a column's checksum: it tells a change from none, and is no proof."""

Tables = Mapping[str, Mapping[str, Any]]
"""Table → `rows`, their number, and `columns`: name → checksum of its values."""


def tables_of(path: Path) -> Tables:
    """The layers and tables of a GeoPackage; none of a file that is no database."""
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as database:
            names = database.execute("SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY name")
            return {
                name: table_of(database, name)
                for (name,) in names.fetchall()
                if not name.startswith(FORMAT_TABLES)
            }
    except sqlite3.Error:
        return {}


def table_of(database: sqlite3.Connection, name: str) -> dict[str, Any]:
    """Rows and columns of a table, piece by piece."""
    cursor = database.execute('SELECT * FROM "{}"'.format(name.replace('"', '""')))
    sums, rows = {column[0]: hashlib.sha256() for column in cursor.description}, 0
    while piece := cursor.fetchmany(ROWS_AT_A_TIME):
        rows += len(piece)
        for total, values in zip(sums.values(), zip(*piece, strict=True), strict=True):
            total.update(repr(values).encode())
    return {"rows": rows, "columns": {column: total.hexdigest()[:DIGITS] for column, total in sums.items()}}


def changes_between(before: Tables, now: Tables) -> Iterator[str]:
    """What is another in some tables: tables, columns, rows or values."""
    yield from (f"{name} is new" for name in sorted(now.keys() - before.keys()))
    yield from (f"{name} is gone" for name in sorted(before.keys() - now.keys()))
    for name in sorted(before.keys() & now.keys()):
        old, new = before[name]["columns"], now[name]["columns"]
        yield from (f"{name}.{column} is new" for column in sorted(new.keys() - old.keys()))
        yield from (f"{name}.{column} is gone" for column in sorted(old.keys() - new.keys()))
        if before[name]["rows"] != now[name]["rows"]:
            yield f"{name} has {now[name]['rows']:,} rows, not {before[name]['rows']:,}"
        else:
            differing = sorted(column for column in old.keys() & new.keys() if old[column] != new[column])
            yield from (f"{name}.{column} has other values" for column in differing)
