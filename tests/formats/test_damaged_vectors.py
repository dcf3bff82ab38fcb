"""Cut, lying and mutated vector, raster, CityJSON and text files give one line or a result; nothing else."""

from __future__ import annotations

import json
import logging
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.scale.mutations import hurt_bytes
from shapely import Polygon

from eaves.formats import (
    InputError,
    iter_chunks,
    iter_cityjson,
    open_source,
    read_polygons,
    read_raster,
    write_cityjson,
    write_cityjson_seq,
    write_mask,
)
from eaves.formats.vectors.geopackage import Row, write_polygons
from eaves.model import BuildingModel, Face, Footprint, Solid
from eaves.model.coordinates import LOCAL_METRES

MUTATIONS = 60
SQUARE = Polygon([(0, 0), (10, 0), (10, 8), (0, 8)])


def flat_house() -> BuildingModel:
    """A box of 10 m × 8 m × 5 m."""
    low, high = [[0, 0, 1], [10, 0, 1], [10, 8, 1], [0, 8, 1]], [[0, 0, 6], [10, 0, 6], [10, 8, 6], [0, 8, 6]]
    walls = [Face(((i, (i + 1) % 4, (i + 1) % 4 + 4, i + 4),), "WallSurface") for i in range(4)]
    faces = (Face(((3, 2, 1, 0),), "GroundSurface"), Face(((4, 5, 6, 7),), "RoofSurface", 0), *walls)
    solid = Solid.of(np.array(low + high, float), faces)
    return BuildingModel(
        Footprint(SQUARE, (85000.0, 447000.0), "b1"), {"1.2": (solid,), "2.2": (solid, solid)}
    )


def refused_or_read(path: Path, read: Callable[[Path], Any]) -> bool:
    """Whether the file was read; a refusal must be one line that names the file."""
    try:
        read(path)
    except InputError as error:
        assert str(path) in str(error) and "\n" not in str(error)
        return False
    return True


def solids_of(path: Path) -> None:
    for found in iter_cityjson(path):
        for geometry in found.geometries:
            found.as_solids(geometry)


def points_of(path: Path) -> None:
    for _ in iter_chunks(open_source(path)):
        pass


@pytest.mark.parametrize(
    "name", ["a.gpkg", "a.fgb", "a.geojson", "a.tif", "a.city.jsonl", "a.city.json", "a.txt"]
)
def test_mutated_files_are_read_or_refused_in_one_line(name: str, tmp_path: Path) -> None:
    whole = tmp_path / name
    reader: Callable[[Path], Any] = read_polygons
    if name == "a.tif":
        write_mask(whole, np.eye(40, dtype=bool), 0.0, 0.0, 0.5, LOCAL_METRES)
        reader = read_raster
    elif "city" in name:
        (write_cityjson_seq if name.endswith("l") else write_cityjson)(whole, [flat_house()])
        reader = solids_of
    elif name == "a.txt":
        whole.write_text("x,y,z,label\n" + "85000.5,447000.5,3.5,0\n" * 9)
        reader = points_of
    else:
        write_polygons(whole, [Row(SQUARE, {"id": "a", "n": 1}), Row(SQUARE, {"id": "b", "n": None})])
    data, rng = whole.read_bytes(), random.Random(7)
    path = tmp_path / f"mutated{''.join(whole.suffixes)}"
    for _ in range(MUTATIONS):
        path.write_bytes(hurt_bytes(data, rng))
        refused_or_read(path, reader)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda solid: solid["boundaries"][0][0][0].__setitem__(0, 99), "points outside"),
        (lambda solid: solid["boundaries"][0][0][0].__setitem__(0, 1e999), "does not follow the CityJSON"),
        (lambda solid: solid["boundaries"][0][0][0].__setitem__(0, 1.5), "does not follow the CityJSON"),
        (lambda solid: solid["semantics"]["values"][0].__setitem__(0, -1), "semantics -1 of 3"),
        (lambda solid: solid.pop("boundaries"), "lacks 'boundaries'"),
        (lambda solid: solid.__setitem__("boundaries", 7), "does not follow the CityJSON"),
    ],
)
def test_geometry_that_points_nowhere_is_refused_in_our_words(
    change: Callable[[dict[str, Any]], Any], says: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.city.jsonl"
    write_cityjson_seq(path, [flat_house()])
    head, feature = map(json.loads, path.read_text().splitlines())
    change(feature["CityObjects"]["b1"]["geometry"][1])
    path.write_text(f"{json.dumps(head)}\n{json.dumps(feature)}\n")
    with pytest.raises(InputError, match=says):
        solids_of(path)


def test_an_open_ring_is_closed_and_features_without_geometry_are_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rings = {"open": [[0, 0], [10, 0], [10, 10], [0, 10]], "bow": [[0, 0], [9, 9], [9, 0], [0, 9], [0, 0]]}
    shapes = {name: {"type": "Polygon", "coordinates": [ring]} for name, ring in rings.items()} | {
        "none": None
    }
    features = [
        {"type": "Feature", "properties": {"id": name}, "geometry": shape} for name, shape in shapes.items()
    ]
    path = tmp_path / "a.geojson"
    system = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::28992"}}
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": system, "features": features}))
    with caplog.at_level(logging.WARNING, logger="eaves"):
        polygons, ids, _, _ = read_polygons(path, id_field="id")
    assert ids == ["open", "bow"]
    assert polygons[0].area == 100.0 and not polygons[1].is_valid
    assert "1 features without coordinates are left out" in caplog.text


def test_a_polygon_out_of_this_world_is_left_out(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "a.geojson"
    rings = [[[0, 0], [10, 0], [10, 10], [0, 0]], [[0, 0], [9e19, 0], [10, 10], [0, 0]]]
    features = [
        {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
        for ring in rings
    ]
    system = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::28992"}}
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": system, "features": features}))
    assert len(read_polygons(path)[0]) == 1 and "1 features" in caplog.text
