"""Scans with more points than are needed: few decide, all are classified."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
from tests.conftest import build_files, build_in_blocks

from eaves.blocks.points import ENOUGH_PER_M2, SIDE, find_thinned
from eaves.model import GRID_STEP, Block
from eaves.model.cloud import canonical_order
from eaves.run.store import RECORD
from eaves.simulate import nine_roofs_on_a_slope, write_simulation


def records_of(density: float) -> np.ndarray:
    """Points over two thirds of a block, in canonical order."""
    rng = np.random.default_rng(1)
    count = round(density * 60.0 * 40.0)
    records = np.zeros(count, RECORD)
    records["xyz"] = rng.integers([0, 100_000, 0], [600_000, 500_000, 300], (count, 3))
    records["return_number"], records["point_id"] = 1, rng.permutation(count)
    return records.take(canonical_order(records["xyz"] * GRID_STEP, records["return_number"]))


@pytest.mark.parametrize("files", [1, 3])
def test_a_dense_block_keeps_one_point_a_cell__however_files_cut_it(files: int) -> None:
    records = records_of(4.0 * ENOUGH_PER_M2)
    parts = [records[first::files].copy() for first in range(files)]
    result = find_thinned((Block(0, 0, 60.0), parts), None)
    kept, stands = result["records"].view(RECORD), result["stands"]
    everyone = np.concatenate(parts)
    assert 0.95 < len(kept) * SIDE**2 / (60.0 * 40.0) <= 1.0
    assert np.array_equal(np.unique(stands), np.arange(len(kept)))
    assert np.array_equal(canonical_order(kept["xyz"] * GRID_STEP), np.arange(len(kept)))
    cells = round(SIDE / GRID_STEP)
    assert (everyone["xyz"][:, :2] // cells == kept["xyz"][stands][:, :2] // cells).all()
    alone = find_thinned((Block(0, 0, 60.0), [records]), None)
    assert np.array_equal(alone["records"], result["records"])


def test_a_block_with_fewer_points_keeps_all() -> None:
    assert not find_thinned((Block(0, 0, 60.0), [records_of(0.95 * ENOUGH_PER_M2)]), None)
    assert find_thinned((Block(0, 0, 60.0), [records_of(1.05 * ENOUGH_PER_M2)]), None)


@pytest.mark.slow
def test_all_points_of_a_dense_scan_have_their_class_building_and_plane(tmp_path: Path) -> None:
    scene = nine_roofs_on_a_slope(density=1.5 * ENOUGH_PER_M2, noise=0.02)
    path = write_simulation(scene, tmp_path / "scan")["points"]
    build_files(path, tmp_path / "out", formats=("cityjson",), keep=True)
    assert list((tmp_path / "out/.eaves-work").glob("thinned/*.part"))
    written = laspy.read(tmp_path / "out" / "classified.laz")
    assert len(written.points) == len(scene.cloud)
    building, plane = np.asarray(written["building_id"]), np.asarray(written["plane_id"])
    roof = scene.plane > 0
    assert (building[roof] > 0).mean() > 0.99 and (building[~roof] > 0).mean() < 0.01
    assert (plane[roof] > 0).mean() > 0.99
    assert (np.asarray(written.classification) == scene.truth_class)[~roof].mean() > 0.99
    shares = []
    for number in scene.faces:
        counts = np.unique(plane[scene.plane == number], return_counts=True)[1]
        shares.append(counts.max() / counts.sum())
    assert min(shares) > 0.9 and np.mean(shares) > 0.98  # of a cell across a ridge all go with one


@pytest.fixture(scope="module")
def halves(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A dense scan in one file and in two."""
    folder = tmp_path_factory.mktemp("dense")
    scene = nine_roofs_on_a_slope(density=1.5 * ENOUGH_PER_M2, noise=0.02)
    whole = write_simulation(scene, folder / "scan")["points"]
    las = laspy.read(whole)
    west = np.asarray(las.x) < 0.5 * (las.x.min() + las.x.max())
    (folder / "cut").mkdir()
    for name, mask in {"a": west, "b": ~west}.items():
        part = laspy.LasData(las.header)
        part.points = las.points[mask]
        part.write(folder / "cut" / f"{name}.laz")
    return {"one": whole, "two": folder / "cut"}


@pytest.mark.slow
def test_files_and_tiles_may_cut_a_dense_scan_anyhow(halves: dict[str, Path], tmp_path: Path) -> None:
    models = []
    for name, per_tile in (("one", False), ("two", False), ("two", True)):
        out = tmp_path / f"{name}-{per_tile}"
        build_in_blocks(60.0, halves[name], out, outputs=("models",), per_tile=per_tile)
        models.append((out / "buildings.city.jsonl").read_text().splitlines())
    assert len(models[0]) == 10 and models[0][1:] == models[1][1:] == models[2][1:]


