"""report.html in a real browser."""

from __future__ import annotations

import io
import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import combinations
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
import shapely
from matplotlib.image import imread, imsave
from pyproj import Transformer

from eaves.model.summary import Summary
from eaves.pipeline import build
from eaves.report.contents import CityFace, CityFaces, Contents, read_contents
from eaves.report.output import iter_page
from eaves.report.view import render_beside
from eaves.simulate import scan_town, simulate_town, write_simulation

from .browser import Browser, missing
from .test_basemap import write_image

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

    move = "const find = document.getElementById('find'); find.value = TEXT;"
    move += " find.dispatchEvent(new Event('change'));"
    east, north = (round(float(value), 2) for value in browser.run("return eaves.origin.slice(0, 2)"))
    browser.run(move.replace("TEXT", f"'{east + 10}, {north - 5}'"))
    assert np.allclose(browser.run("return eaves.camera.target.slice(0, 2)"), [10.0, -5.0], atol=0.02)
    browser.run(move.replace("TEXT", "'1, 2'"))
    assert "outside" in browser.run("return document.getElementById('answer').textContent")

    browser.run("eaves.view('above')")
    browser.settle()
    browser.picture(artefacts / "nine-above.png")
    whole = imread(browser.picture(artefacts / "nine.png"))
    row = int(browser.run("return eaves.spots.findIndex(spot => Number.isFinite(spot.high[2]))"))
    browser.click(*browser.run(MIDDLE_OF.replace("ROW", str(row))))
    assert browser.run(CHOSEN) == ids[row], "a click on a roof chooses its building"
    assert ids[row] in browser.run("return document.getElementById('building').textContent")
    browser.run(
        "const box = document.getElementById('verdict'); box.value = 'no building';"
        "box.dispatchEvent(new Event('change'))"
    )
    assert browser.run("return eaves.verdicts.text()") == f'id,verdict\r\n"{ids[row]}","no building"\r\n'
    assert browser.run("return document.getElementById('verdicts').hidden") is False
    browser.press("\ue00c")
    assert browser.run(CHOSEN) == "", "escape lets go"
    assert browser.run("return document.getElementById('judge').hidden") is True

    browser.run("for (const name of ['roofs', 'walls', 'edges']) document.getElementById(name).click()")
    browser.settle()
    without = imread(browser.picture(artefacts / "nine-no-models.png"))
    assert np.abs(whole - without).max(axis=2).mean() > 0.01, "models go when their layers are off"

    browser.run("document.querySelectorAll('#buildings tbody tr')[2].focus()")
    browser.press("\ue007")
    third = int(browser.run("return document.querySelectorAll('#buildings tbody tr')[2].dataset.row"))
    assert browser.run(CHOSEN) == ids[third], "enter on a row flies to its building"
    trust = browser.run("return eaves.table.order.map(number => eaves.all[number].trust_score)")
    assert trust == sorted(trust), "the worst building stands first"
    assert browser.errors() == []


@pytest.mark.slow
@pytest.mark.parametrize("width", [1400, 390])
def test_no_button_lies_over_another(width: int, nine_run: Summary, artefacts: Path) -> None:
    with Browser(width, 900) as window:
        window.open(nine_run.folder / "report.html")
        boxes = window.run(
            "return [...document.querySelectorAll('#views button, #compass, nav a, #theme')].map(one =>"
            " one.getBoundingClientRect()).map(box => [box.left, box.top, box.right, box.bottom])"
        )
        assert window.run("return document.documentElement.scrollWidth") <= window.run("return innerWidth")
        window.picture(artefacts / f"nine-{width}.png")
    for one, two in combinations(boxes, 2):
        assert not (max(one[0], two[0]) < min(one[2], two[2]) and max(one[1], two[1]) < min(one[3], two[3]))


