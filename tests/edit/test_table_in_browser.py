"""The operator's table in a real browser, by mouse and keys: what it draws is looked at."""

from __future__ import annotations

import base64
import re
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
import shapely
from matplotlib.image import imread

from eaves.edit.actions import Session
from eaves.edit.server import Desk, DeskHandler
from eaves.report import open_server
from tests.report.browser import Browser, missing

pytestmark = pytest.mark.skipif(bool(missing()), reason=missing())

DELETE = "\ue017"


class Table:
    """A window with the table, and a session behind it."""

    def __init__(self, browser: Browser, desk: Desk, port: int) -> None:
        self.browser, self.desk, self.session = browser, desk, desk.session
        self.address = f"http://127.0.0.1:{port}/{desk.token}/"
        self.open()

    def open(self) -> None:
        """Load the page, and wait for its table."""
        self.browser.call("POST", "/url", {"url": self.address})
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
    box = "document.querySelector('#table-sheet .corner').getBoundingClientRect()"
    assert table.browser.run(f"return {box}.width > 10 && document.querySelectorAll('#sheet').length === 1")
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
    table.press("v")
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


@pytest.mark.slow
def test_an_edge_is_carried_on_by_one_click(table: Table) -> None:
    name, before = next(iter(table.session.outlines.items()))
    ring = np.array(before.exterior.coords[:-1])
    one, two, three = ring[0], ring[1], ring[2]
    cut = [one, two + 0.2 * (one - two), two + 0.2 * (three - two), *ring[2:]]
    plan = np.round(np.subtract(cut, table.desk.contents.origin), 3).tolist()
    table.desk.act({"do": "outline", "id": name, "plan": plan})
    table.open()
    table.choose(name)
    table.press("e")
    table.browser.click(*table.at(name, tuple(0.7 * cut[1] + 0.3 * one)))
    table.done()
    assert table.session.outlines[name].symmetric_difference(before).area < 0.1, table.said


@pytest.mark.slow
def test_a_ridge_is_dragged__two_faces_made_one__and_a_dormer_drawn(table: Table) -> None:
    name = next(one for one in table.session.outlines if len(table.session.trial.faces(one)) == 2)
    faces = table.session.trial.faces(name)
    inside = [face.polygon.representative_point().coords[0] for face in faces]
    border = faces[0].polygon.buffer(0.01).intersection(faces[1].polygon.buffer(0.01)).centroid.coords[0]
    way = np.subtract(inside[1], border)
    to = np.add(border, 0.8 * way / np.hypot(*way))
    table.choose(name)
    table.press("i")
    table.browser.drag(table.at(name, border), table.at(name, tuple(to)))
    table.done()
    moved = table.session.trial.faces(name)
    assert len(moved) == 2, table.said
    assert min(face.polygon.boundary.distance(shapely.Point(to)) for face in moved) < 0.25, table.said
    assert table.session.own[-1].verdict == "roof face"
    table.press("u", "f")
    for place in inside:
        table.browser.click(*table.at(name, place))
    table.done()
    assert len(table.session.trial.faces(name)) == 1, table.said
    table.press("u", "q")
    corner = np.array(inside[0])
    along = np.array([-way[1], way[0]]) / np.hypot(*way)
    across = np.array([along[1], -along[0]])
    for place in (corner, corner + 1.5 * along, corner + 1.5 * along + 1.2 * across):
        table.browser.click(*table.at(name, tuple(place)))
    table.done()
    assert len(table.session.trial.faces(name)) == 3, table.said
    table.press(
        "u", "i", ".", "\ue00e", "\ue00e", "\ue013", "\ue007"
    )  # two steps up, one to the north, enter
    top = max(face.height_at(np.array([border]))[0] for face in table.session.trial.faces(name))
    assert top == pytest.approx(max(face.height_at(np.array([border]))[0] for face in faces) + 0.2, abs=0.2)


@pytest.mark.slow
def test_a_finger_drags_a_corner_at_768_px(session: Session) -> None:
    desk = Desk(session)
    with Browser(768, 1024) as browser, open_server(partial(DeskHandler, desk=desk), 0) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        table = Table(browser, desk, server.server_address[1])
        name, before = next(iter(session.outlines.items()))
        table.choose(name)
        browser.tap(*browser.run(middle_of('[data-key="c"]')))
        place = before.exterior.coords[0]
        x, y = table.at(name, (place[0], place[1]))
        browser.drag((x, y), (x - 40, y - 30), "touch")
        table.done()
        assert session.outlines[name].symmetric_difference(before).area > 1.0, table.said
        server.shutdown()
        assert browser.errors() == []


AXE = Path(__file__).parents[2] / "page" / "node_modules" / "axe-core" / "axe.min.js"
WCAG = "{ runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa'] }"
FAULTS = (
    "const done = arguments[arguments.length - 1];"
    f"axe.run(document, {WCAG}).then(found => done(found.violations.map(rule =>"
    " [rule.id, rule.nodes.slice(0, 5).map(node => node.target.join())])), error => done([String(error)]))"
)
TOO_SMALL = (
    "return [...document.querySelectorAll('#table-panel *')].filter(one => one.getClientRects().length && "
    "[...one.childNodes].some(node => node.nodeType === 3 && node.textContent.trim()) && "
    "parseFloat(getComputedStyle(one).fontSize) < 12).map(one => one.outerHTML)"
)
UNSAID = (
    "return [...document.querySelectorAll('#table-panel button')].filter(one => "
    "one.dataset.key && !one.querySelector('kbd')).map(one => one.textContent)"
)


@pytest.mark.slow
@pytest.mark.skipif(not AXE.exists(), reason="page/node_modules is missing")
@pytest.mark.parametrize("width", [1400, 768, 390])
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_page_with_the_panel_has_no_fault_of_wcag_aa__and_prints_one_sheet(
    session: Session, width: int, theme: str
) -> None:
    desk = Desk(session)
    with Browser(width, 900) as browser, open_server(partial(DeskHandler, desk=desk), 0) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        table = Table(browser, desk, server.server_address[1])
        browser.run(f"document.documentElement.dataset.theme = '{theme}'; eaves.refresh()")
        table.choose(next(iter(session.outlines)))
        table.press("w")
        table.wait("return document.querySelectorAll('#choices svg').length === 3")
        table.press("7", "\ue00c", "c")
        browser.run(AXE.read_text("utf-8"))
        assert browser.run_async(FAULTS) == []
        assert browser.run(TOO_SMALL) == browser.run(UNSAID) == []
        assert browser.run("return document.documentElement.scrollWidth <= innerWidth")
        sheet = {"cmd": "Page.printToPDF", "params": {"preferCSSPageSize": True}}
        pdf = base64.b64decode(browser.call("POST", "/goog/cdp/execute", sheet)["data"])
        assert len(re.findall(rb"/Type\s*/Page\b", pdf)) == 1
        server.shutdown()
        assert browser.errors() == []


def middle_of(selector: str) -> str:
    """The script that brings an element into sight and returns where its middle is in the window."""
    return (
        f"const one = document.querySelector('{selector}'); one.scrollIntoView({{ block: 'center' }});"
        "const box = one.getBoundingClientRect();"
        "return [box.left + box.width / 2, box.top + box.height / 2];"
    )
