"""The tables of a GeoPackage from which QGIS and GDAL take styles and the names of columns."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

from eaves.formats.qgis.styles import styles_of
from eaves.model import CoordinateSystem
from eaves.model.columns import COLUMNS

TABLES = """
CREATE TABLE layer_styles (
    id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, f_table_catalog TEXT(256), f_table_schema TEXT(256),
    f_table_name TEXT(256), f_geometry_column TEXT(256), styleName TEXT(30), styleQML TEXT, styleSLD TEXT,
    useAsDefault BOOLEAN, description TEXT, owner TEXT(30), ui TEXT(30),
    update_time DATETIME);
INSERT INTO gpkg_contents (table_name, data_type, identifier, description, last_change)
    SELECT 'layer_styles', 'attributes', 'layer_styles', 'styles for QGIS', MIN(last_change)
    FROM gpkg_contents;
CREATE TABLE IF NOT EXISTS gpkg_data_columns (
    table_name TEXT NOT NULL, column_name TEXT NOT NULL, name TEXT, title TEXT, description TEXT,
    mime_type TEXT, constraint_name TEXT, CONSTRAINT pk_gdc PRIMARY KEY (table_name, column_name),
    CONSTRAINT gdc_tn UNIQUE (table_name, name));
CREATE TABLE IF NOT EXISTS gpkg_extensions (
    table_name TEXT, column_name TEXT, extension_name TEXT NOT NULL, definition TEXT NOT NULL,
    scope TEXT NOT NULL, CONSTRAINT ge_tce UNIQUE (table_name, column_name, extension_name));
"""
SCHEMA_EXTENSION = ("gpkg_schema", "http://www.geopackage.org/spec121/#extension_schema", "read-write")


def describe_layers(path: Path, system: CoordinateSystem) -> None:
    """Add to a GeoPackage the styles of its layers and title, unit and meaning of their columns."""
    with closing(sqlite3.connect(path)) as database, database:
        layers = database.execute("SELECT table_name, column_name FROM gpkg_geometry_columns").fetchall()
        database.executescript(TABLES)
        described = False
        for layer, geometry in layers:
            names = [row[1] for row in database.execute(f'PRAGMA table_info("{layer}")')]
            columns = [name for name in names if name not in ("fid", geometry)]
            for number, style in enumerate(styles_of(layer, columns, system)):
                database.execute(
                    "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, "
                    "f_geometry_column, styleName, styleQML, styleSLD, useAsDefault, description, owner) "
                    "VALUES ('', '', ?, ?, ?, ?, '', ?, ?, '')",
                    (layer, geometry, style.name, style.as_qml(), number == 0, style.meaning),
                )
            for name in columns:
                if name in COLUMNS:
                    about = COLUMNS[name]
                    meaning = about.meaning + (f"; in {about.unit}" if about.unit else "")
                    database.execute(
                        "INSERT INTO gpkg_data_columns VALUES (?, ?, ?, ?, ?, NULL, NULL)",
                        (layer, name, name, about.label, meaning),
                    )
                    described = True
        if described:
            for table in ("gpkg_data_columns", "gpkg_data_column_constraints"):
                database.execute(
                    "INSERT INTO gpkg_extensions VALUES (?, NULL, ?, ?, ?)", (table, *SCHEMA_EXTENSION)
                )
            database.execute(
                "CREATE TABLE IF NOT EXISTS gpkg_data_column_constraints (constraint_name TEXT NOT NULL, "
                "constraint_type TEXT NOT NULL, value TEXT, min NUMERIC, min_is_inclusive BOOLEAN, "
                "max NUMERIC, max_is_inclusive BOOLEAN, description TEXT, "
                "CONSTRAINT gdcc_ntv UNIQUE (constraint_name, constraint_type, value))"
            )
