"""Made-up files of every known layout are told by their columns; ids, addresses, licences come from them."""

from __future__ import annotations

import json
import logging
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pytest
import shapely

from eaves.footprints.layouts import LAYOUTS, SOURCE_NAMES, layout_of
from eaves.footprints.read import read_footprints, recognise_map
from eaves.formats import InputError, iter_cityjson
from eaves.formats.crs import parse_crs, system_of
from eaves.formats.vectors.geopackage import Row, append_rows, write_polygons
from eaves.model import CoordinateSystem
from eaves.pipeline import build
from eaves.simulate.objects.houses import ExactScene

DUTCH = system_of(parse_crs("EPSG:28992"), "test", (85000.0, 447000.0))
CORNER = np.array([84960.0, 447120.0])
AREA = shapely.box(*CORNER, *(CORNER + 200.0))
HOUSES = [shapely.box(*(CORNER + [x, 10]), *(CORNER + [x + 8, 22])) for x in (10, 18, 40, 60)]
FAR = shapely.box(*(CORNER + 5000.0), *(CORNER + 5010.0))

MADE: dict[str, tuple[list[dict[str, Any]], list[str], dict[str, Any]]] = {
    "bag": (
        [
            {
                "rdf_seealso": "x",
                "identificatie": f"050310000000000{k}",
                "bouwjaar": 1890 + k,
                "status": "Pand gesloopt" if k == 3 else "Pand in gebruik",
                "gebruiksdoel": "woonfunctie",
                "aantal_verblijfsobjecten": 1,
            }
            for k in range(5)
        ],
        ["0503100000000000", "0503100000000001", "0503100000000002"],
        {"year_built": 1890, "use": "woonfunctie", "attribution": "Kadaster (BAG), CC0 1.0"},
    ),
    "bgt": (
        [
            {
                "identificatie_lokaal_id": f"G0503.{k}",
                "identificatie_bag_pnd": "0503100000000001",
                "bgt_status": "bestaand",
                "relatieve_hoogteligging": -1 if k == 3 else 0,
                "eind_registratie": "2020-01-01" if k == 2 else None,
            }
            for k in range(5)
        ],
        ["G0503.0", "G0503.1"],
        {"attribution": "Kadaster (BGT), CC0 1.0"},
    ),
    "bdtopo": (
        [
            {
                "cleabs": f"BATIMENT000000000000000{k}",
                "nature": "Indifférenciée",
                "usage_1": "Résidentiel",
                "construction_legere": False,
                "etat_de_l_objet": "En projet" if k == 3 else "En service",
                "nombre_d_etages": 2,
                "hauteur": 6.2,
            }
            for k in range(5)
        ],
        [f"BATIMENT000000000000000{k}" for k in range(3)],
        {"storeys": 2, "use": "Résidentiel", "map_height_m": 6.2},
    ),
    "usa-structures": (
        [
            {
                "BUILD_ID": k + 1,
                "UUID": f"{{aaaa-{k}}}",
                "OCC_CLS": "Residential",
                "PRIM_OCC": "Single Family Dwelling",
                "PROP_ADDR": f"{k} MAIN ST",
                "PROP_CITY": "WOODFORD",
                "PROP_ST": "KY",
                "PROP_ZIP": "40383",
                "HEIGHT": None,
            }
            for k in range(5)
        ],
        [f"{{aaaa-{k}}}" for k in range(4)],
        {"address": "0 MAIN ST, WOODFORD KY 40383", "use": "Single Family Dwelling"},
    ),
    "overture": (
        [
            {
                "id": f"08b1{k}",
                "version": 1,
                "sources": "[]",
                "subtype": "residential",
                "class": "house",
                "has_parts": False,
                "is_underground": k == 3,
                "num_floors": 3,
                "height": 9.5,
            }
            for k in range(5)
        ],
        ["08b10", "08b11", "08b12"],
        {"use": "house", "storeys": 3, "map_height_m": 9.5},
    ),
    "osm": (
        [
            {
                "osm_id": str(100 + k),
                "building": None if k == 3 else "house",
                "landuse": "grass" if k == 3 else None,
                "other_tags": '"addr:street"=>"Oude Delft","addr:housenumber"=>"7a","building:levels"=>"2"',
            }
            for k in range(5)
        ],
        ["100", "101", "102"],
        {"address": "Oude Delft 7a", "storeys": 2, "use": "house"},
    ),
    "microsoft": (
        [{"height": -1.0 if k else 4.5, "confidence": -1.0} for k in range(5)],
        ["1", "2", "3", "4"],
        {"map_height_m": 4.5, "attribution": "Microsoft (Microsoft Building Footprints), ODbL 1.0"},
    ),
}


def made_file(path: Path, source: str) -> Path:
    """Four houses near the points and one far away, with the columns of a map."""
    rows = [Row(shape, told) for shape, told in zip([*HOUSES, FAR], MADE[source][0], strict=True)]
    write_polygons(path, rows, DUTCH)
    return path


