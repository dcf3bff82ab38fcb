"""The commands of the pages run as printed: each page's in order, on a small scene with its file names."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import laspy
import numpy as np
import pyproj
import pytest
import shapely

from eaves.flow.edits import NO_BUILDING, Edit, write_edits
from eaves.formats import read_polygons
from eaves.formats.vectors.geopackage import Row, write_polygons
from tests.cli.test_commands import eaves
from tests.conftest import write_laz
from tests.test_documentation import DOCS, PAGES, commands_of

OREGON_FEET = "EPSG:2994"
OREGON = np.array([636000.0, 849000.0, 400.0])
"""A place (ft) of that system."""
NOT_RUN = {
    "eaves view out": "it opens a browser: tests/report",
    "eaves build tiles/ -o out --scheduler tcp://head:8786 --resume": "there is no cluster",
}
"""Command → why it is not run here."""


def write_part(path: Path, file: Path, east: bool | None, raised: float = 0.0) -> None:
    """The half of a file's points, or all of them for None, the buildings over 3 m higher by `raised` (m)."""
    las = laspy.read(file)
    xyz = np.stack([np.asarray(las.x), np.asarray(las.y), np.asarray(las.z)], axis=1)
    middle = np.median(xyz[:, 0])
    keep = np.full(len(xyz), True) if east is None else (xyz[:, 0] >= middle) == east
    path.parent.mkdir(exist_ok=True)
    write_laz(path, xyz[keep] + [0.0, 0.0, raised])


def write_methods(path: Path) -> None:
    """The file that the page *Your own method* makes of its blocks."""
    text = (DOCS / "guides" / "own_method.md").read_text(encoding="utf-8")
    path.write_text("\n\n".join(re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)))


def write_weather(path: Path) -> None:
    """A year with light from nine to five."""
    lines = ["LOCATION,Delft,ZH,NLD,IWEC,062400,52.0,4.4,1.0,0.0", *["x"] * 7]
    for day in (np.datetime64("2023-01-01") + np.arange(365)).astype(str):
        for hour in range(1, 25):
            light = [500, 100] if 8 < hour <= 17 else [0, 0]
            told = [2009, int(day[5:7]), int(day[8:]), hour, 0, "?", *[0] * 8, *light]
            lines.append(",".join(map(str, told)))
    path.write_text("\n".join(lines))


@pytest.fixture(scope="module")
def inputs(nine_roofs_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every file that the pages name."""
    folder = tmp_path_factory.mktemp("inputs")
    shutil.copy(nine_roofs_file, folder / "tile.laz")
    write_methods(folder / "my_methods.py")
    for name in ("tiles", "ahn3", "ahn5"):
        for east in (False, True):
            write_part(folder / name / f"{'east' if east else 'west'}.laz", nine_roofs_file, east)
    write_part(folder / "new-tiles" / "east.laz", nine_roofs_file, True, 0.02)
    las = laspy.read(nine_roofs_file)
    xyz = np.stack([np.asarray(las.x), np.asarray(las.y), np.asarray(las.z)], axis=1)
    write_laz(folder / "old.laz", (xyz - xyz.min(axis=0)) / 0.3048 + OREGON, epsg=None)
    (folder / "srs.wkt").write_text(pyproj.CRS(OREGON_FEET).to_wkt())
    for name in ("out-2020", "out-2026"):
        done = eaves("build", folder / "tile.laz", "-o", folder / name, "--jobs", "1", "--quiet")
        assert done.returncode == 0, done.stderr
    polygons, _, rows, system = read_polygons(folder / "out-2020" / "footprints.gpkg", layer="footprints")
    named = [Row(shape, {"id": str(row["id"])}) for shape, row in zip(polygons, rows, strict=True)]
    write_polygons(folder / "map.gpkg", named, system)
    gone = Edit(NO_BUILDING, shapely.buffer(polygons[0].centroid, 1.0), "")
    write_edits(folder / "verdicts.gpkg", [gone], system)
    write_weather(folder / "NLD_Amsterdam.062400_IWEC.epw")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_commands_of_a_page_run_as_printed(
    page: Path, inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(inputs, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    for line in commands_of(page):
        if line not in NOT_RUN:
            done = eaves(*line.split()[1:])
            assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"


def test_what_is_not_run_is_still_printed() -> None:
    assert set(NOT_RUN) <= {line for page in PAGES for line in commands_of(page)}