@pytest.mark.slow
def test_a_run_that_goes_on_thins_nothing_again(halves: dict[str, Path], tmp_path: Path) -> None:
    out, options = tmp_path / "out", {"keep": True, "outputs": ("models",)}
    times = []
    for resume in (False, True):
        assert build_in_blocks(60.0, halves["two"], out, resume=resume, **options).complete
        paths = (out / ".eaves-work" / "thinned").glob("*.part")
        times.append({path.name: path.stat().st_mtime_ns for path in paths})
    assert times[0] == times[1] != {}


def copied(records: np.ndarray, count: int, **changes: int) -> np.ndarray:
    """The first records again, with ids of their own and other values, in canonical order."""
    again = records[:count].copy()
    again["point_id"] += len(records)
    for name, value in changes.items():
        again[name] = value
    return again


@pytest.mark.parametrize("files", [1, 2])
def test_a_point_delivered_again_counts_once__in_one_file_and_in_two(files: int) -> None:
    records = records_of(15.0)
    parts = [records, copied(records, 5000, classification=6)]
    if files == 1:
        joined = np.concatenate(parts)
        parts = [joined.take(canonical_order(joined["xyz"] * GRID_STEP, joined["return_number"]))]
    result = find_thinned((Block(0, 0, 60.0), parts), None)
    kept = result["records"].view(RECORD)
    assert np.array_equal(kept["xyz"], records["xyz"]) and result["copies"][0] == 5000
    assert (kept["classification"] == 6).sum() == 5000
    first, second = result["copies"][1:]
    assert {int(first), int(second)} & set(range(len(records))) and abs(second - first) == len(records)
    everyone = np.concatenate(parts)
    assert np.array_equal(kept["xyz"][result["stands"]], everyone["xyz"])


@pytest.mark.parametrize("name", ["return_number", "number_of_returns", "moment"])
def test_points_of_another_pulse_or_return_are_no_copies(name: str) -> None:
    records = records_of(15.0)
    assert not find_thinned((Block(0, 0, 60.0), [records, copied(records, 5000, **{name: 7})]), None)


def test_a_scan_that_is_dense_by_its_copies_alone_is_not_thinned() -> None:
    records = records_of(0.8 * ENOUGH_PER_M2)
    result = find_thinned((Block(0, 0, 60.0), [records, copied(records, len(records))]), None)
    assert len(result["records"].view(RECORD)) == len(records)


def tiles_of_nine(folder: Path, times: bool = True, buffer: float = 0.0) -> tuple[Path, list[Path]]:
    """The nine roofs as one file, and as two tiles with a buffer."""
    scene = nine_roofs_on_a_slope(density=4.0, noise=0.02)
    xyz = scene.cloud.xyz + [85000.0, 447000.0, 0.0]
    middle = np.median(xyz[:, 0])
    paths = []
    for name, inside in (
        ("all", np.ones(len(xyz), bool)),
        ("west", xyz[:, 0] < middle + buffer),
        ("east", xyz[:, 0] >= middle - buffer),
    ):
        header = laspy.LasHeader(point_format=6 if times else 0, version="1.4")
        header.scales, header.offsets = np.full(3, 0.001), np.array([85000.0, 447000.0, 0.0])
        las = laspy.LasData(header)
        las.xyz = xyz[inside]
        if times:
            las.gps_time = np.flatnonzero(inside) * 1e-5
        paths.append(folder / f"{name}.laz")
        las.write(paths[-1])
    return paths[0], paths[1:]


@pytest.mark.slow
@pytest.mark.parametrize("times", [True, False])
def test_tiles_with_a_buffer_give_the_models_of_the_points_alone__and_it_is_said(
    times: bool, tmp_path: Path
) -> None:
    whole, tiles = tiles_of_nine(tmp_path, times, buffer=15.0)
    plain = build_files(whole, tmp_path / "plain", outputs=("footprints", "models"))
    again = build_files(tiles, tmp_path / "again", outputs=("footprints", "models", "classified"))
    lines = [
        (tmp_path / name / "buildings.city.jsonl").read_text().splitlines()[1:] for name in ("plain", "again")
    ]
    assert lines[0] == lines[1] and not plain.remarks
    (remark,) = again.remarks
    assert remark.startswith(f"{again.points - plain.points:,} of {again.points:,} points are identical")
    assert "east.laz and west.laz" in remark
    classes = [
        np.asarray(laspy.read(tmp_path / "again" / f"classified_{n}.laz").classification)
        for n in ("west", "east")
    ]
    assert all((one > 0).all() for one in classes)


def test_points_on_the_shared_edge_of_tiles_count_once(tmp_path: Path) -> None:
    whole, _ = tiles_of_nine(tmp_path)
    las = laspy.read(whole)
    x = np.asarray(las.X)
    edge = np.sort(x)[len(x) // 2]
    tiles = []
    for name, inside in (("w", x <= edge), ("e", x >= edge)):
        tile = laspy.LasData(las.header)
        tile.points = las.points[inside].copy()
        tiles.append(tmp_path / f"{name}.laz")
        tile.write(tiles[-1])
    again = build_files(tiles, tmp_path / "again", outputs=("footprints",))
    twice = int((x == edge).sum())
    (remark,) = again.remarks
    assert twice > 0 and remark.startswith(f"{twice} of {len(x) + twice:,} points are identical")
