"""A later scan of a part of the nine roofs: what changed is modelled as a full build would, others stay."""

import json
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace

import laspy
import numpy as np
import pyogrio
import pytest
import shapely
from pyproj import CRS

from eaves.blocks.superseded import GAP_CELLS, find_superseded, inputs_of_superseded, pair_same
from eaves.flow.edits import FLAT_ROOF, NO_BUILDING, Edit, write_edits
from eaves.formats import InputError, read_polygons
from eaves.model import Block
from eaves.model.block import ring
from eaves.model.coordinates import LOCAL_METRES
from eaves.run.keys import SUPERSEDED
from eaves.run.manifest import check_folder, lock_folder
from eaves.run.points import load_scans
from eaves.run.store import RECORD, Store
from eaves.simulate import nine_roofs_on_a_slope, write_simulation
from eaves.simulate.objects.houses import PITCH, sample_from_above
from eaves.upkeep.update import Updated, date_of, open_again, update
from eaves.upkeep.versions import lines_of, terminated
from tests.change.test_compare import GONE, RAISED, later_roofs
from tests.conftest import build_files, write_laz

OUTPUTS = ("footprints", "models", "classified")
HOME = Block(0, 0, 240.0)


def points_at(*places: Sequence[float]) -> np.ndarray:
    """Points (N,) of the block at the corner of the world, with their numbers."""
    records = np.zeros(len(places), RECORD)
    records["xyz"] = np.round(np.reshape(np.array(places, float), (-1, 3)) / 1e-4)
    records["point_id"] = np.arange(len(places))
    return records


def store_with(folder: Path, old: np.ndarray, *new: np.ndarray) -> Store:
    """A store with a file of earlier points and files of new ones."""
    store = Store(folder / "work")
    store.prepare()
    store.points_path(HOME).mkdir()
    for number, records in enumerate((old, *new)):
        records = records.copy()
        records["point_id"] += 1000 * number
        (store.points_path(HOME) / f"{number:07d}-0000.bin").write_bytes(records.tobytes())
    return store


def superseded(store: Store, *generations: int) -> dict[str, np.ndarray]:
    """What the points of later files take the place of in the block."""
    scans = {block: load_scans(store, block) for block in ring(HOME)}
    parameters = SimpleNamespace(generations=generations)
    return find_superseded(inputs_of_superseded(HOME, scans, parameters), parameters)


def test_points_alike_are_paired_one_to_one() -> None:
    old = points_at((1, 1, 0), (1, 1, 0), (2, 2, 0))
    new = points_at((2, 2, 0), (1, 1, 0), (2, 2, 0), (3, 3, 0))
    same, again = pair_same(old, new)
    assert same.sum() == 2 and same[2]
    assert again.sum() == 2 and again[1] and not again[3]


@pytest.mark.parametrize(("gap", "stays"), [(2 * GAP_CELLS, 0), (2 * GAP_CELLS + 1, 1)])
def test_earlier_points_give_way_in_gaps_up_to_their_width_alone(
    tmp_path: Path, gap: int, stays: int
) -> None:
    west = [(x + 0.5, y + 0.5, 0.0) for x in range(5) for y in range(9)]
    new = points_at(*west, *((x + 5 + gap, y, z) for x, y, z in west))
    store = store_with(tmp_path, points_at((6.5, 4.5, 1.0), (30.5, 4.5, 1.0)), new)
    result = superseded(store, 1)
    assert result["id"].tolist() == ([] if stays else [0])
    assert result["counts"].tolist() == [len(new), 1 - stays]


