"""The operator's table in a real browser, by mouse and keys: what it draws is looked at."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from matplotlib.image import imread

from eaves.edit.server import Desk, DeskHandler
from eaves.edit.session import Session
from eaves.report import open_server
from tests.report.browser import Browser, missing

pytestmark = pytest.mark.skipif(bool(missing()), reason=missing())

DELETE = "\ue017"


class Table:
    """A window with the table, and a session behind it."""

    def __init__(self, browser: Browser, desk: Desk, port: int) -> None:
        self.browser, self.desk, self.session = browser, desk, desk.session
        browser.call("POST", "/url", {"url": f"http://127.0.0.1:{port}/{desk.token}/"})
        self.wait("return document.documentElement.dataset.table === 'yes'")

    def wait(self, script: str) -> None:
        """Wait until a script returns what is true."""
        limit = time.monotonic() + 60
        while not self.browser.run(script):
            assert time.monotonic() < limit, f"{script}: {self.said} {self.browser.errors()}"
            time.sleep(0.05)

    @property
    def said(self) -> str:
        return str(self.browser.run("return document.getElementById('said').textContent"))

    def done(self) -> None:
        """Wait until what was asked for is drawn."""
        self.wait("return document.documentElement.dataset.busy === 'no'")
        self.browser.settle()

    def press(self, *keys: str) -> None:
        self.browser.press(*keys)
        self.done()

    def at(self, name: str, place: tuple[float, float]) -> tuple[float, float]:
        """Where a place of the world is in the window, at the eaves of a building."""
        x, y = np.subtract(place, self.desk.contents.origin).tolist()
        row = f"eaves.all.find(row => row.id === '{name}')"
        script = f"const z = {row}.h_eaves - {self.desk.contents.base}, at = eaves.tools.seen([{x}, {y}, z]);"
        box = "const box = eaves.canvas.getBoundingClientRect(); return [box.left + at.x, box.top + at.y];"
        left, top = self.browser.run(script + box)
        return float(left), float(top)

    def choose(self, name: str) -> None:
        """Choose a building, and look at it from above."""
        self.browser.run(f"eaves.choose(eaves.all.findIndex(row => row.id === '{name}'))")
        self.browser.run(
            "eaves.view('above'); eaves.camera.zoom(1.7); document.getElementById('scene').focus()"
        )
        self.browser.settle()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with Browser() as window:
        yield window


@pytest.fixture
def table(session: Session, browser: Browser) -> Iterator[Table]:
    desk = Desk(session)
    with open_server(partial(DeskHandler, desk=desk), 0) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield Table(browser, desk, server.server_address[1])
        server.shutdown()
    assert browser.errors() == []


def test_a_corner_is_dragged__undone_and_an_edge_moved(table: Table, tmp_path: Path) -> None:
    name, before = next(iter(table.session.outlines.items()))
    table.choose(name)
    table.press("c")
    whole = imread(table.browser.picture(tmp_path / "before.png"))
    place = before.exterior.coords[0]
    x, y = table.at(name, (place[0], place[1]))
    table.browser.drag((x, y), (x - 40, y - 30))
    table.done()
    after = table.session.outlines[name]
    assert after.symmetric_difference(before).area > 1.0, table.said
    moved = imread(table.browser.picture(tmp_path / "after.png"))
    assert (np.abs(whole - moved).max(axis=2) > 0.2).sum() > 300, "what was edited is drawn"
    table.press("u")
    assert table.session.outlines[name].equals(before)
    middle = np.mean(before.exterior.coords[:2], axis=0)
    x, y = table.at(name, (middle[0], middle[1]))
    way = np.array([x, y]) - table.at(name, (before.centroid.x, before.centroid.y))
    x2, y2 = np.array([x, y]) + 30 * way / np.hypot(*way)
    table.browser.drag((x, y), (float(x2), float(y2)))
    table.done()
    assert len(table.session.outlines[name].exterior.coords) == len(before.exterior.coords)
    assert table.session.outlines[name].area > before.area + 1.0


@pytest.mark.slow
def test_a_building_is_split_by_two_clicks__and_joined(table: Table) -> None:
    name, before = next(iter(table.session.outlines.items()))
    west, south, east, north = before.bounds
    table.choose(name)
    table.press("t")
    for place in ((west - 1.0, (south + north) / 2), (east + 1.0, (south + north) / 2)):
        table.browser.click(*table.at(name, place))
    table.done()
    second = f"{name}-2"
    assert second in table.session.outlines, table.said
    drawn = "return eaves.scene.triangles.building.filter(number => eaves.all[number - 1].id === 'ID').length"
    assert table.browser.run(drawn.replace("ID", second)) > 0
    table.choose(name)
    table.press("b")
    inside = table.session.outlines[second].representative_point()
    table.browser.click(*table.at(name, (inside.x, inside.y)))
    table.done()
    assert second not in table.session.outlines, table.said
    assert table.browser.run(drawn.replace("ID", second)) == 0


@pytest.mark.slow
def test_a_rectangle_is_drawn_by_three_clicks__and_deleted_by_a_key(table: Table) -> None:
    name, outline = next(iter(table.session.outlines.items()))
    table.choose(name)
    table.press(DELETE)
    assert name not in table.session.outlines
    table.press("d")
    places = np.array(outline.minimum_rotated_rectangle.exterior.coords[:3])
    for x, y in places:
        table.browser.click(*table.at(name, (x, y)))
    table.done()
    assert name in table.session.outlines, table.said
    assert table.session.outlines[name].symmetric_difference(outline).area < 0.3 * outline.area


@pytest.mark.slow
def test_keys_alone_move_a_corner__and_make_a_roof_flat(table: Table) -> None:
    name, before = next(iter(table.session.outlines.items()))
    table.choose(name)
    table.press("c", ".", "\ue014", "\ue014", "\ue007")  # two steps to the east, enter
    assert table.session.outlines[name].symmetric_difference(before).area > 0.2, table.said
    table.press("\ue00c", "4")
    row = table.browser.run(f"return eaves.all.find(row => row.id === '{name}')")
    assert (row["roof_type"], row["trust"]) == ("flat", "manual")
    table.press("w")
    table.wait("return document.querySelectorAll('#choices svg polygon').length > 2")
    table.press("u")
    table.press("r")
    assert table.browser.run(f"return eaves.all.find(row => row.id === '{name}').roof_type") == "flat"