def test_every_layout_has_a_made_up_file() -> None:
    assert set(MADE) | {"none"} == set(SOURCE_NAMES)
    assert len({layout.name for layout in LAYOUTS}) == len(LAYOUTS)


@pytest.mark.parametrize("source", MADE)
@pytest.mark.parametrize("suffix", [".gpkg", ".geojson", ".fgb"])
def test_a_map_is_told_by_its_columns(
    source: str, suffix: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = made_file(tmp_path / f"some{suffix}", source)
    known = recognise_map(path)
    assert known is not None and known.layout.name == source
    with caplog.at_level(logging.INFO, "eaves"):
        inside, lost = read_footprints(path, None, DUTCH, AREA, known)
    _, ids, said = MADE[source]
    if suffix != ".fgb":  # whose features lie in an order of their own
        assert [footprint.id for footprint in inside] == ids
    assert {footprint.id for footprint in inside} == set(ids) or source == "microsoft"
    assert any(said.items() <= footprint.attributes.items() for footprint in inside)
    assert inside[0].polygon.area == pytest.approx(96.0, abs=0.02)
    assert not {"far", "outside"} & {failure.code for failure in lost}
    line = next(record.message for record in caplog.records if "read as" in record.message)
    assert known.layout.title in line and known.layout.licence in line and "of 5 polygons" in line
    gone = {"bag", "bgt", "bdtopo", "overture"}
    assert [failure.code for failure in lost] == (["not_standing"] if source in gone else [])


def test_columns_of_a_shapefile_are_known_in_capitals() -> None:
    told = layout_of(["ID", "NATURE", "USAGE1", "LEGER", "ETAT", "HAUTEUR", "NB_ETAGES"])
    assert told is not None and told.name == "bdtopo"
    told = layout_of(["osm_id", "code", "fclass", "name", "type"])
    assert told is not None and told.name == "osm"


@pytest.mark.parametrize(
    "columns",
    [[], ["id"], ["bag_id"], ["id", "area_m2", "lod", "height"], ["name", "height", "confidence", "x"]],
)
def test_other_columns_are_no_known_map(columns: list[str]) -> None:
    assert layout_of(columns) is None


def test_a_source_can_be_named_or_refused(tmp_path: Path) -> None:
    path = made_file(tmp_path / "a.gpkg", "bag")
    assert recognise_map(path, "none") is None
    with pytest.raises(InputError, match="no layer with the columns of osm"):
        recognise_map(path, "osm")
    with pytest.raises(InputError, match="unknown source; choose one of: bag"):
        recognise_map(path, "bagg")
    known = recognise_map(path, "bag")
    inside, _ = read_footprints(path, "bouwjaar", DUTCH, AREA, known)
    assert [footprint.id for footprint in inside] == ["1890", "1891", "1892"]


def test_addresses_come_from_the_layer_beside__one_two_and_many(tmp_path: Path) -> None:
    path = tmp_path / "bag-light.gpkg"
    kinds = {"identificatie": str, "rdf_seealso": str, "status": str}
    append_rows(path, [Row(shapely.force_3d(FAR), dict.fromkeys(kinds, "x"))], DUTCH, "ligplaats", kinds)
    rows = [Row(shapely.force_3d(s), told) for s, told in zip([*HOUSES, FAR], MADE["bag"][0], strict=True)]
    kinds = {name: type(value) for name, value in MADE["bag"][0][0].items()}
    append_rows(path, rows, DUTCH, "pand", kinds)
    named = [("0503100000000000", 3), ("0503100000000001", 5), ("0503100000000001", 11)]
    named += [("0503100000000002", k) for k in (1, 2, 3, 4, 5)] + [("0503100000009999", 1)]
    columns = {
        "pand_identificatie": [one for one, _ in named],
        "openbare_ruimte_naam": ["Voorstraat"] * len(named),
        "huisnummer": [number for _, number in named],
        "huisletter": ["A" if number == 11 else None for _, number in named],
        "toevoeging": [None] * len(named),
        "postcode": ["2611JN"] * len(named),
        "woonplaats_naam": ["Delft"] * len(named),
    }
    places = shapely.to_wkb(shapely.points(np.repeat([CORNER + 15.0], len(named), axis=0)))
    data = [np.array(told, dtype=int if name == "huisnummer" else object) for name, told in columns.items()]
    pyogrio.raw.write(
        path, places, data, np.array(list(columns), dtype=object),
        layer="verblijfsobject", driver="GPKG", geometry_type="Point", crs="EPSG:28992", append=True,
    )  # fmt: skip
    known = recognise_map(path)
    assert known is not None and (known.layer.name, known.addresses) == ("pand", "verblijfsobject")
    inside, _ = read_footprints(path, None, DUTCH, AREA, known)
    told = [(one.attributes["address"], one.attributes["addresses"]) for one in inside]
    assert told[0] == ("Voorstraat 3, 2611JN Delft", 1)
    assert told[1] == ("Voorstraat 5, 2611JN Delft; Voorstraat 11A, 2611JN Delft", 2)
    assert told[2][0].endswith("Voorstraat 3, 2611JN Delft and 2 more") and told[2][1] == 5


def test_degrees_and_geoparquet_are_read_near_the_points_only(tmp_path: Path) -> None:
    """Overture's own files: GeoParquet in degrees, with nested columns."""
    pytest.importorskip("pyarrow")
    import pyarrow
    import pyarrow.parquet
    from pyproj import Transformer

    back = Transformer.from_crs("EPSG:28992", "OGC:CRS84", always_xy=True).transform
    shapes = [shapely.transform(s, lambda xy: np.column_stack(back(*xy.T))) for s in [*HOUSES, FAR]]
    boxes = [dict(zip(("xmin", "ymin", "xmax", "ymax"), shape.bounds, strict=True)) for shape in shapes]
    rows = MADE["overture"][0]
    table = {name: [row[name] for row in rows] for name in rows[0]} | {"bbox": boxes}
    table |= {"sources": [[{"dataset": "OpenStreetMap"}]] * 5, "names": [{"primary": "De Kerk"}] * 5}
    table["geometry"] = list(shapely.to_wkb(shapes))
    about = {"version": "1.1.0", "primary_column": "geometry"}
    about |= {"columns": {"geometry": {"encoding": "WKB", "geometry_types": ["Polygon"]}}}
    for name in ("with.parquet", "without.parquet"):
        if name.startswith("without"):
            del table["bbox"]
        whole = pyarrow.table(table).replace_schema_metadata({b"geo": json.dumps(about).encode()})
        pyarrow.parquet.write_table(whole, tmp_path / name)
        known = recognise_map(tmp_path / name)
        assert known is not None and known.layout.name == "overture" and known.layer.count == 5
        inside, lost = read_footprints(tmp_path / name, None, DUTCH, AREA, known)
        assert [one.id for one in inside] == MADE["overture"][1] and len(lost) == 1
        assert inside[0].polygon.symmetric_difference(HOUSES[0]).area < 0.05
        assert json.loads(inside[0].attributes["names"]) == {"primary": "De Kerk"}
    (tmp_path / "bad.parquet").write_bytes(b"PAR1 and no more")
    with pytest.raises(InputError, match="not GeoParquet"):
        recognise_map(tmp_path / "bad.parquet")


@pytest.mark.slow
def test_attribution_and_ids_are_in_all_that_is_written(
    nine_roofs: ExactScene, nine_roofs_file: Path, tmp_path: Path
) -> None:
    polygons = [shapely.transform(one.footprint, lambda xy: xy + CORNER) for one in nine_roofs.buildings]
    rows = [
        Row(shape, told | {"status": "Pand in gebruik"})
        for shape, told in zip(polygons[:5], MADE["bag"][0], strict=True)
    ]
    write_polygons(tmp_path / "some.gpkg", rows, DUTCH)
    results = build(
        nine_roofs_file, tmp_path / "out", footprints=tmp_path / "some.gpkg", formats=("geojson",)
    )
    assert (results.found, results.modelled) == (5, 5)
    line = "Kadaster (BAG), CC0 1.0"
    run = json.loads((tmp_path / "out" / "run.json").read_text())
    assert run["footprint_source"] == {"source": "bag", "layer": "footprints", "attribution": line}
    assert line in (tmp_path / "out" / "report.html").read_text().split('id="shown"')[1][:300]
    for name in ("footprints.gpkg", "footprints.geojson"):
        path = tmp_path / "out" / name
        table = pyogrio.read_dataframe(path, layer="footprints", read_geometry=False)
        assert set(table["given_attribution"]) == {line} and set(table["given_use"]) == {"woonfunctie"}
        assert set(table["id"]) == {f"050310000000000{k}" for k in range(5)}
    models = list(iter_cityjson(tmp_path / "out" / "buildings.city.jsonl"))
    assert {model.attributes["attribution"] for model in models} == {line}
    plain = build(
        *(nine_roofs_file, tmp_path / "plain"),
        footprints=tmp_path / "some.gpkg",
        footprint_source="none",
    )
    assert plain.run["footprint_source"] is None and plain.found == 5


def test_a_system_of_no_place_keeps_the_columns(tmp_path: Path) -> None:
    write_polygons(tmp_path / "a.gpkg", [Row(HOUSES[0], MADE["osm"][0][0])], CoordinateSystem())
    known = recognise_map(tmp_path / "a.gpkg")
    inside, _ = read_footprints(tmp_path / "a.gpkg", None, DUTCH, AREA, known)
    assert inside[0].id == "100"