def test_what_is_covered_does_not_depend_on_the_tiles__nor_on_their_order(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    old = points_at(*(rng.random((400, 3)) * [40, 40, 5]))
    new = points_at(*(rng.random((300, 3)) * [40, 20, 5]))
    cut = new["xyz"][:, 0] < 173000
    left = []
    for k, tiles in enumerate(((new,), (new[cut], new[~cut]), (new[~cut], new[cut]))):
        store = store_with(tmp_path / str(k), old, *tiles)
        store.save(SUPERSEDED, HOME, superseded(store, 1))
        left.append(sorted(map(tuple, store.read_points(HOME)["xyz"].tolist())))
        assert store.count_points(HOME) == len(left[-1])
    assert left[0] == left[1] == left[2]
    assert len(new) < len(left[0]) < len(old) + len(new)


def test_a_tile_delivered_again_changes_nothing(tmp_path: Path) -> None:
    old = points_at(*(np.random.default_rng(6).random((200, 3)) * 20))
    store = store_with(tmp_path, old, old[::-1])
    store.save(SUPERSEDED, HOME, superseded(store, 1))
    assert np.array_equal(store.read_points(HOME), old)


def test_only_what_goes_for_the_last_scan_has_gone__no_copies_nor_what_went_before(tmp_path: Path) -> None:
    west = [(x + 0.5, y + 0.5, 0.0) for x in range(9) for y in range(9)]
    moved, east = ([(x + away, y, z + 0.1) for x, y, z in west] for away in (0.0, 9.0))
    old = points_at(*west, *((x, y, 3.0) for x, y, _ in east))
    store = store_with(tmp_path, old, points_at(*moved), points_at(*moved[-18:], *east))
    result = superseded(store, 1, 2)
    assert result["counts"].tolist() == [81, 81]
    assert np.sort(result["gone"]).tolist() == list(range(81, 162))
    assert len(result["id"]) == 81 + 81 + 18


def test_a_version_that_ended_has_an_id_of_its_own__and_its_parts_too() -> None:
    objects = {
        "b1": {"type": "Building", "attributes": {"version": 2}, "children": ["b1-1"], "geometry": []},
        "b1-1": {"type": "BuildingPart", "parents": ["b1"], "geometry": []},
    }
    told = json.loads(
        terminated(json.dumps({"id": "b1", "CityObjects": objects, "vertices": []}), "2026-05-01")
    )
    assert told["id"] == "b1@2"
    assert list(told["CityObjects"]) == ["b1@2", "b1@2-1"]
    assert told["CityObjects"]["b1@2-1"]["parents"] == ["b1@2"]
    about = told["CityObjects"]["b1@2"]["attributes"]
    assert (about["identifier"], about["terminationDate"]) == ("b1", "2026-05-01")


def test_a_date_is_checked() -> None:
    assert date_of([], "2026-05-01") == "2026-05-01"
    with pytest.raises(InputError, match="write it as 2026-05-31"):
        date_of([], "May 2026")


def test_without_kept_parts_the_remedy_is_told(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError, match="build it again with --keep"):
        update(tmp_path / "out", tmp_path, tmp_path / "out2")
    assert not (tmp_path / "out2").exists()


@pytest.fixture(scope="module")
def epochs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`out`, a run of the nine roofs that keeps its parts; `tiles`, a later scan of a part, in two files."""
    place = tmp_path_factory.mktemp("update")
    first = nine_roofs_on_a_slope(density=8.0, seed=1)
    build_files(write_simulation(first, place / "old")["points"], place / "out", keep=True, outputs=OUTPUTS)
    second = sample_from_above(later_roofs(first), 3 * PITCH, 8.0, 0.03, seed=2)
    las = laspy.read(write_simulation(second, place / "new")["points"])
    (place / "tiles").mkdir()
    for number in (GONE, RAISED):
        footprint = next(one.footprint for one in first.buildings if one.number == number)
        west, south, east, north = footprint.buffer(4.0).bounds
        xy = np.column_stack([las.x, las.y]) - first.cloud.origin
        inside = (xy[:, 0] >= west) & (xy[:, 0] < east) & (xy[:, 1] >= south) & (xy[:, 1] < north)
        tile = laspy.LasData(las.header)
        tile.points = las.points[inside].copy()
        tile.write(place / "tiles" / f"{number}.laz")
    return place


@pytest.fixture(scope="module")
def updated(epochs: Path) -> Updated:
    return update(epochs / "out", epochs / "tiles", epochs / "out2", date="2026-05-01")


def shapes(folder: Path) -> dict[str, tuple[str, list[list[int]]]]:
    """Geometry and attributes of each building, whatever it and its versions are called."""
    told = {}
    for name, line in lines_of(folder / "buildings.city.jsonl").items():
        feature = json.loads(line)
        geometries = [one.get("geometry") for one in feature["CityObjects"].values()]
        about = [one.get("attributes", {}) for one in feature["CityObjects"].values()]
        named = ("version", "creationDate", "block_id")
        about = [{key: value for key, value in one.items() if key not in named} for one in about]
        levels = [[(g["lod"], g["boundaries"]) for g in some] for some in geometries]
        told[name] = json.dumps([levels, about]), feature["vertices"]
    return told


@pytest.mark.slow
def test_one_goes_and_one_is_modelled_again__the_others_keep_their_lines(
    epochs: Path, updated: Updated
) -> None:
    before, after = (lines_of(epochs / name / "buildings.city.jsonl") for name in ("out", "out2"))
    versions = updated.versions
    assert (len(versions.new), len(versions.remodelled), len(versions.gone)) == (0, 1, 1)
    assert set(after) == set(before) - set(versions.gone)
    assert all(after[name] == before[name] for name in after if name not in versions.remodelled)
    feature = json.loads(after[versions.remodelled[0]])
    about = feature["CityObjects"][feature["id"]]["attributes"]
    assert (about["version"], about["creationDate"]) == (2, "2026-05-01")
    history = lines_of(epochs / "out2" / "history.city.jsonl")
    assert set(history) == {f"{name}@1" for name in (*versions.gone, *versions.remodelled)}
    assert check_folder(epochs / "out2") == check_folder(epochs / "out") == []


@pytest.mark.slow
def test_an_update_gives_what_a_build_of_what_stays_and_what_is_new_gives(
    epochs: Path, updated: Updated
) -> None:
    run = open_again(epochs / "out2")
    store = Store(run.work_folder)
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, places, records = [1e-4] * 3, [], []
    for block in store.blocks(run.side):
        records.append(store.read_points(block))
        places.append(records[-1]["xyz"] * 1e-4 + np.array([*block.origin, 0.0]))
    xyz, known = np.concatenate(places), np.concatenate(records)
    header.offsets = np.floor(xyz.min(axis=0))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    for name in ("return_number", "number_of_returns", "classification"):
        las[name] = known[name]
    las.write(epochs / "merged.laz")
    build_files(epochs / "merged.laz", epochs / "whole", outputs=("footprints", "models"))
    whole, mine = (sorted(shapes(epochs / name).values()) for name in ("whole", "out2"))
    assert len(whole) == len(mine) == 8
    assert whole == mine


@pytest.mark.slow
def test_the_classified_points_withhold_what_gave_way(epochs: Path, updated: Updated) -> None:
    las = laspy.read(epochs / "out2" / "classified_points.laz")
    assert int(np.sum(las.withheld)) == updated.points_changed[1] > 0


@pytest.mark.slow
def test_edits_are_kept__and_an_update_follows_an_update(epochs: Path, updated: Updated) -> None:
    shutil.copytree(epochs / "out2", epochs / "corrected")
    polygons, _, rows, _ = read_polygons(epochs / "corrected" / "footprints.gpkg", "footprints")
    outlines = {row["id"]: polygon for polygon, row in zip(polygons, rows, strict=True)}
    kept = next(name for name in outlines if name not in updated.versions.remodelled)
    write_edits(epochs / "edit.gpkg", [Edit(NO_BUILDING, outlines[kept], kept)], LOCAL_METRES)
    update(epochs / "corrected", edits=epochs / "edit.gpkg")
    before = lines_of(epochs / "corrected" / "buildings.city.jsonl")
    (epochs / "back").mkdir()
    las = laspy.read(epochs / "old" / "points.laz")
    inside = shapely.contains_xy(outlines[updated.versions.remodelled[0]].buffer(5.0), las.x, las.y)
    tile = laspy.LasData(las.header)
    tile.points = las.points[inside].copy()
    tile.write(epochs / "back" / "back.laz")
    done = update(epochs / "corrected", epochs / "back", epochs / "out3", date="2027-05-01")
    after = lines_of(epochs / "out3" / "buildings.city.jsonl")
    assert done.versions.remodelled == updated.versions.remodelled
    assert set(after) == set(before)
    assert kept not in after
    assert {name for name in after if after[name] != before[name]} == set(done.versions.remodelled)
    again = update(epochs / "out3")
    assert again.corrected.removed == (kept,)
    assert lines_of(epochs / "out3" / "buildings.city.jsonl") == after


@pytest.mark.slow
def test_what_cannot_be_updated_is_told(epochs: Path, tmp_path: Path) -> None:
    tile = epochs / "tiles" / f"{RAISED}.laz"
    with pytest.raises(InputError, match="choose another with -o"):
        update(epochs / "out", tile, epochs / "out", date="2026-05-01")
    with pytest.raises(InputError, match="is an input of"):
        update(epochs / "out", epochs / "old" / "points.laz", tmp_path / "o", date="2026-05-01")
    las = laspy.read(tile)
    las.x = np.asarray(las.x) + 5000.0
    las.write(tmp_path / "far.laz")
    with pytest.raises(InputError, match="km from all points of the run"):
        update(epochs / "out", tmp_path / "far.laz", tmp_path / "o", date="2026-05-01")
    las = laspy.read(tile)
    las.header.add_crs(CRS("EPSG:28992"))
    las.write(tmp_path / "other.laz")
    with pytest.raises(InputError, match="system"):
        update(epochs / "out", tmp_path / "other.laz", tmp_path / "o", date="2026-05-01")
    with pytest.raises(InputError, match="does not exist"):
        update(epochs / "out", tmp_path / "nowhere", tmp_path / "o", date="2026-05-01")
    with pytest.raises(InputError, match="among its results"):
        update(epochs / "out", epochs / "out", tmp_path / "o", date="2026-05-01")
    (tmp_path / "empty.laz").touch()
    with pytest.raises(InputError, match="empty"):
        update(epochs / "out", tmp_path / "empty.laz", tmp_path / "o", date="2026-05-01")
    laspy.LasData(laspy.LasHeader(version="1.4", point_format=6)).write(tmp_path / "none.laz")
    with pytest.raises(InputError, match="has no point"):
        update(epochs / "out", tmp_path / "none.laz", tmp_path / "o", date="2026-05-01")
    assert not list((tmp_path / "o").glob(".*"))


WRITTEN = ("buildings.city.jsonl", "history.city.jsonl", "classified_points.laz", "classified_2.laz")


def numbers_of(folder: Path) -> dict[str, int]:
    """Id → number of a run's buildings."""
    _, _, rows, _ = read_polygons(folder / "footprints.gpkg", "footprints")
    return {row["id"]: row["number"] for row in rows}


@pytest.mark.slow
def test_numbers_stay_with_their_buildings__also_behind_one_that_went(epochs: Path, updated: Updated) -> None:
    before, after = numbers_of(epochs / "out"), numbers_of(epochs / "out2")
    assert all(before[name] == number for name, number in after.items())
    old, new = (laspy.read(epochs / name) for name in ("out/classified.laz", "out2/classified_points.laz"))
    touched = [before[one] for one in (*updated.versions.gone, *updated.versions.remodelled)]
    stays = ~np.isin(old.building_id, touched) & ~np.isin(new.building_id, touched)
    stays &= ~np.asarray(new.withheld, bool)
    assert np.array_equal(old.building_id[stays], new.building_id[stays])
    assert np.array_equal(old.plane_id[stays], new.plane_id[stays])


@pytest.mark.slow
def test_two_processes_write_the_same_bytes(epochs: Path, updated: Updated, tmp_path: Path) -> None:
    update(epochs / "out", epochs / "tiles", tmp_path / "out2", date="2026-05-01", jobs=2)
    assert all(
        (tmp_path / "out2" / name).read_bytes() == (epochs / "out2" / name).read_bytes() for name in WRITTEN
    )


@pytest.mark.slow
def test_inputs_whose_folder_has_moved_are_reached_through_a_link(
    epochs: Path, updated: Updated, tmp_path: Path
) -> None:
    folder = epochs / "old"
    moved = folder.rename(epochs / "zz-old")
    folder.symlink_to(moved)
    try:
        update(epochs / "out", epochs / "tiles", tmp_path / "out2", date="2026-05-01")
    finally:
        folder.unlink()
        moved.rename(folder)
    models = "buildings.city.jsonl"
    assert (tmp_path / "out2" / models).read_bytes() == (epochs / "out2" / models).read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("step", ["points", "regions", "buildings", "write"])
def test_an_update_that_was_stopped_can_be_made_again(
    epochs: Path, updated: Updated, tmp_path: Path, step: str
) -> None:
    def stop(now: str, done: int, total: int) -> None:
        if now == step:
            raise KeyboardInterrupt

    out = tmp_path / "out2"
    with pytest.raises(KeyboardInterrupt):
        update(epochs / "out", epochs / "tiles", out, date="2026-05-01", progress=stop)
    assert step == "points" or check_folder(out)
    assert check_folder(epochs / "out") == []
    update(epochs / "out", epochs / "tiles", out, date="2026-05-01")
    assert all((out / name).read_bytes() == (epochs / "out2" / name).read_bytes() for name in WRITTEN)
    assert check_folder(out) == []


@pytest.mark.slow
def test_an_update_that_was_killed_can_be_made_again(epochs: Path, updated: Updated, tmp_path: Path) -> None:
    out = tmp_path / "out2"
    lines = [
        "import os, signal; from pathlib import Path; from eaves.upkeep.update import update",
        "def stop(step, done, total): step == 'regions' and os.kill(os.getpid(), signal.SIGKILL)",
        f"update(Path({str(epochs / 'out')!r}), {str(epochs / 'tiles')!r}, Path({str(out)!r}), "
        "date='2026-05-01', progress=stop)",
    ]
    assert subprocess.run([sys.executable, "-c", "\n".join(lines)], check=False).returncode == -signal.SIGKILL
    update(epochs / "out", epochs / "tiles", out, date="2026-05-01")
    assert all((out / name).read_bytes() == (epochs / "out2" / name).read_bytes() for name in WRITTEN)


@pytest.mark.slow
@pytest.mark.parametrize("held", ["out", "out2"])
def test_two_updates_at_once_are_refused(epochs: Path, tmp_path: Path, held: str) -> None:
    places = {"out": epochs / "out", "out2": tmp_path / "out2"}
    places["out2"].mkdir()
    with lock_folder(places[held]), pytest.raises(InputError, match="wait for it, or choose another") as told:
        update(places["out"], epochs / "tiles", places["out2"], date="2026-05-01")
    assert "\n" not in str(told.value)
    assert not (places["out2"] / ".eaves-work").exists()


@pytest.mark.slow
def test_points_known_already_change_nothing(epochs: Path, tmp_path: Path) -> None:
    las = laspy.read(epochs / "old" / "points.laz")
    tile = laspy.LasData(las.header)
    tile.points = las.points[np.asarray(las.x) < np.floor(np.median(las.x))].copy()
    tile.write(tmp_path / "again.laz")
    done = update(epochs / "out", tmp_path / "again.laz", tmp_path / "out2", date="2026-05-01")
    assert (done.points_changed, done.blocks[0]) == ((0, 0), 0)
    named = done.versions
    assert not (named.new or named.remodelled or named.gone)
    old, new = (place / "buildings.city.jsonl" for place in (epochs / "out", tmp_path / "out2"))
    assert lines_of(old) == lines_of(new)
    assert not (tmp_path / "out2" / "history.city.jsonl").exists()
    old, new = epochs / "out" / "classified.laz", tmp_path / "out2" / "classified_points.laz"
    assert old.read_bytes() == new.read_bytes()


@pytest.mark.slow
def test_names_of_an_update_stay_in_one_that_changes_nothing(
    epochs: Path, updated: Updated, tmp_path: Path
) -> None:
    shutil.copy(epochs / "tiles" / f"{RAISED}.laz", tmp_path / "again.laz")
    done = update(epochs / "out2", tmp_path / "again.laz", tmp_path / "out3", date="2027-05-01")
    assert (done.points_changed, done.blocks[0]) == ((0, 0), 0)
    old, new = (place / "buildings.city.jsonl" for place in (epochs / "out2", tmp_path / "out3"))
    assert lines_of(old) == lines_of(new)


@pytest.mark.slow
def test_an_edited_building_that_changed_has_its_next_version(
    epochs: Path, updated: Updated, tmp_path: Path
) -> None:
    shutil.copytree(epochs / "out", tmp_path / "out")
    name = updated.versions.remodelled[0]
    polygons, _, rows, _ = read_polygons(tmp_path / "out" / "footprints.gpkg", "footprints")
    outline = next(one for one, row in zip(polygons, rows, strict=True) if row["id"] == name)
    write_edits(tmp_path / "edit.gpkg", [Edit(FLAT_ROOF, outline, name)], LOCAL_METRES)
    update(tmp_path / "out", edits=tmp_path / "edit.gpkg")
    update(tmp_path / "out", epochs / "tiles", tmp_path / "out2", date="2026-05-01")
    feature = json.loads(lines_of(tmp_path / "out2" / "buildings.city.jsonl")[name])
    about = feature["CityObjects"][name]["attributes"]
    assert about["edit"] and (about["version"], about["creationDate"]) == (2, "2026-05-01")
    assert f"{name}@1" in lines_of(tmp_path / "out2" / "history.city.jsonl")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:'crs' was not provided")
def test_edits_that_wait_in_the_layer_are_carried_over(epochs: Path, tmp_path: Path) -> None:
    shutil.copytree(epochs / "out", tmp_path / "out")
    path = tmp_path / "out" / "footprints.gpkg"
    frame = pyogrio.read_dataframe(path, layer="footprints")
    gone = frame["id"][0]
    pyogrio.write_dataframe(frame.drop(index=0), path, layer="footprints")
    done = update(tmp_path / "out", epochs / "tiles", tmp_path / "out2", date="2026-05-01")
    assert gone not in lines_of(tmp_path / "out2" / "buildings.city.jsonl")
    assert [(edit.id, edit.verdict) for edit in done.edits] == [(gone, NO_BUILDING)]
    assert not (tmp_path / "out" / "edits.gpkg").exists()


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.36, 0.5, 0.64])
def test_points_that_come_beside_those_of_a_run_give_the_build_of_both(share: float, tmp_path: Path) -> None:
    scene = nine_roofs_on_a_slope(density=4.0, noise=0.04)
    xyz = scene.cloud.xyz + [85000.0, 447000.0, 0.0]
    cut = np.floor(np.quantile(xyz[:, 0], share))
    for name, inside in (("west", xyz[:, 0] < cut), ("east", xyz[:, 0] >= cut)):
        write_laz(tmp_path / f"{name}.laz", xyz[inside])
    parts = [tmp_path / "west.laz", tmp_path / "east.laz"]
    outputs = ("footprints", "models")
    build_files(parts[0], tmp_path / "first", outputs=outputs, keep=True)
    update(tmp_path / "first", parts[1], tmp_path / "second", date="2026-05-01")
    build_files(parts, tmp_path / "whole", outputs=outputs)
    whole, mine = (sorted(shapes(tmp_path / name).values()) for name in ("whole", "second"))
    assert whole == mine


@pytest.mark.slow
def test_copies_of_earlier_points_around_new_ones_confirm_no_building(tmp_path: Path) -> None:
    scene = nine_roofs_on_a_slope(density=4.0, noise=0.04)
    xyz = np.round(scene.cloud.xyz + [85000.0, 447000.0, 0.0], 3)
    cut = xyz[scene.building == 4, 0].max() - 0.3  # so little is new of the house that it would be confirmed
    for name, inside in (("west", xyz[:, 0] < cut), ("east", xyz[:, 0] >= np.floor(cut - 6.0))):
        write_laz(tmp_path / f"{name}.laz", xyz[inside])
    parts = [tmp_path / "west.laz", tmp_path / "east.laz"]
    build_files(parts[0], tmp_path / "first", outputs=("footprints", "models"), keep=True)
    update(tmp_path / "first", parts[1], tmp_path / "second", date="2026-05-01")
    build_files(parts, tmp_path / "whole", outputs=("footprints", "models"))
    whole, mine = (sorted(shapes(tmp_path / name).values()) for name in ("whole", "second"))
    assert whole == mine
