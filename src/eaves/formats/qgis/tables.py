"""The tables of a GeoPackage from which QGIS and GDAL take styles and the names of columns."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path

from eaves.formats.columns import COLUMNS
from eaves.formats.crs import name_units
from eaves.formats.qgis.styles import styles_of
from eaves.model import NOTHING_KNOWN, CoordinateSystem, Provenance
from eaves.model.coordinates import describe_units

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
STANDARD = "https://json-schema.org/"
"""The standard named for the metadata; there is no standard for so little."""
SCHEMA_EXTENSION = ("gpkg_schema", "http://www.geopackage.org/spec121/#extension_schema", "read-write")


METADATA_TABLES = """
CREATE TABLE IF NOT EXISTS gpkg_metadata (
    id INTEGER CONSTRAINT m_pk PRIMARY KEY ASC NOT NULL, md_scope TEXT NOT NULL DEFAULT 'dataset',
    md_standard_uri TEXT NOT NULL, mime_type TEXT NOT NULL DEFAULT 'text/xml',
    metadata TEXT NOT NULL DEFAULT '');
CREATE TABLE IF NOT EXISTS gpkg_metadata_reference (
    reference_scope TEXT NOT NULL, table_name TEXT, column_name TEXT, row_id_value INTEGER,
    timestamp DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
    md_file_id INTEGER NOT NULL, md_parent_id INTEGER,
    CONSTRAINT crmr_mfi_fk FOREIGN KEY (md_file_id) REFERENCES gpkg_metadata(id),
    CONSTRAINT crmr_mpi_fk FOREIGN KEY (md_parent_id) REFERENCES gpkg_metadata(id));
"""
METADATA_EXTENSION = (
    "gpkg_metadata",
    "http://www.geopackage.org/spec121/#extension_metadata",
    "read-write",
)


def describe_layers(
    path: Path, system: CoordinateSystem, provenance: Provenance = NOTHING_KNOWN, note: str = ""
) -> None:
    """Add to a GeoPackage the styles and units of its layers, a note on them, title, unit and meaning of
    their columns, and what it is made from, as JSON: of GDAL's own kind of metadata its reader would leave a
    file beside it."""
    with closing(sqlite3.connect(path)) as database, database:
        database.executescript("PRAGMA synchronous = OFF; PRAGMA journal_mode = MEMORY")  # nobody sees it yet
        if provenance:
            database.executescript(METADATA_TABLES)
            origins = json.dumps(provenance.members)
            database.execute(
                "INSERT INTO gpkg_metadata VALUES (1, 'dataset', ?, 'application/json', ?)",
                (STANDARD, origins),
            )
            database.execute(
                "INSERT INTO gpkg_metadata_reference SELECT 'geopackage', NULL, NULL, NULL, "
                "MIN(last_change), 1, NULL FROM gpkg_contents"
            )
        layers = database.execute(
            "SELECT c.table_name, g.column_name FROM gpkg_contents c LEFT JOIN gpkg_geometry_columns g "
            "USING (table_name)"
        ).fetchall()
        database.executescript(TABLES)
        for table in ("gpkg_metadata", "gpkg_metadata_reference") if provenance else ():
            database.execute(
                "INSERT INTO gpkg_extensions VALUES (?, NULL, ?, ?, ?)", (table, *METADATA_EXTENSION)
            )
        described = False
        units = describe_units(name_units(system)) or "geometry and attributes in metres"
        description = f"{note}; {units}" if note else units
        for layer, geometry in layers:
            database.execute(
                "UPDATE gpkg_contents SET description = ? WHERE table_name = ?", (description, layer)
            )
            names = [row[1] for row in database.execute(f'PRAGMA table_info("{layer}")')]
            columns = [name for name in names if name not in ("fid", geometry)]
            for number, style in enumerate(styles_of(layer, columns, system, note) if geometry else ()):
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
