"""Scans of other kinds, each made of one drawn scan: its figures say what it is, and of the whole nothing."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pytest
from scipy import ndimage
from tests.conftest import write_laz
from typer.testing import CliRunner

from eaves import Summary
from eaves.cli.app import make_app
from eaves.flow.advice import POINT_S, ROOF_POINT_S, START_S, ScanFacts, _cover, scan_facts
from eaves.flow.run import open_run, plan_run
from eaves.pipeline import build_run, hold_folder
from eaves.run.index import index_inputs
from eaves.simulate import scan_town, simulate_town, write_simulation

Change = Callable[[laspy.LasData], None]


def whole(las: laspy.LasData) -> None:
    """The scan as it is."""


def no_returns(las: laspy.LasData) -> None:
    """Pulses without numbers of returns."""
    las.return_number[:] = las.number_of_returns[:] = 0


def single(las: laspy.LasData) -> None:
    """Only pulses with one return."""
    las.points = las.points[np.asarray(las.number_of_returns) == 1]


def last(las: laspy.LasData) -> None:
    """The last return of each pulse."""
    las.points = las.points[np.asarray(las.return_number) == np.asarray(las.number_of_returns)]


def first(las: laspy.LasData) -> None:
    """The first return of each pulse."""
    las.points = las.points[np.asarray(las.return_number) == 1]


def matched(las: laspy.LasData) -> None:
    """Nothing that only a scanner writes."""
    single(las)
    for name in ("gps_time", "scan_angle", "point_source_id", "intensity"):
        las[name][:] = 0


def at_zero(las: laspy.LasData) -> None:
    """Ground at 0, and the lowest points of each cell."""
    las.z = np.where(np.asarray(las.classification) == 2, 0.0, np.asarray(las.z) + 1.0)
    place = np.floor(np.column_stack([las.x, las.y]) / 24).astype(int)
    for cell in np.unique(place, axis=0):  # the floor of a cell without ground, too
        las.z[np.flatnonzero((place == cell).all(axis=1))[:200]] = 0.0


def noise_below(las: laspy.LasData) -> None:
    """Five points 60 m below."""
    las.z[:5] -= 60.0


def clipped(las: laspy.LasData) -> None:
    """Points on buildings alone."""
    las.points = las.points[np.asarray(las.building_id) > 0]


def one_strip(las: laspy.LasData) -> None:
    """One of the strips."""
    las.points = las.points[np.asarray(las.point_source_id) == las.point_source_id[0]]


def shifted(las: laspy.LasData) -> None:
    """One of the strips 0.2 m higher."""
    las.z += 0.2 * (np.asarray(las.point_source_id) == las.point_source_id[0])


KINDS: dict[str, tuple[Change, str]] = {
    "whole": (whole, ""),
    "no returns": (no_returns, "no return numbers"),
    "single": (single, "0 % of pulses split"),
    "last only": (last, "last returns only"),
    "first only": (first, "first returns only"),
    "image matching": (matched, "no pulses"),
    "above ground": (at_zero, "the ground is at 0"),
    "noise": (noise_below, "5 points more than 24 m below"),
    "clipped": (clipped, "as clipped to footprints"),
    "one strip": (one_strip, "one strip:"),
    "strips apart": (shifted, "strips differ by 0.2"),
}


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    town = simulate_town(0.01, seed=3)
    return write_simulation(scan_town(town, density=3.0, seed=3), tmp_path_factory.mktemp("town"))["points"]


def facts_of(path: Path) -> ScanFacts:
    return scan_facts(index_inputs([path], "metres", []))


def changed(scan: Path, place: Path, change: Change) -> ScanFacts:
    las = laspy.read(scan)
    change(las)
    las.write(place / "changed.laz")
    return facts_of(place / "changed.laz")


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "whole"])
def test_scan_of_another_kind_is_said__and_of_the_whole_scan_nothing(
    kind: str, scan: Path, tmp_path: Path
) -> None:
    change, words = KINDS[kind]
    assert any(words in line for line in changed(scan, tmp_path, change).remarks())
    assert not any(words in line for line in facts_of(scan).remarks())


def test_figures_of_a_whole_scan_are_those_of_its_records(scan: Path) -> None:
    las, facts = laspy.read(scan), facts_of(scan)
    first_returns = np.asarray(las.return_number) == 1
    assert facts.whole and facts.points == len(las.points)
    assert facts.split_share == pytest.approx((las.number_of_returns[first_returns] > 1).mean(), abs=1e-4)
    assert facts.strips == len(np.unique(las.point_source_id))
    assert facts.classes == {
        str(c): int((las.classification == c).sum()) for c in np.unique(las.classification)
    }


def test_time_follows_from_the_points_and_those_on_roofs(tmp_path: Path) -> None:
    x, y = (axis.ravel() for axis in np.mgrid[0:96:0.25, 0:96:0.25])
    roof = (x % 48 < 16) & (y % 48 < 16)
    for name, z in (("field", 0.0 * x), ("roofs", 6.0 * roof), ("hill", 0.05 * x)):
        write_laz(tmp_path / f"{name}.laz", np.column_stack([x, y, z + 10.0]), None)
        more = facts_of(tmp_path / f"{name}.laz").cpu_s - START_S - POINT_S * len(x)
        true = ROOF_POINT_S * roof.sum() if name == "roofs" else 0.0
        assert 0.7 * true - 0.1 < more < true + 0.1


def test_info_and_dry_run_write_nothing(scan: Path, tmp_path: Path) -> None:
    runner, out = CliRunner(), tmp_path / "out"
    told = runner.invoke(make_app(), ["info", str(scan), "--json", "--quiet"])
    assert json.loads(told.stdout)["points"] == laspy.read(scan).header.point_count
    dry = runner.invoke(make_app(), ["build", str(scan), "-o", str(out), "--dry-run", "--quiet"])
    assert dry.exit_code == 0 and "split pulses" in dry.stdout and not out.exists()


def echoes(path: Path, foot: float, seed: int = 0) -> Path:
    """A scan of flat land under crowns, of pulses of two echoes off the nadir, heights in a unit (m)."""
    rng = np.random.default_rng(seed)
    count, angle = 2000, rng.uniform(-20.0, 20.0, 2000).round()
    ground = np.column_stack([rng.uniform(0.0, 200.0, (count, 2)), np.zeros(count)])
    depth = rng.uniform(3.0, 15.0, count)
    ahead = np.radians(rng.normal(0.0, 2.0, count))
    way = np.column_stack([np.tan(np.radians(angle)), np.tan(ahead), np.ones(count)])
    xyz = np.stack([ground + way * depth[:, None], ground], axis=1).reshape(-1, 3)
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, 0.001), np.array([400_000.0, 5_700_000.0, 0.0])
    las = laspy.LasData(header)
    las.x, las.y, las.z = ((xyz + (400_000.0, 5_700_000.0, 50.0)) / (1.0, 1.0, foot)).T
    las.return_number, las.number_of_returns = np.tile([1, 2], count), np.full(2 * count, 2)
    las.gps_time = np.repeat(np.arange(count) * 1e-5, 2)
    las.scan_angle = np.repeat(angle / 0.006, 2)
    las.write(path)
    return path


@pytest.mark.parametrize(
    ("foot", "stated", "said"), [(0.3048, "", True), (1.0, "", False), (0.3048, "+6360", False)]
)
def test_echoes_of_flat_land_say_heights_in_feet_that_nobody_states(
    tmp_path: Path, foot: float, stated: str, said: bool
) -> None:
    path = echoes(tmp_path / "flat.laz", foot)
    facts = scan_facts(index_inputs([path], f"EPSG:25832{stated}", []))
    assert facts.height_ratio == pytest.approx(1 / foot if not stated else 1.0, rel=0.15)
    assert (facts.likely_feet is not None) is said
    assert any("times as far apart in height" in line for line in facts.remarks()) is said


@pytest.mark.parametrize("word", ["EPSG:25831", "EPSG:2263", "none"])
def test_info_shows_the_system_that_a_build_would_use__to_crs(scan: Path, tmp_path: Path, word: str) -> None:
    runner, out = CliRunner(), tmp_path / "out"
    words = ["--crs", "EPSG:28992", "--to-crs", word, "--quiet"]
    told = runner.invoke(make_app(), ["info", str(scan), *words])
    dry = runner.invoke(make_app(), ["build", str(scan), "-o", str(out), "--dry-run", *words])
    assert told.exit_code == dry.exit_code == 0
    shown, planned = (
        [
            line
            for line in one.stdout.splitlines()
            if line.startswith(("system", "plane", "heights", "density"))
        ]
        for one in (told, dry)
    )
    assert shown == planned and ("EPSG:28992" if word == "none" else word) in shown[0]


def test_a_remark_is_logged_once_and_ends_the_summary(
    scan: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    run = plan_run(scan, tmp_path / "out").with_remarks("7 points are doubled", "7 points are doubled")
    again = run.with_remarks("7 points are doubled")
    assert again.remarks == ("7 points are doubled",)
    assert [entry.levelname for entry in caplog.records if "doubled" in entry.message] == ["WARNING"]
    summary = Summary(
        tmp_path, 9, 0, 0, {}, {}, {}, {}, 1.0, (), run={"remarks": list(again.remarks)}, points_used=9
    )
    assert summary.as_text().splitlines()[-2] == "note: 7 points are doubled"


@pytest.mark.slow
def test_run_json_has_the_remarks_of_a_run__none_of_a_plain_one(scan: Path, tmp_path: Path) -> None:
    run = open_run(scan, tmp_path / "out", outputs=("footprints",))
    with hold_folder(run) as workers:
        assert build_run(run.with_remarks("7 points are doubled"), workers).remarks == (
            "7 points are doubled",
        )
        told = json.loads((tmp_path / "out" / "run.json").read_text(encoding="utf-8"))
        assert told["remarks"] == ["7 points are doubled"]
        assert build_run(run, workers).remarks == ()


def test_voids_and_pieces_are_those_of_the_cells_with_points() -> None:
    x, y = (axis.ravel() for axis in np.mgrid[0.5:200.0, 0.5:100.0])
    court = (abs(x - 60.0) < 20.0) & (abs(y - 50.0) < 20.0)
    bay = (abs(x - 20.0) < 10.0) & (y < 30.0)  # open to the outside: no void
    apart = (x > 150.0) & (x < 170.0)
    xyz = np.column_stack([x, y, np.zeros(len(x))])[~(court | bay | apart)]
    area, void, pieces, middle = _cover(xyz)
    side = 4.0 * (199.0 * 99.0 / len(xyz)) ** 0.5
    column, row = np.floor((xyz[:, :2] - 0.5) / side).astype(int).T
    cells = np.zeros((column.max() + 1, row.max() + 1), bool)
    cells[column, row] = True
    label, count = ndimage.label(cells, np.ones((3, 3)))
    assert pieces == count == 2 and area == pytest.approx(cells.sum() * side**2)
    assert middle == pytest.approx((label == label[0, 0]).sum() * side**2)
    assert void == round(1.0 - cells.sum() / ndimage.binary_fill_holes(cells).sum(), 4) > 0.05
