"""Corrections of the nine roofs: each verdict is honoured, the others stay, and edits are kept."""

import json
import shutil
from pathlib import Path

import pyogrio
import pytest
import shapely

from eaves.flow.edits import (
    FLAT_ROOF,
    FOOTPRINT,
    IS_BUILDING,
    NO_BUILDING,
    PARTY_WALLS,
    Edit,
    read_edits,
    settle,
    write_edits,
)
from eaves.formats import read_cityjson, read_polygons
from eaves.formats.errors import InputError
from eaves.model.coordinates import LOCAL_METRES
from eaves.run.manifest import check_folder
from eaves.simulate import nine_roofs_on_a_slope, write_simulation
from eaves.upkeep.update import Updated, update
from tests.conftest import build_files

OUTPUTS = ("footprints", "models", "classified")


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that keeps its parts."""
    place = tmp_path_factory.mktemp("kept")
    files = write_simulation(nine_roofs_on_a_slope(density=8.0, seed=1), place / "nine")
    build_files(files["points"], place / "out", keep=True, outputs=OUTPUTS)
    return place / "out"


@pytest.fixture
def out(kept: Path, tmp_path: Path) -> Path:
    shutil.copytree(kept, tmp_path / "out")
    return tmp_path / "out"


def buildings(out: Path) -> dict[str, shapely.Polygon]:
    polygons, _, rows, _ = read_polygons(out / "footprints.gpkg", "footprints")
    return {row["id"]: polygon for polygon, row in zip(polygons, rows, strict=True)}


def models(out: Path) -> dict[str, str]:
    """The lines of the CityJSON sequence by building."""
    lines = (out / "buildings.city.jsonl").read_text(encoding="utf-8").splitlines()[1:]
    return {json.loads(line)["id"]: line for line in lines}


def corrected(out: Path, *edits: Edit) -> Updated:
    path = out.parent / "verdicts.gpkg"
    write_edits(path, edits, LOCAL_METRES)
    return update(out, edits=path)


def pitched(out: Path) -> str:
    """A building whose roof is not flat."""
    _, _, rows, _ = read_polygons(out / "footprints.gpkg", "footprints")
    return next(row["id"] for row in rows if row["roof_type"] == "gable")


def test_a_building_that_is_none_goes__and_no_other_line_changes(out: Path) -> None:
    before, shapes = models(out), buildings(out)
    gone = next(iter(before))
    done = corrected(out, Edit(NO_BUILDING, shapes[gone], gone))
    assert done.corrected.removed == (gone,)
    after = models(out)
    assert set(after) == set(before) - {gone}
    assert all(after[name] == before[name] for name in after)
    assert check_folder(out) == []


def test_verdicts_that_the_page_saved_are_honoured(out: Path) -> None:
    gone = next(iter(models(out)))
    table = out.parent / "verdicts.csv"
    table.write_text(f'id,verdict\r\n"{gone}","no building"\r\n', encoding="utf-8")
    assert update(out, edits=table).corrected.removed == (gone,)
    table.write_text("id,verdict\nb0,no building\n", encoding="utf-8")
    with pytest.raises(InputError, match="row 1 names the building 'b0'"):
        update(out, edits=table)


def test_a_flat_roof_is_flat(out: Path) -> None:
    name = pitched(out)
    corrected(out, Edit(FLAT_ROOF, buildings(out)[name], name))
    _, _, rows, _ = read_polygons(out / "footprints.gpkg", "footprints")
    row = next(row for row in rows if row["id"] == name)
    assert (row["roof_type"], row["roof_face_count"], row["edit"]) == ("flat", 1, FLAT_ROOF)


def test_an_outline_is_used_as_it_is__and_says_so_in_the_cityjson(out: Path) -> None:
    name, shape = next(iter(buildings(out).items()))
    smaller = shapely.buffer(shape, -1.0, join_style="mitre")
    corrected(out, Edit(FOOTPRINT, smaller, name))
    assert (
        shapely.symmetric_difference(buildings(out)[name], smaller).area < 0.05
    )  # corners are whole millimetres
    told = read_cityjson(out / "buildings.city.jsonl")[name].attributes
    assert (told["edit"], told["edit_source"]) == (FOOTPRINT, "verdicts.gpkg")


def test_a_building_between_party_walls_becomes_two(out: Path) -> None:
    name, shape = next(iter(buildings(out).items()))
    west, south, east, north = shape.bounds
    middle = (west + east) / 2
    halves = [
        shapely.intersection(shape, shapely.box(a, south, b, north))
        for a, b in ((west, middle), (middle, east))
    ]
    corrected(out, *(Edit(PARTY_WALLS, half, name) for half in halves))
    after = buildings(out)
    assert len(after) == 10
    assert after[name].area + after[f"{name}-2"].area == pytest.approx(shape.area, rel=1e-4)


def test_what_was_taken_away_comes_back_where_the_edit_is_taken_back(out: Path) -> None:
    before, shapes = models(out), buildings(out)
    gone = next(iter(before))
    corrected(out, Edit(NO_BUILDING, shapes[gone], gone))
    write_edits(out / "edits.gpkg", [], LOCAL_METRES)
    update(out)
    assert models(out) == before


def test_a_building_is_one_again_by_a_later_verdict__and_the_conflict_is_told(out: Path) -> None:
    name, shape = next(iter(buildings(out).items()))
    corrected(out, Edit(NO_BUILDING, shape, name))
    done = corrected(out, Edit(IS_BUILDING, shape, name))
    assert name in models(out)
    assert any("later one holds" in told for told in done.corrected.conflicts)


@pytest.mark.filterwarnings("ignore:'crs' was not provided")
def test_edits_made_in_the_layer_itself(out: Path) -> None:
    path = out / "footprints.gpkg"
    frame = pyogrio.read_dataframe(path, layer="footprints")
    names = list(frame["id"])
    frame.loc[1, "geometry"] = frame.geometry[1].buffer(-0.5, join_style="mitre")
    pyogrio.write_dataframe(frame.drop(index=0), path, layer="footprints")
    done = update(out)
    assert done.corrected.removed == (names[0],)
    assert done.corrected.modelled == (names[1],)
    kept_edits = {(edit.id, edit.verdict) for edit in read_edits(out / "edits.gpkg", LOCAL_METRES)}
    assert kept_edits == {(names[0], NO_BUILDING), (names[1], FOOTPRINT)}
    again = update(out)
    assert len(again.edits) == 2
    assert names[0] not in buildings(out)


FILES = ("buildings.city.jsonl", "classified.laz", "review.csv")


@pytest.mark.slow
def test_a_run_that_kept_nothing_is_edited__with_the_same_bytes(out: Path, tmp_path: Path) -> None:
    plain = tmp_path / "plain"
    build_files(json.loads((out / "run.json").read_text())["inputs"][0]["path"], plain, outputs=OUTPUTS)
    assert not (plain / ".eaves-work").exists()
    names = list(buildings(out))
    edits = [
        Edit(verdict, buildings(out)[name], name)
        for name, verdict in zip(names, (NO_BUILDING, FLAT_ROOF), strict=False)
    ]
    assert (
        corrected(out, *edits).corrected.removed == corrected(plain, *edits).corrected.removed == (names[0],)
    )
    assert all((out / name).read_bytes() == (plain / name).read_bytes() for name in FILES)
    assert check_folder(plain) == []
    assert not (plain / ".eaves-work").exists()
    corrected(plain, Edit(IS_BUILDING, buildings(plain)[names[1]], names[1]))
    assert names[0] not in models(plain)


@pytest.mark.slow
def test_results_that_are_missing_are_computed_again__with_the_same_bytes(out: Path, tmp_path: Path) -> None:
    shutil.copytree(out, tmp_path / "without")
    for step in ("ground", "regions", "buildings"):
        shutil.rmtree(tmp_path / "without" / ".eaves-work" / step)
    name, shape = next(iter(buildings(out).items()))
    for folder in (out, tmp_path / "without"):
        corrected(folder, Edit(FLAT_ROOF, shape, name))
    assert all((out / name).read_bytes() == (tmp_path / "without" / name).read_bytes() for name in FILES)


@pytest.mark.slow
def test_an_update_that_was_broken_off_is_made_again__with_the_same_bytes(out: Path, tmp_path: Path) -> None:
    name, shape = next(iter(buildings(out).items()))
    edit, broken = Edit(FOOTPRINT, shapely.buffer(shape, -1.0, join_style="mitre"), name), tmp_path / "broken"
    shutil.copytree(out, broken)
    write_edits(tmp_path / "edit.gpkg", [edit], LOCAL_METRES)

    def stop(step: str, done: int, total: int) -> None:
        if step == "write" and done == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        update(broken, edits=tmp_path / "edit.gpkg", progress=stop)
    for folder in (out, broken):
        update(folder, edits=tmp_path / "edit.gpkg")
    assert all((out / name).read_bytes() == (broken / name).read_bytes() for name in FILES)
    assert not (broken / ".eaves-work" / "earlier").exists()


def test_an_edit_is_said_once__in_columns_of_the_table(out: Path) -> None:
    name, shape = next(iter(buildings(out).items()))
    corrected(out, Edit(FLAT_ROOF, shape, name))
    columns = pyogrio.read_info(out / "footprints.gpkg", layer="footprints")["fields"]
    assert [column for column in columns if "edit" in column] == ["edit", "edit_source"]


def test_an_edit_that_gives_no_model_says_so_in_its_row(out: Path) -> None:
    west, south, _, _ = shapely.union_all(list(buildings(out).values())).bounds
    far = shapely.box(west - 900.0, south, west - 890.0, south + 10.0)
    done = corrected(out, Edit(IS_BUILDING, far, "far"))
    assert [words.split(":")[0] for words in done.corrected.failed] == ["far"]
    _, _, rows, _ = read_polygons(out / "footprints.gpkg", "footprints")
    reason = next(row["failure_reason"] for row in rows if row["id"] == "far")
    assert reason.endswith("(edit: is a building, verdicts.gpkg)")


def test_a_building_that_a_person_drew_and_took_back_is_none(out: Path) -> None:
    before, drawn = models(out), shapely.box(0.0, 0.0, 10.0, 10.0)
    corrected(out, Edit(IS_BUILDING, drawn, "drawn"), Edit(NO_BUILDING, drawn, "drawn"))
    assert models(out) == before


def test_without_a_run_the_remedy_is_told(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError, match="build it again with --keep"):
        update(tmp_path / "out")


def test_a_verdict_that_is_not_known_is_refused__and_nothing_changes(out: Path) -> None:
    before = models(out)
    with pytest.raises(InputError, match="verdict 'maybe'; use one of"):
        corrected(out, Edit("maybe", shapely.box(0, 0, 1, 1), "x"))
    assert models(out) == before


def test_an_edit_without_an_id_is_of_the_building_at_its_place() -> None:
    outlines = {"a": shapely.box(0, 0, 10, 10), "b": shapely.box(20, 0, 30, 10)}
    orders, conflicts = settle([Edit(NO_BUILDING, shapely.box(21, 1, 29, 9))], outlines)
    assert [(order.id, order.outlines) for order in orders] == [("b", ())]
    assert conflicts == []
    orders, conflicts = settle([Edit(FLAT_ROOF, shapely.box(50, 0, 60, 10))], outlines)
    assert orders == []
    assert "no such building" in conflicts[0]
