"""Two epochs built and compared: the nine roofs, one of them gone, one raised, the second scan 10 cm off."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyogrio
import pytest
from matplotlib.image import imread

from eaves.cli import app as cli
from eaves.formats.crs import parse_crs, system_of
from eaves.simulate import ExactBuilding, ExactFace, ExactScene, nine_roofs_on_a_slope, write_simulation
from eaves.simulate.objects.houses import PITCH, sample_from_above
from tests.conftest import build_files

from ..report.browser import Browser, missing
from ..report.test_page_in_browser import MIDDLE_OF

GONE, RAISED = 2, 7
SHIFT = 0.06, -0.05, 0.10


def raised(building: ExactBuilding, way: float) -> ExactBuilding:
    """A building with its roof higher by `way` (m)."""
    faces = tuple(
        ExactFace(face.polygon, (*face.coefficients[:2], face.coefficients[2] + way), face.number)
        for face in building.faces
    )
    return replace(building, faces=faces)


def later_roofs(first: ExactScene) -> tuple[ExactBuilding, ...]:
    """The nine roofs without one, and another higher."""
    return tuple(raised(b, 0.8) if b.number == RAISED else b for b in first.buildings if b.number != GONE)


def built(scene: ExactScene, place: Path) -> Path:
    """The run of a scene."""
    points = write_simulation(scene, place)["points"]
    out = place.with_name(f"{place.name}-run")
    build_files(points, out, lod="0", outputs=("footprints", "rasters", "classified"))
    return out


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The runs of both epochs."""
    place = tmp_path_factory.mktemp("epochs")
    first = nine_roofs_on_a_slope(density=8.0, seed=1)
    second = sample_from_above(later_roofs(first), 3 * PITCH, 5.0, 0.03, seed=2)
    moved = second.cloud.with_(xyz=second.cloud.xyz + np.array(SHIFT))
    return built(first, place / "old"), built(replace(second, cloud=moved), place / "new")


def compared(*words: object) -> int:
    """The exit status of `eaves compare`."""
    return int(cli.make_app()(["compare", *map(str, words), "-q"], standalone_mode=False) or 0)


def changes(out: Path) -> dict[str, dict[str, object]]:
    told = json.loads((out / "changes.json").read_text(encoding="utf-8"))
    return {row["id"]: row for row in told["buildings"]}