@pytest.mark.slow
def test_the_address_shows_the_same_view_again(browser: Browser, nine_run: Summary) -> None:
    browser.open(nine_run.folder / "report.html")
    whole = (
        "const {camera: c, canvas} = eaves, m = c.matrix(c.aspect), {low, high} = c.box; let most = 0;"
        "for (let k = 0; k < 8; k++) { const p = [0, 1, 2].map(a => (k >> a & 1 ? high : low)[a]);"
        "const at = r => m[r] * p[0] + m[4 + r] * p[1] + m[8 + r] * p[2] + m[12 + r];"
        "most = Math.max(most, Math.abs(at(0) / at(3)), Math.abs(at(1) / at(3))); } return most"
    )
    assert 0.9 < browser.run(whole) <= 1.0, "it opens filling the canvas, and nothing lies outside"
    browser.run("document.querySelectorAll('#buildings tbody tr')[0].click()")
    browser.run("eaves.camera.turn(0.3, 0.1); document.getElementById('walls').click(); eaves.ask()")
    browser.settle()
    wait_for(browser, "return location.hash.includes('eye=') && location.hash.includes('off=walls')")
    state = "return [eaves.camera.azimuth, eaves.camera.distance, ...eaves.camera.target]"
    address, seen = browser.run("return location.hash"), browser.run(state)
    chosen = browser.run(CHOSEN)
    browser.run(f"location.href = location.href.split('#')[0] + {address!r}; location.reload()")
    wait_for(browser, "return document.documentElement.dataset.ready === 'yes' && !!window.eaves")
    assert np.allclose(browser.run(state), seen, atol=0.01) and browser.run(CHOSEN) == chosen
    assert browser.run("return document.getElementById('walls').checked") is False


def test_an_address_opens_the_worst_or_a_named_building(browser: Browser, nine_run: Summary) -> None:
    browser.open(nine_run.folder / "report.html")
    ids = browser.run("return eaves.table.order.map(number => eaves.all[number].id)")
    for asked, chosen in (("worst", ids[0]), (ids[4], ids[4])):
        browser.run(f"location.hash = 'building={asked}'")
        wait_for(browser, f"return document.documentElement.dataset.chosen === {chosen!r}")
    browser.run("location.hash = 'models=fit'")
    wait_for(browser, "return document.getElementById('model-colour').value === 'fit'")
    assert "each roof face" in browser.run("return document.getElementById('model-legend').textContent")
    assert browser.errors() == []


