"""report.html in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from eaves.tiling.outputs import Summary
from eaves.viewer.build import build

from .browser import Browser, missing

pytestmark = pytest.mark.skipif(bool(missing()), reason=missing())

MIDDLE_OF = """
const {low, high} = eaves.spots[ROW], canvas = eaves.canvas, box = canvas.getBoundingClientRect();
const matrix = eaves.camera.matrix(canvas.width / canvas.height);
const at = [...low.map((value, axis) => axis < 2 ? (value + high[axis]) / 2 : high[axis]), 1];
const dot = row => at.reduce((sum, value, column) => sum + value * matrix[4 * column + row], 0);
const [x, y] = [dot(0) / dot(3), dot(1) / dot(3)];
return [box.left + (x + 1) / 2 * box.width, box.top + (1 - y) / 2 * box.height];
"""
CHOSEN = "return document.documentElement.dataset.chosen || ''"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with Browser() as window:
        yield window


def test_the_page_loads_selects_and_toggles(browser: Browser, nine_run: Summary, artefacts: Path) -> None:
    page = nine_run.folder / "report.html"
    browser.open(page)
    assert browser.run("return document.documentElement.dataset.ready") == "yes"
    ids = browser.run("return eaves.scene.rows.map(row => row.id)")
    assert len(ids) == nine_run.found

    browser.run("eaves.view('above')")
    browser.settle()
    browser.picture(artefacts / "nine-above.png")
    whole = imread(browser.picture(artefacts / "nine.png"))
    row = int(browser.run("return eaves.spots.findIndex(spot => Number.isFinite(spot.high[2]))"))
    browser.click(*browser.run(MIDDLE_OF.replace("ROW", str(row))))
    assert browser.run(CHOSEN) == ids[row], "a click on a roof chooses its building"
    assert ids[row] in browser.run("return document.getElementById('building').textContent")
    browser.press("\ue00c")
    assert browser.run(CHOSEN) == "", "escape lets go"

    browser.run("for (const name of ['roofs', 'walls', 'edges']) document.getElementById(name).click()")
    browser.settle()
    without = imread(browser.picture(artefacts / "nine-no-models.png"))
    assert np.abs(whole - without).max(axis=2).mean() > 0.01, "models go when their layers are off"

    browser.run("document.querySelectorAll('#buildings tbody tr')[2].focus()")
    browser.press("\ue007")
    assert browser.run(CHOSEN) == ids[2], "enter on a row flies to its building"
    assert browser.errors() == []


def test_the_table_sorts_up_and_down__numbers_as_numbers(browser: Browser, nine_run: Summary) -> None:
    browser.open(nine_run.folder / "report.html")
    areas = (
        "return [...document.querySelectorAll('#buildings tbody tr')]"
        ".map(line => Number(line.cells[COLUMN].textContent))"
    )
    column = browser.run(
        "return [...document.querySelectorAll('#buildings th')]"
        ".findIndex(head => head.textContent.startsWith('area'))"
    )
    click = f"document.querySelectorAll('#buildings th button')[{column}].click()"
    browser.run(click)
    up = browser.run(areas.replace("COLUMN", str(column)))
    browser.run(click)
    assert up == sorted(up)
    assert browser.run(areas.replace("COLUMN", str(column))) == sorted(up, reverse=True)
    assert browser.errors() == []


def test_the_keyboard_turns_and_zooms_the_scene(browser: Browser, nine_run: Summary) -> None:
    browser.open(nine_run.folder / "report.html")
    browser.run("eaves.canvas.focus()")
    before = browser.run("return [eaves.camera.azimuth, eaves.camera.distance]")
    browser.press("\ue012", "+")
    after = browser.run("return [eaves.camera.azimuth, eaves.camera.distance]")
    assert after[0] != before[0]
    assert after[1] < before[1]
    browser.press("n")
    assert browser.run(CHOSEN) != ""


@pytest.mark.slow
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_every_view_of_delft_draws__screenshots_kept(
    data: Path, tmp_path_factory: pytest.TempPathFactory, artefacts: Path, theme: str
) -> None:
    folder = tmp_path_factory.getbasetemp() / "delft-run"
    if not (folder / "report.html").exists():
        build(data / "delft" / "ahn3.laz", folder)
    states = {
        "home": "",
        "above": "view=above&models=azimuth",
        "side": "view=side",
        "points-class": "off=roofs,walls,edges&on=points-building,points-ground",
        "points-height": "points=height&off=roofs,walls,edges&on=points-building,points-ground",
        "points-plane": "points=plane&off=roofs,walls,edges,points-other&on=points-building",
        "points-building": "points=building&off=roofs,walls,edges,points-other&on=points-building",
        "points-distance": "points=distance&off=points-other&on=points-building",
        "models-lod": "models=lod",
        "models-type": "models=type",
        "models-fit": "models=fit",
        "models-slope": "models=slope",
        "models-failure": "models=failure",
        "lod-1.2": "lod=1.2",
    }
    with Browser() as window:
        for name, state in states.items():
            window.open(folder / "report.html", f"{state}&theme={theme}")
            image = imread(window.picture(artefacts / f"delft-{theme}-{name}.png"))[60:700, 10:1000, :3]
            assert image.reshape(-1, 3).std(axis=0).max() > 0.03, f"{name} shows something"
            assert window.errors() == [], name
        milliseconds = window.run(
            "const start = performance.now(); for (let k = 0; k < 5; k++) { eaves.camera.turn(0.1, 0);"
            "eaves.painter.paint(eaves.camera, eaves.look); eaves.painter.gl.finish(); }"
            "return (performance.now() - start) / 5"
        )
    assert milliseconds < 2000, "even without a graphics card"