@pytest.fixture(scope="module")
def out(folders: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The epochs compared."""
    place = tmp_path_factory.mktemp("compared")
    assert compared(*folders, "-o", place) == 0
    return place


def test_what_changed_is_found_by_its_old_id__and_nothing_else(folders: tuple[Path, Path], out: Path) -> None:
    rows = changes(out)
    kinds = sorted(row["change"] for row in rows.values())
    assert kinds == sorted(["unchanged"] * 7 + ["demolished", "raised"])
    moved = next(row for row in rows.values() if row["change"] == "raised")
    assert moved["height_difference_m"] == pytest.approx(0.8, abs=0.05)
    told = json.loads((out / "changes.json").read_text(encoding="utf-8"))
    shift = [told["new_against_old_m"][way] for way in ("east", "north", "up")]
    assert shift == pytest.approx(SHIFT, abs=0.02)
    before = pyogrio.read_dataframe(folders[0] / "footprints.gpkg", layer="footprints")
    assert set(rows) == set(before["id"])


def test_the_layer_the_table_and_the_page_say_the_same(out: Path) -> None:
    layer = pyogrio.read_dataframe(out / "changes.gpkg", layer="changes")
    with (out / "changes.csv").open(encoding="utf-8", newline="") as file:
        table = {row["id"]: row["change"] for row in csv.DictReader(file)}
    assert dict(zip(layer["id"], layer["change"], strict=True)) == table
    parts = pyogrio.read_dataframe(out / "changes.gpkg", layer="parts")
    assert set(parts["change"]) == {"demolished", "raised"}
    data = re.search(r'id="data">(.*?)</script>', (out / "changes.html").read_text(encoding="utf-8"), re.S)
    assert data is not None
    rows = json.loads(data[1])["rows"]
    assert {row["id"]: row["change"] for row in rows} == table
    assert [row["change"] for row in rows[:3]] == ["demolished", "raised", "unchanged"], "largest first"
    assert cli.make_app()(["validate", str(out)], standalone_mode=False) in (0, None)


@pytest.mark.slow
@pytest.mark.skipif(bool(missing()), reason=missing())
def test_a_demolished_house_stands_on_the_old_side_of_the_slider_alone(out: Path, tmp_path: Path) -> None:
    with Browser() as browser:
        browser.open(out / "changes.html", "view=above&off=points-other")
        gone = browser.run("return eaves.all.findIndex(row => row.change === 'demolished')")
        x, y = browser.run(MIDDLE_OF.replace("ROW", str(gone)))
        for swipe, chosen in ((1000, gone + 1), (0, 0)):
            browser.run(f"document.getElementById('swipe').value = {swipe}; eaves.choose(-1)")
            browser.settle()
            browser.click(x, y)
            assert browser.run("return eaves.look.chosen") == chosen
            colour = imread(browser.picture(tmp_path / "seen.png"))[round(y), round(x), :3]
            assert (np.ptp(colour) > 0.3) == (swipe == 1000), "red, or the colour of earth"
        assert browser.errors() == []


@pytest.mark.slow
def test_backwards_it_is_the_opposite(folders: tuple[Path, Path], tmp_path: Path) -> None:
    old, new = folders
    assert compared(new, old, "-o", tmp_path / "out") == 0
    kinds = sorted(row["change"] for row in changes(tmp_path / "out").values())
    assert kinds == sorted(["unchanged"] * 7 + ["new", "lowered"])


@pytest.mark.slow
def test_beyond_the_common_area_nothing_is_demolished(folders: tuple[Path, Path], tmp_path: Path) -> None:
    old, new = folders
    points = new.parent / "new" / "points.laz"
    half = tmp_path / "half"
    build_files(
        points,
        half,
        lod="0",
        outputs=("footprints", "classified"),
        bounds=(2400, 4800, 2400 + 1.5 * PITCH, 4902),
    )
    assert compared(old, half, "-o", tmp_path / "out") == 0
    rows = changes(tmp_path / "out").values()
    kinds = [row["change"] for row in rows]
    assert kinds.count("demolished") <= 1
    assert kinds.count("not covered") == 3


@pytest.mark.slow
def test_epochs_in_two_systems_are_brought_together(folders: tuple[Path, Path], tmp_path: Path) -> None:
    from pyproj import Transformer

    one = system_of(parse_crs("EPSG:32632"), "--crs", (740000.0, 5500000.0))
    far = system_of(parse_crs("EPSG:32633"), "--crs", (310000.0, 5500000.0))
    move = Transformer.from_crs("EPSG:32632", "EPSG:32633", always_xy=True).transform
    runs = []
    for name, system in (("old", one), ("new", far)):
        scene = nine_roofs_on_a_slope(density=8.0, seed=1)
        if name == "new":
            scene = sample_from_above(scene.buildings, 3 * PITCH, 5.0, 0.03, seed=2)
        world = scene.cloud.xyz + np.array([740000.0, 5500000.0, 0.0])
        if system is far:
            world[:, :2] = np.column_stack(move(world[:, 0], world[:, 1]))
        cloud = type(scene.cloud).from_world(
            world,
            return_number=scene.cloud.return_number,
            number_of_returns=scene.cloud.number_of_returns,
            classification=scene.cloud.classification,
            point_id=scene.cloud.point_id,
            system=system,
        )
        runs.append(built(replace(scene, cloud=cloud), tmp_path / name))
    assert compared(*runs, "-o", tmp_path / "out") == 0
    assert [row["change"] for row in changes(tmp_path / "out").values()] == ["unchanged"] * 9


@pytest.mark.parametrize("which", ["missing", "same", "empty"])
def test_bad_input_is_one_line(which: str, folders: tuple[Path, Path], tmp_path: Path) -> None:
    old, _ = folders
    (tmp_path / "empty").mkdir()
    words = {"missing": (old, tmp_path / "none"), "same": (old, old), "empty": (old, tmp_path / "empty")}[
        which
    ]
    with pytest.raises(ValueError, match=";") as error:
        compared(*words, "-o", tmp_path / "out")
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_epochs_of_two_places_share_nothing(folders: tuple[Path, Path], tmp_path: Path) -> None:
    scene = nine_roofs_on_a_slope(density=4.0, seed=3)
    far = scene.cloud.with_(xyz=scene.cloud.xyz + np.array([5000.0, 0.0, 0.0]))
    assert (
        compared(folders[0], built(replace(scene, cloud=far), tmp_path / "far"), "-o", tmp_path / "out") == 0
    )
    assert {row["change"] for row in changes(tmp_path / "out").values()} == {"not covered"}