def test_the_table_sorts_up_and_down__numbers_as_numbers(browser: Browser, nine_run: Summary) -> None:
    browser.open(nine_run.folder / "report.html")
    areas = (
        "return [...document.querySelectorAll('#buildings tbody tr')]"
        ".map(line => Number(line.cells[COLUMN].textContent.replace(',', '')))"
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


@pytest.mark.slow
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


TURN = """
const done = arguments[0], began = performance.now(), first = eaves.pace.painted;
const step = () => {
  eaves.camera.turn(0.02, 0);
  eaves.ask();
  if (performance.now() - began < 2500) requestAnimationFrame(step);
  else done([eaves.pace.painted - first, eaves.pace.quality, document.getElementById('moving').textContent]);
};
requestAnimationFrame(step);
"""


@pytest.mark.slow
def test_it_shows_what_it_leaves_out_while_it_moves__and_draws_all_at_rest(
    browser: Browser, nine_run: Summary
) -> None:
    browser.open(nine_run.folder / "report.html", "on=points-building,points-ground")
    browser.run("eaves.pace.quality = 4; eaves.pace.adapt = () => {}; eaves.ask()")
    painted, quality, told = browser.run_async(TURN)
    assert painted > 3
    assert quality > 0 and "While it moves" in told and "points" in told
    browser.settle()
    assert browser.run("return document.getElementById('moving').hidden")
    assert browser.run("return eaves.canvas.width === eaves.canvas.clientWidth")
    assert browser.errors() == []


@pytest.mark.slow
def test_ten_thousand_rows_scroll_sort_and_are_found(
    browser: Browser, nine_run: Summary, tmp_path: Path
) -> None:
    contents = read_contents(nine_run.folder)
    others = [
        {**contents.rows[0], "id": f"far-{k}", "area_m2": 500.0 + k, "trust_score": 1.0}
        for k in range(10_000)
    ]
    found = len(contents.rows) + len(others)
    page = tmp_path / "report.html"
    pieces = iter_page(replace(contents, others=others, buildings=found), "many")
    page.write_text("".join(pieces), encoding="utf-8")
    browser.open(page)
    assert f"{found:,} buildings, {len(contents.rows)} of them drawn" in browser.run(
        "return document.body.textContent"
    )
    lines = "return document.querySelectorAll('#buildings tbody tr').length"
    assert browser.run(lines) < 100
    browser.run("document.querySelector('#buildings').parentElement.scrollTop = 1e9")
    browser.settle()
    wait_for(browser, "return document.querySelector('#buildings tbody').textContent.includes('far-9999')")
    browser.run("eaves.table.box.scrollTop = 0; eaves.table.fill(); eaves.table.body.rows[0].focus()")
    browser.press("\ue010", "\ue007")
    assert browser.run(CHOSEN) == "far-9999", "end and enter choose the last"
    assert "eaves view OUT --around far-9999" in browser.run(
        "return document.getElementById('building').textContent"
    )
    assert browser.run(lines) < 100
    assert browser.errors() == []


def wait_for(browser: Browser, question: str) -> None:
    limit = time.monotonic() + 20
    while not browser.run(question):
        assert time.monotonic() < limit, question
        time.sleep(0.05)


@pytest.mark.slow
def test_a_thousand_buildings_and_300000_points_turn_without_a_graphics_card(
    tmp_path: Path, artefacts: Path
) -> None:
    """Frames are counted and printed; a picture of the moving scene is kept."""
    points = scan_town(simulate_town(0.09, seed=4), density=10.0, seed=4)
    write_simulation(points, tmp_path / "town")
    build(tmp_path / "town" / "points.laz", tmp_path / "out")
    contents = read_contents(tmp_path / "out")
    many = repeat_to(contents, 1000)
    page = tmp_path / "report.html"
    page.write_text("".join(iter_page(many, "many")), encoding="utf-8")
    with Browser() as window:
        window.open(page, "on=points-building,points-ground")
        window.run_async(TURN)
        painted, _, _ = window.run_async(TURN)
        window.picture(artefacts / "thousand-moving.png")
        window.settle()
        window.picture(artefacts / "thousand-still.png")
        assert window.errors() == []
    print(f"{len(many.rows)} buildings, {len(many.points)} points: {2500 / painted:.0f} ms a frame, turning")
    assert 2500 / painted < 1000, "even on a busy machine"


def repeat_to(contents: Contents, count: int) -> Contents:
    """The contents with the buildings repeated side by side."""
    own, rows, polygons, faces = len(contents.rows), [], [], []
    for copy in range(-(-count // own)):
        move = np.array([320.0 * (copy % 4), 320.0 * (copy // 4), 0.0])
        rows += [
            {**row, "id": f"{row['id']}-{copy}", "number": row["number"] + copy * own}
            for row in contents.rows
        ]
        polygons += [shapely.transform(shape, lambda xy, by=move: xy + by[:2]) for shape in contents.polygons]
        table = contents.faces.table.moved(move)
        faces += [
            CityFace(tuple(table.rings_of(k)), building + copy * own, lod, kind)
            for k, (building, lod, kind) in enumerate(
                zip(contents.faces.building, contents.faces.lod, contents.faces.kind, strict=True)
            )
        ]
    return replace(contents, rows=rows, polygons=polygons, faces=CityFaces.of(faces), buildings=len(rows))


PLACES = """
const box = eaves.canvas.getBoundingClientRect();
return ENDS.map(place => { const at = eaves.tools.seen(place); return [at.x + box.left, at.y + box.top]; });
"""


def test_clicks_measure_between_corners_and_the_address_keeps_it(browser: Browser, nine_run: Summary) -> None:
    browser.open(nine_run.folder / "report.html")
    browser.run("document.getElementById('points-other').click(); eaves.view('above')")
    browser.settle()
    longest = """
const { xyz, lod, count } = eaves.scene.edges; let best = [], size = 0;
for (let k = 0; k < count; k++) {
  const [one, two] = [0, 3].map(start => [...xyz.subarray(6 * k + start, 6 * k + start + 3)]);
  const [east, north, up] = two.map((value, axis) => value - one[axis]);
  const straight = Math.hypot(east, north, up);
  const { lods } = JSON.parse(document.getElementById('data').textContent);
  const finest = lod[k] === lods.indexOf('2.2');
  if (finest && straight > size && Math.abs(up) < 0.01) [best, size] = [[one, two], straight];
}
return [best, size];"""
    ends, size = browser.run(longest)
    browser.press("m")
    if browser.run("return eaves.ruler.active") is False:  # the key went elsewhere: the button does it, too
        browser.run("document.getElementById('measure').click()")
    for place in browser.run(PLACES.replace("ENDS", str(ends))):
        browser.click(*place)
    assert browser.run("return eaves.ruler.places.length") == 2
    told = browser.run("return document.querySelector('#ruler text').textContent")
    assert float(told.split(" m")[0]) == pytest.approx(size, abs=0.02)
    assert browser.run(CHOSEN) == "", "a click that measures chooses no building"
    address = browser.run("return eaves.address()")
    browser.run("eaves.ruler.toggle(false)")
    assert browser.run("return document.querySelectorAll('#ruler line').length") == 0
    browser.run(f"history.replaceState(null, '', {address!r}); eaves.obeyAddress(location.hash)")
    browser.settle()
    assert browser.run("return document.querySelector('#ruler text').textContent") == told
    assert browser.errors() == []


def test_ground_is_darker_beside_houses_than_in_the_open(browser: Browser, nine_run: Summary) -> None:
    browser.open(nine_run.folder / "report.html")
    low, high = browser.run(
        "const { light } = eaves.scene.grounds[0]; return [Math.min(...light), Math.max(...light)]"
    )
    assert 0.45 < low < 0.8 and high > 0.97


HEIGHTS_BY_RAY = """
const { profile, ruler, layers, scene } = eaves, [one, two] = ruler.places, answers = [];
const top = (xyz, list, x, y) => {
  let best = null;
  for (let place = 0; place < list.length; place += 3) {
    const [a, b, c] = [0, 1, 2].map(k => xyz.subarray(3 * list[place + k], 3 * list[place + k] + 3));
    const [ux, uy, vx, vy] = [b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]], size = ux * vy - uy * vx;
    const [px, py] = [x - a[0], y - a[1]], one = (px * vy - py * vx) / size, two = (ux * py - uy * px) / size;
    const height = a[2] + one * (b[2] - a[2]) + two * (c[2] - a[2]);
    if (size && one >= 0 && two >= 0 && one + two <= 1) best = Math.max(best ?? -1e9, height);
  }
  return best;
};
for (let part = 0.5; part < 40; part += 2) {
  const [x, y] = [0, 1].map(axis => one[axis] + part / 40 * (two[axis] - one[axis]));
  const found = profile.at(part / 40 * profile.whole), { position, details } = scene.grounds[0];
  const model = top(scene.triangles.xyz, layers.models.shown, x, y), ground = top(position, details[0], x, y);
  answers.push([found.model, model, found.ground, ground]);
}
return answers;"""


@pytest.mark.slow
def test_the_profile_has_the_heights_of_what_it_cuts(browser: Browser, nine_run: Summary) -> None:
    browser.open(nine_run.folder / "report.html", "measure=-40,-31,0,43,37,0&profile=1")
    answers = browser.run(HEIGHTS_BY_RAY)
    models = [(model, ray) for model, ray, _, _ in answers]
    assert sum(ray is not None for _, ray in models) > 2, "the line crosses houses"
    assert all((model is None) == (ray is None) for model, ray in models)
    assert all(model == pytest.approx(ray, abs=0.002) for model, ray in models if ray is not None)
    assert all(ground == pytest.approx(ray, abs=0.002) for _, _, ground, ray in answers)
    length = browser.run("return eaves.profile.whole")
    assert length == pytest.approx(np.hypot(83, 68), abs=1e-6)
    told = browser.run(
        "eaves.profile.point(400); return [...document.querySelectorAll('#profile text')].pop().textContent"
    )
    assert "m along, height" in told and "profile=1" in browser.run("return eaves.address()")
    assert browser.errors() == []


@pytest.mark.slow
def test_other_points_are_translucent_and_never_over_roofs(
    browser: Browser, nine_run: Summary, tmp_path: Path
) -> None:
    contents = read_contents(nine_run.folder)
    trees = contents.points.with_(
        building=np.zeros_like(contents.points.building),
        classification=np.full_like(contents.points.classification, 5),
    )
    page = tmp_path / "report.html"
    page.write_text("".join(iter_page(replace(contents, points=trees), "all is trees")), encoding="utf-8")
    browser.open(page)
    opacity, *shown = browser.run(
        "const { other } = eaves.layers, { xyz } = eaves.scene.points;"
        "return [other.opacity, ...[...other.shown].map(k => [xyz[3 * k], xyz[3 * k + 1]])]"
    )
    assert 0 < opacity < 1
    inner, outer = (
        shapely.union_all([shapely.buffer(shape, far) for shape in contents.polygons])
        for far in (-0.75, 0.75)
    )
    assert not shapely.contains_xy(inner, np.array(shown)).any()
    assert len(shown) >= np.count_nonzero(~shapely.contains_xy(outer, trees.xyz[:, :2]))


@pytest.mark.slow
def test_an_aerial_image_lies_over_the_terrain(
    browser: Browser, nine_run: Summary, tmp_path: Path, artefacts: Path
) -> None:
    contents = read_contents(nine_run.folder)
    place = contents.terrain.bounds.translated(*contents.origin)
    colours = np.zeros((3, 100, 100), np.uint8)
    colours[0, :, :50], colours[2, :, 50:] = 255, 255  # red in the west, blue in the east
    path = write_image(tmp_path / "image.tif", colours, place, "EPSG:28992")
    page = tmp_path / "report.html"
    found = read_contents(nine_run.folder, basemap=path)
    page.write_text("".join(iter_page(found, "with an image")), encoding="utf-8")
    state = "view=above&off=roofs,walls,edges,prints,points-other"
    browser.open(page, state)
    seen = imread(browser.picture(artefacts / "nine-basemap.png"))[300:450, 100:1000, :3]
    red, blue = (seen[..., band] > 0.5 for band in (0, 2))
    assert (
        red[:, 300:400].mean() > 0.9 and blue[:, 500:600].mean() > 0.9 and not (red & blue)[:, 300:400].any()
    )
    assert "aerial image: image.tif" in browser.run("return document.getElementById('shown').textContent")
    browser.open(page, f"{state},basemap")
    plain = imread(browser.picture(artefacts / "nine-no-basemap.png"))[300:450, 300:400, :3]
    assert np.ptp(plain, axis=2).max() < 0.2, "switched off it is the colour of earth"
    assert browser.errors() == []


@contextmanager
def map_server(middle: np.ndarray, found: tuple[float, float]) -> Iterator[tuple[str, list[str]]]:
    """A server of tiles, red west and green north of a place of web mercator (0 to 1), and of one address
    (longitude, latitude); its own address, and what was asked of it."""
    asked: list[str] = []

    class Answer(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            if self.path.startswith("/search"):
                place = {"lon": str(found[0]), "lat": str(found[1]), "display_name": "Church Street 1"}
                body = json.dumps([place]).encode()
            else:
                zoom, column, row = map(int, self.path.removesuffix(".png").split("/")[-3:])
                pixels = (np.arange(256) + 0.5) / 256
                tile = np.zeros((256, 256, 3))
                tile[..., 0] = (column + pixels)[None, :] / 2**zoom < middle[0]
                tile[..., 1] = (row + pixels)[:, None] / 2**zoom < middle[1]
                picture = io.BytesIO()
                imsave(picture, tile, format="png")
                body = picture.getvalue()
            self.send_response(200)
            self.send_header("Access-Control-Allow-Origin", "*")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Answer)
    Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}", asked
    server.shutdown()
    server.server_close()


SET = "const box = document.getElementById('{}'); box.value = '{}'; box.dispatchEvent(new Event('change'))"


@pytest.mark.slow
def test_a_map_and_an_address_are_asked_for_only_when_a_person_wants_them(
    browser: Browser, nine_run: Summary, artefacts: Path
) -> None:
    contents = read_contents(nine_run.folder)
    origin = np.array(contents.origin)
    to_degrees = Transformer.from_crs("EPSG:28992", "EPSG:4326", always_xy=True).transform
    to_world = Transformer.from_crs("EPSG:28992", "EPSG:3857", always_xy=True).transform
    middle = np.array([0.5, 0.5]) + np.array([1, -1]) * to_world(*origin) / (2 * np.pi * 6378137.0)
    with map_server(middle, to_degrees(*(origin + [10, -5]))) as (server, asked):
        state = "view=above&off=roofs,walls,edges,prints,points-other&on=tiles"
        browser.open(nine_run.folder / "report.html", state)
        assert not asked and browser.run("return performance.getEntriesByType('resource').length") == 0
        browser.run(SET.format("tiles", "own"))
        assert not asked
        browser.run(SET.format("own-credit", "© the city"))
        browser.run(SET.format("own-tiles", server + "/{TileMatrix}/{x}/{y}.png"))
        told = "return document.getElementById('requests').textContent"
        wait_for(browser, f"{told}.includes('came from 127.0.0.1')")
        assert f"{len(asked)} of {len(asked)} tiles" in browser.run(told)
        assert browser.run("return document.getElementById('credit').textContent") == "map: © the city"
        browser.settle()
        seen = imread(browser.picture(artefacts / "nine-map.png"))
        ends = [[x, y, 0] for x in (-1.5, 1.5) for y in (-1.5, 1.5)]
        for (x, y, _), (left, down) in zip(ends, browser.run(PLACES.replace("ENDS", str(ends))), strict=True):
            red, green = seen[round(down), round(left), :2] > 0.4
            assert (red, green) == (x < 0, y > 0), "the map lies where the houses stand"

        many = len(asked)
        browser.run(SET.format("geocoder", f"{server}/search"))
        browser.run(SET.format("find", "Church Street 1"))
        assert len(asked) == many, "an address is not asked for until the button is pressed"
        browser.run("document.getElementById('ask').click()")
        wait_for(browser, "return document.getElementById('answer').textContent.includes('Church Street 1')")
        assert np.allclose(browser.run("return eaves.camera.target.slice(0, 2)"), [10.0, -5.0], atol=0.02)
        browser.run(SET.format("tiles", ""))
        assert browser.run("return [eaves.painter.lay, document.getElementById('credit').innerText]") == [
            None,
            "",
        ]
        assert len(asked) == many + 1 and browser.errors() == []


@pytest.mark.slow
def test_two_runs_side_by_side_turn_together(browser: Browser, nine_run: Summary, tmp_path: Path) -> None:
    left = read_contents(nine_run.folder)
    (tmp_path / "other").mkdir()
    # the other run's frame lies elsewhere, as that of other bounds would
    away = np.array([7.0, -3.0])
    right = replace(
        left,
        folder=tmp_path / "other",
        origin=(left.origin[0] - away[0], left.origin[1] - away[1]),
        rows=left.rows[::-1],
        polygons=[shapely.transform(shape, lambda xy: xy + away) for shape in left.polygons[::-1]],
        faces=replace(
            left.faces,
            table=replace(left.faces.table, corners=left.faces.table.corners + [*away, 0.0]),
            building=len(left.rows) - 1 - left.faces.building,
        ),
    )
    page = tmp_path / "beside.html"
    page.write_text(render_beside(left, right), encoding="utf-8")
    browser.open(page)
    frame = "document.querySelectorAll('iframe')[{}].contentWindow"
    one, two = (f"{frame.format(k)}.eaves" for k in (0, 1))
    state = "const c = {}.camera; return [c.azimuth, c.distance, ...c.target]"
    browser.run(f"{one}.camera.turn(0.3, 0.1); {one}.camera.zoom(0.7); {one}.ask()")
    wait_for(browser, f"return Math.abs({two}.camera.azimuth - {one}.camera.azimuth) < 1e-9")
    mine, other = (np.array(browser.run(state.format(viewer))) for viewer in (one, two))
    assert np.allclose(other - mine, [0, 0, 7, -3, 0], atol=1e-6)
    browser.run(f"{two}.camera.turn(-0.2, 0); {two}.ask()")
    wait_for(browser, f"return Math.abs({one}.camera.azimuth - {two}.camera.azimuth) < 1e-9")
    browser.run(f"{one}.choose(2, false)")
    chosen = "return {}.document.documentElement.dataset.chosen"
    wait_for(browser, f"return {frame.format(1)}.document.documentElement.dataset.chosen !== undefined")
    wait_for(browser, f"return {two}.look.chosen > 0")
    assert browser.run(chosen.format(frame.format(1))) == left.rows[2]["id"]
    assert "eye=" in browser.run("return location.hash")
    assert browser.errors() == []
