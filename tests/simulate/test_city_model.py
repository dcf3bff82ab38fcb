"""Somebody's CityJSON can be scanned: its faces are the truth."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from eaves.formats.errors import InputError
from eaves.formats.models.cityjson import write_cityjson
from eaves.simulate import Scanner, nine_roofs_on_a_slope, scan_town, town_of_model, write_simulation

EXACT = Scanner(noise=0.0, strip_offset=0.0, outliers=0.0)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scene = nine_roofs_on_a_slope(density=0.1)
    path = tmp_path_factory.mktemp("model") / "nine.city.json"
    write_cityjson(path, [building.model(scene.cloud.origin) for building in scene.buildings])
    return path


def test_model_comes_back_as_the_town_it_was(model: Path) -> None:
    town, scene = town_of_model(model), nine_roofs_on_a_slope(density=0.1)
    assert len(town.buildings) == 9
    for one, two in zip(town.buildings, scene.buildings, strict=True):
        assert one.id == two.id and len(one.faces) == len(two.faces)
        assert one.footprint.area == pytest.approx(two.footprint.area, rel=1e-3)


def test_points_on_the_roofs_of_a_model_lie_on_its_faces(model: Path) -> None:
    scene = scan_town(town_of_model(model), 5.0, 0.0, scanner=EXACT)
    faces = scene.faces
    assert len(set(np.unique(scene.plane)) - {0}) == len(faces)
    for number, face in faces.items():
        off = scene.cloud.xyz[scene.plane == number][:, 2] - face.height_at(
            scene.cloud.xyz[scene.plane == number]
        )
        assert abs(np.median(off)) < 0.01


def test_scanned_model_is_written_with_its_own_ids(model: Path, tmp_path: Path) -> None:
    from eaves.formats.models.cityjson_read import read_cityjson

    scene = scan_town(town_of_model(model, trees=1.0), 1.0)
    paths = write_simulation(scene, tmp_path)
    assert {b.id for b in scene.buildings} <= set(read_cityjson(paths["models"]))


@pytest.mark.parametrize("axis", [0, 2])
def test_model_larger_than_a_survey_is_refused(model: Path, tmp_path: Path, axis: int) -> None:
    document = json.loads(model.read_text())
    document["vertices"][3][axis] += 20_000 / document["transform"]["scale"][axis]
    (tmp_path / "a.city.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match="measures"):
        town_of_model(tmp_path / "a.city.json")


def test_faces_without_corners_are_left_out(model: Path, tmp_path: Path) -> None:
    document = json.loads(model.read_text())
    first = next(iter(town_of_model(model).buildings)).id
    shell = document["CityObjects"][first]["geometry"][-1]["boundaries"][0]
    shell += [[], [[0, 1]]]
    document["CityObjects"][first]["geometry"][-1].pop("semantics")
    (tmp_path / "a.city.json").write_text(json.dumps(document))
    assert len(town_of_model(tmp_path / "a.city.json").buildings) == 9


def test_model_without_buildings_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "empty.city.json"
    write_cityjson(path, [])
    with pytest.raises(InputError, match="holds no building"):
        town_of_model(path)


@pytest.mark.slow
def test_a_real_town_is_scanned() -> None:
    if "EAVES_DATA" not in os.environ:
        pytest.skip("EAVES_DATA does not name the folder of the data sets")
    town = town_of_model(Path(os.environ["EAVES_DATA"]) / "towns" / "delfshaven.city.json")
    assert len(town.buildings) >= 850
    scene = scan_town(town, 1.0)
    assert len(set(np.unique(scene.building))) > 0.95 * len(town.buildings)
