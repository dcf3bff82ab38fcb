"""The page of all columns, from the titles, units and meanings that the tables themselves carry."""

from __future__ import annotations

from eaves.formats.columns import COLUMNS, LAYERS, Column

INTRODUCTION = """# Columns

Every column of the layers of a run. The page is made from the same declarations as the titles in QGIS and the
comments in the GeoPackage. Heights, areas and volumes are in metres, also where the coordinates are in feet.

The layer `footprints` has the main columns, the table `attributes` of the same file further ones. `id` joins
them:
```
ogr2ogr all.gpkg out/footprints.gpkg -dialect sqlite \\
  -sql "SELECT * FROM footprints LEFT JOIN attributes USING (id)"
```
The formats geojson, fgb and parquet, `eaves.to_geopandas` and the CityJSON have all together.
Columns of a map (`given_…`) and of an update or an edit follow in `footprints`.
"""
TITLES = {
    "footprints": "Layer `footprints`",
    "attributes": "Table `attributes`",
    "roof_planes": "Layer `roof_planes`",
    "primitives": "Layer `primitives` and primitives.csv, of `--source maas_vosselman`",
}
MOVED = """## From the layer of earlier versions
Until this version all columns were in `footprints`. None was renamed.

| old column of `footprints` | now |
|---|---|
"""


def columns_page() -> str:
    """The page."""
    lines, shown = [INTRODUCTION], set()
    for layer, title in TITLES.items():
        lines.append(f"## {title}\n\n" + table_of({name: COLUMNS[name] for name in LAYERS[layer]}))
        shown |= set(LAYERS[layer])
    rest = {name: column for name, column in COLUMNS.items() if name not in shown}
    lines.append("## Columns of other layers and tables\n\n" + table_of(rest))
    moved = [name for name in LAYERS["attributes"] if name != "id"]
    rows = [f"| `{name}` | `footprints.{name}` |" for name in LAYERS["footprints"]]
    rows += [f"| `{name}` | `attributes.{name}` |" for name in moved]
    return "\n".join(lines) + "\n" + MOVED + "\n".join(rows) + "\n"


def table_of(columns: dict[str, Column]) -> str:
    """Name, title, unit and meaning of columns."""
    rows = ["| column | title | unit | meaning |", "|---|---|---|---|"]
    rows += [f"| `{name}` | {one.title} | {one.unit} | {one.meaning} |" for name, one in columns.items()]
    return "\n".join(rows) + "\n"
