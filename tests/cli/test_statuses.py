"""Exit statuses that scripts can build on: docs/errors.md lists the cases, and each is so."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyogrio
import pytest
import rasterio
import shapely
from pyproj import CRS
from tests.cli.test_commands import eaves
from tests.conftest import write_laz
from tests.formats.test_transformation import CONTRADICTIONS, XYZ, in_system, las, words
from tests.formats.test_transformation import PLACE as UTM

from eaves.formats.vectors.geopackage import Row, write_polygons
from eaves.model import CoordinateSystem
from eaves.run.manifest import lock_folder
from eaves.simulate.objects.houses import ExactScene

PAGE = (Path(__file__).parents[2] / "docs" / "errors.md").read_text(encoding="utf-8")
TABLE = PAGE.split("| case | the line says | what to do | status |\n|---|---|---|---|\n")[1].split("\n\n")[0]
ROWS = [[cell.strip() for cell in line.split("|")[1:-1]] for line in TABLE.splitlines()]
PLACE = np.array([84960.0, 447120.0])
SMALL = ("--outputs", "footprints,models")


class Place:
    """A folder with inputs that fit together and some that do not; the words of a command about them."""

    def __init__(self, folder: Path, points: Path, scene: ExactScene, patch: pytest.MonkeyPatch) -> None:
        self.folder, self.points, self.scene, self.patch = folder, points, scene, patch
        self.out, self.more = folder / "out", tuple[str, ...]()

    def run(self, points: Path, *words: str | Path) -> subprocess.CompletedProcess[str]:
        return eaves("build", points, "-o", self.out, "--jobs", "1", *words, *self.more)

    def build(self, *words: str | Path) -> subprocess.CompletedProcess[str]:
        return self.run(self.points, *SMALL, *words)

    def map_of(self, *shapes: shapely.Polygon, name: str = "map.gpkg") -> Path:
        write_polygons(self.folder / name, [Row(shape, {"n": 1}) for shape in shapes], CoordinateSystem())
        return self.folder / name

    def cloud(self, xyz: np.ndarray, name: str = "cloud.laz", **fields: np.ndarray) -> Path:
        write_laz(self.folder / name, xyz, **fields)
        return self.folder / name

    @property
    def grounds(self) -> list[shapely.Polygon]:
        """The true footprints, in the world."""
        return [shapely.transform(one.footprint, lambda xy: xy + PLACE) for one in self.scene.buildings]


Done = subprocess.CompletedProcess[str]
CASES: dict[str, Callable[[Place], Done]] = {}


def case(name: str) -> Callable[[Callable[[Place], Done]], Callable[[Place], Done]]:
    """The case of the table that a function brings about."""

    def keep(function: Callable[[Place], Done]) -> Callable[[Place], Done]:
        CASES[name] = function
        return function

    return keep


@case("degrees that nobody states")
def degrees(place: Place) -> Done:
    xyz = np.random.default_rng(0).random((4000, 3)) * [0.001, 0.001, 5] + [4.36, 52.0, 1]
    path = place.folder / "degrees.txt"
    np.savetxt(path, xyz, fmt="%.8f")
    return place.run(path, *SMALL)


@case("WKT and GeoTIFF keys of a file contradict")
def two_statements(place: Place) -> Done:
    return place.run(las(place.folder / "tile.las", XYZ + [*UTM, 0.0], CONTRADICTIONS["zone"]), *SMALL)


@case("`--crs` in another unit than the file")
def another_unit(place: Place) -> Done:
    tile = las(place.folder / "tile.las", XYZ + [*UTM, 0.0], words(CRS("EPSG:26918+5703")))
    return place.run(tile, *SMALL, "--crs", "feet")


@case("files of several systems")
def several_systems(place: Place) -> Done:
    for code in ("EPSG:32618", "EPSG:5070"):
        las(place.folder / f"tiles-{code[5:]}.las", in_system(code), words(CRS(code)))
    return place.run(place.folder / "tiles-*.las", *SMALL)


@case("`--to-crs` that is no projected system")
def to_degrees(place: Place) -> Done:
    return place.build("--to-crs", "EPSG:4326")


@case("unit of a raster's band and of its system contradict")
def raster_of_two_units(place: Place) -> Done:
    path = place.folder / "dsm.tif"
    words_of = {"driver": "GTiff", "width": 40, "height": 40, "count": 1, "dtype": "float32"}
    move = rasterio.transform.Affine(0.5, 0.0, 5e5, 0.0, -0.5, 4e6)
    with rasterio.open(path, "w", **words_of, crs="EPSG:26918+5703", transform=move) as image:
        image.write(np.full((1, 40, 40), 10, np.float32))
        image.units = ("ft",)
    return place.run(path, *SMALL)


@case("bounds beside the points")
def bounds_apart(place: Place) -> Done:
    return place.build("--bounds", "0,0,100,100")


@case("clip area beside the points")
def clip_apart(place: Place) -> Done:
    return place.build("--clip", place.map_of(shapely.box(0, 0, 9, 9)))


@case("map beside the points")
def map_apart(place: Place) -> Done:
    far = [shapely.transform(one, lambda xy: xy + [100_000, 0]) for one in place.grounds]
    return place.build("--footprints", place.map_of(*far))


@case("map in degrees without a system")
def map_in_degrees(place: Place) -> Done:
    shapes = shapely.to_wkb([shapely.box(4.36, 52.0, 4.3602, 52.0001)])
    path = place.folder / "map.shp"
    pyogrio.raw.write(
        path, shapes, [np.array([1])], np.array(["n"], object), geometry_type="Polygon", crs="EPSG:4326"
    )
    path.with_suffix(".prj").unlink()
    return place.build("--footprints", path)


@case("plane GeoJSON of another system, which it does not state")
def geojson_elsewhere(place: Place) -> Done:
    square = '{"type": "Polygon", "coordinates": [[[6e5, 5e6], [6.1e5, 5e6], [6.1e5, 5.1e6], [6e5, 5e6]]]}'
    path = place.folder / "map.geojson"
    path.write_text(f'{{"type": "Feature", "properties": {{}}, "geometry": {square}}}')
    return place.build("--footprints", path)


@case("map of several layers that may be the buildings")
def several_layers(place: Place) -> Done:
    path = place.folder / "map.gpkg"
    for name in ("a", "b"):
        rows = shapely.to_wkb(place.grounds)
        pyogrio.raw.write(
            path, rows, [], np.array([], object), layer=name, geometry_type="Polygon", crs="EPSG:28992"
        )
    return place.build("--footprints", path)


@case("points in an archive")
def archive(place: Place) -> Done:
    path = place.folder / "tile.zip"
    with zipfile.ZipFile(path, "w") as packed:
        packed.write(place.points, "tile.laz")
    return place.run(path)


@case("no point of a class with `--use-classes`")
def no_class(place: Place) -> Done:
    xyz = np.random.default_rng(0).random((4000, 3)) * [40, 40, 0.02] + [85000, 447000, 1]
    return place.run(place.cloud(xyz, classification=np.full(4000, 2)), "--use-classes")


@case("inputs without a point")
def no_point(place: Place) -> Done:
    return place.run(place.cloud(np.zeros((0, 3))))


@case("server that gives no answer")
def no_server(place: Place) -> Done:
    with socket.socket() as port:
        port.bind(("127.0.0.1", 0))  # and does not listen
        address = f"http://127.0.0.1:{port.getsockname()[1]}/a.laz"
        return eaves("build", address, "-o", place.out, *SMALL, *place.more)


@case("disk too small for the points")
def small_disk(place: Place) -> Done:
    place.patch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=100_000))
    return place.build()


@case("memory too small for a process")
def small_memory(place: Place) -> Done:
    return place.build("--memory", "1M")


@case("memory too small for a file as COPC")
def small_memory_for_copc(place: Place) -> Done:
    place.patch.setattr("os.sysconf", lambda name: 1000, raising=False)  # of 1000 pages of 1000 bytes
    return place.run(place.points, "--formats", "copc")


@case("option of a map without one")
def no_map(place: Place) -> Done:
    return place.build("--id-field", "id")


@case("format without its output")
def no_output(place: Place) -> Done:
    return place.build("--outputs", "footprints", "--formats", "obj")


@case("folder that another run holds")
def held(place: Place) -> Done:
    place.out.mkdir()
    with lock_folder(place.out):
        return place.build()


@case("folder with a run of other inputs")
def other_run(place: Place) -> Done:
    flat = np.random.default_rng(0).random((400, 3)) * [40, 40, 0.02] + [85000, 447000, 1]
    assert eaves("build", place.cloud(flat), "-o", place.out, "-q").returncode == 0
    return place.build()


@case("folder with a file that eaves did not write under the name of an output")
def foreign(place: Place) -> Done:
    place.out.mkdir()
    (place.out / "footprints.gpkg").write_text("mine")
    return place.build()


@case("folder with a person's work")
def person_at_work(place: Place) -> Done:
    assert place.build("-q").returncode == 0
    (place.out / "review.csv").write_text("mine")
    return place.build()


@case("folder that cannot be written")
def below_a_file(place: Place) -> Done:
    place.out = place.points / "below"
    return place.build()


@case("every given footprint fails")
def all_fail(place: Place) -> Done:
    bare = [
        shapely.box(*(PLACE + [2, 2]), *(PLACE + [5, 5])),
        shapely.box(*(PLACE + [2, 6]), *(PLACE + [5, 9])),
    ]
    return place.build("--footprints", place.map_of(*bare))


@case("an input is damaged, others are not")
def damaged(place: Place) -> Done:
    flat = np.random.default_rng(0).random((4000, 3)) * [40, 40, 0.02] + [85100, 447200, 1]
    whole = place.cloud(flat).read_bytes()
    (place.folder / "cloud.laz").write_bytes(whole[: len(whole) // 2])
    return eaves("build", place.points, place.folder / "cloud.laz", "-o", place.out, *SMALL)


@case("no point can be used")
def lone_point(place: Place) -> Done:
    return place.run(place.cloud(np.array([[85000.0, 447000.0, 1.0]])))


@case("the page or a format fails")
def page_fails(place: Place) -> Done:
    code = (
        "import eaves.report.output as page\nfrom eaves.cli.app import main\n"
        "def fail(*words): raise ZeroDivisionError\npage.write_page = fail\nmain()"
    )
    words = ["build", str(place.points), "-o", str(place.out), "--jobs", "1", *place.more]
    return subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True)


@case("a building without a model, with `--strict`")
def strict(place: Place) -> Done:
    bare = shapely.box(*(PLACE + [2, 2]), *(PLACE + [5, 5]))
    return place.build("--footprints", place.map_of(*place.grounds, bare), "--strict")


@case("disk full in the run")
def full_disk(place: Place) -> Done:
    """A limit on the size of a file is a full disk to the one who writes."""
    if sys.platform == "win32":
        pytest.skip("Windows has no limit on the size of files")
    code = (
        "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000)); "
        "from eaves.cli.app import main; main()"
    )
    words = ["build", str(place.points), "-o", str(place.out), "--jobs", "1", "-q"]
    return subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, timeout=240)


@case("bounds beside the points, with `--allow-empty`")
def empty_allowed(place: Place) -> Done:
    return place.build("--bounds", "0,0,100,100", "--allow-empty")


@case("points without a building")
def field(place: Place) -> Done:
    flat = np.random.default_rng(0).random((4000, 3)) * [40, 40, 0.02] + [85000, 447000, 1]
    return place.run(place.cloud(flat), *SMALL)


@pytest.fixture
def place(
    tmp_path: Path, nine_roofs_file: Path, nine_roofs: ExactScene, monkeypatch: pytest.MonkeyPatch
) -> Place:
    return Place(tmp_path, nine_roofs_file, nine_roofs, monkeypatch)


def test_the_table_has_the_cases_that_are_tried() -> None:
    assert [row[0] for row in ROWS] == list(CASES)


BEFORE_A_POINT = [row for row in ROWS if row[3] == "2" and not row[0].startswith("folder")]


SLOW = ("the page or a format fails", "disk full in the run")
"""Cases of several runs."""
TRIED = [pytest.param(row, id=row[0], marks=[pytest.mark.slow] if row[0] in SLOW else []) for row in ROWS]


@pytest.mark.parametrize("row", TRIED)
def test_a_case_ends_with_the_line_and_the_status_of_its_row(row: list[str], place: Place) -> None:
    done = CASES[row[0]](place)
    words = re.sub("`", "", row[1])
    assert done.returncode == int(row[3]), done.stdout + done.stderr
    if words:
        assert len([line for line in done.stderr.splitlines() if words in line]) == 1, done.stderr
    if row in BEFORE_A_POINT:
        assert not place.out.exists()


@pytest.mark.parametrize("row", BEFORE_A_POINT, ids=[row[0] for row in BEFORE_A_POINT])
def test_a_dry_run_says_the_same(row: list[str], place: Place) -> None:
    place.more = ("--dry-run",)
    done = CASES[row[0]](place)
    assert done.returncode == 2 and row[1].strip("`") in done.stderr, done.stdout + done.stderr


@pytest.mark.parametrize("more", [(), ("--dry-run",)])
def test_an_expected_lack_of_memory_is_a_warning(more: tuple[str, ...], place: Place) -> None:
    flat = np.random.default_rng(0).random((4000, 3)) * [5, 5, 0.02] + [85000, 447000, 1]
    done = place.run(place.cloud(flat), *SMALL, "--memory", "1G", *more)
    assert done.returncode == 0, done.stderr
    told = [line for line in done.stderr.splitlines() if "MB each, more than --memory 1G; give" in line]
    assert len(told) == 1, done.stderr
