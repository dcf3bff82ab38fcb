"""Every given footprint has one row, modelled or with its reason; what lies outside them stays a building."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyogrio
import pytest
import shapely
from tests.conftest import build_in_blocks
from tests.formats.cityjson_schema import schema_defects

from eaves.footprints.read import read_footprints
from eaves.formats import InputError
from eaves.formats.vectors.geopackage import Row, write_polygons
from eaves.model import CoordinateSystem
from eaves.run.manifest import check_folder
from eaves.simulate.objects.houses import ExactScene
from eaves.validate import validate_file

build = partial(build_in_blocks, 60.0)

PLACE = np.array([84960.0, 447120.0])


def rows_of(folder: Path) -> dict[str, dict[str, Any]]:
    meta, _, geometry, columns = pyogrio.raw.read(folder / "footprints.gpkg", layer="footprints")
    names = list(meta["fields"])
    rows = [dict(zip(names, values, strict=True)) for values in zip(*columns, strict=True)]
    assert len({row["id"] for row in rows}) == len(rows) == len(geometry)
    return {row["id"]: row for row in rows}


@pytest.fixture(scope="module")
def given(nine_roofs: ExactScene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five of the nine footprints, and five that cannot be modelled."""
    path = tmp_path_factory.mktemp("given") / "given.gpkg"
    polygons = [shapely.transform(one.footprint, lambda xy: xy + PLACE) for one in nine_roofs.buildings]
    rows = {f"house {k}": polygon for k, polygon in enumerate(polygons[:5])}
    near = shapely.box(*(PLACE + [1, 1]), *(PLACE + [1.5, 1.2]))
    rows |= {"sliver": near, "line": shapely.Polygon([PLACE, PLACE + 5, PLACE])}
    rows |= {"far": shapely.box(0, 0, 9, 9), "other side": shapely.box(3e7, 0, 3e7 + 9, 9)}
    told = [Row(shape, {"name": name}) for name, shape in rows.items()] + [Row(None, {"name": "nowhere"})]
    write_polygons(path, told, CoordinateSystem())
    return path


EXPECTED = {"sliver": "no_area", "line": "no_area", "nowhere": "no_area", "far": "outside"}
EXPECTED |= {"other side": "outside"}


@pytest.mark.slow
def test_each_has_one_row_also_by_tiles_and_the_rest_stays_building(
    given: Path, nine_roofs_file: Path, tmp_path: Path
) -> None:
    for name, per_tile in (("given", False), ("tiled", True)):
        out = tmp_path / name
        summary = build(nine_roofs_file, out, footprints=given, id_field="name", per_tile=per_tile)
        assert (summary.found, summary.modelled) == (10, 5)
        assert summary.failures == {"no_area": 3, "outside": 2}
        rows = rows_of(out)
        assert {name: row["failure_code"] for name, row in rows.items() if row["failure_code"]} == EXPECTED
        assert set(rows) == {f"house {k}" for k in range(5)} | set(EXPECTED)
        assert all(row["failure_reason"] for name, row in rows.items() if name in EXPECTED)
        assert check_folder(out) == []
    assert validate_file(tmp_path / "given" / "buildings.city.jsonl") == []
    assert schema_defects(tmp_path / "given" / "buildings.city.jsonl") == []
    assert build(nine_roofs_file, tmp_path / "own", lod="0", outputs=("classified",)).complete
    classes = [laspy.read(tmp_path / name / "classified.laz") for name in ("given", "own")]
    ours = [np.asarray(one.classification) == 6 for one in classes]
    assert ours[0].sum() >= 0.99 * ours[1].sum()
    assert (np.asarray(classes[0].building_id)[ours[0]] == 0).any()


@pytest.mark.parametrize(
    ("ids", "what"), [(["a", "a"], "more than once"), (["a", None], "have no"), (["a", " "], "have no")]
)
def test_ids_that_name_no_single_footprint_are_refused(
    ids: list[str | None], what: str, nine_roofs_file: Path, tmp_path: Path
) -> None:
    boxes = [shapely.box(*(PLACE + k), *(PLACE + k + 9)) for k in (0, 20)]
    rows = [Row(shape, {"name": name}) for shape, name in zip(boxes, ids, strict=True)]
    write_polygons(tmp_path / "given.gpkg", rows, CoordinateSystem())
    with pytest.raises(InputError, match=what):
        build(nine_roofs_file, tmp_path / "out", footprints=tmp_path / "given.gpkg", id_field="name")


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        ({"bag_id": ["0503", "0504"]}, ["0503", "0504"]),
        ({"bag_id": ["0503", "0503"]}, ["1", "2"]),
        ({"bag_id": ["0503", "0504"], "object id": [7, 8]}, ["1", "2"]),
        ({"name": ["a", "b"], "width": [3, 4]}, ["1", "2"]),
    ],
    ids=["a lone unique id", "not unique", "two of them", "none"],
)
def test_a_lone_column_of_ids_is_taken(
    columns: dict[str, list[Any]], expected: list[str], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    boxes = [shapely.box(k, 0, k + 9, 9) for k in (0, 20)]
    rows = [Row(box, {name: values[k] for name, values in columns.items()}) for k, box in enumerate(boxes)]
    write_polygons(tmp_path / "map.gpkg", rows, CoordinateSystem())
    with caplog.at_level("INFO", logger="eaves"):
        found, _ = read_footprints(
            tmp_path / "map.gpkg", None, CoordinateSystem(), shapely.box(-9, -9, 99, 99)
        )
    assert [one.id for one in found] == expected
    assert ("--id-field" in caplog.text) == any("id" in name.split("_") + name.split() for name in columns)
