"""`eaves view --serve`: what is served, to whom, and what a browser shows of it."""

from __future__ import annotations

import http.client
import json
import shutil
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from eaves.model.summary import Summary
from eaves.report.serve import Server, TileSite, make_site, open_server, write_site

from .browser import Browser, missing


@pytest.fixture(scope="module")
def site(nine_run: Summary, tmp_path_factory: pytest.TempPathFactory) -> TileSite:
    """The run without tiles, with a secret beside it and a way out."""
    folder = tmp_path_factory.mktemp("serve") / "run"
    folder.mkdir()
    for name in ("buildings.city.jsonl", "dtm.tif", "run.json", "report.html"):
        shutil.copy(nine_run.folder / name, folder)
    made = make_site(folder)
    (folder.parent / "secret.txt").write_text("secret")
    (folder / "3dtiles" / "out.json").symlink_to(folder.parent / "secret.txt")
    return made


@pytest.fixture(scope="module")
def server(site: TileSite) -> Iterator[Server]:
    with open_server(site, 0) as serving:
        thread = threading.Thread(target=serving.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield serving
        serving.shutdown()
        thread.join(10)


def ask(server: Server, address: str, host: str = "127.0.0.1", method: str = "GET") -> tuple[int, str, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", server.server_address[1], timeout=20)
    connection.request(method, address, headers={"Host": host})
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer.status, answer.getheader("Content-Type") or "", content


def test_tiles_of_a_run_without_any_hold_every_building(site: TileSite) -> None:
    count = 0
    for path in (site.folder / "3dtiles" / "content").glob("*.glb"):
        data = path.read_bytes()
        document = json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])
        count += document["extensions"]["EXT_structural_metadata"]["propertyTables"][0]["count"]
    assert count == 9


def test_the_ground_lies_under_the_tiles(site: TileSite) -> None:
    tileset = json.loads((site.folder / "3dtiles" / "tileset.json").read_text())
    ground = json.loads(site.made["ground.json"])
    *centre, radius = tileset["root"]["boundingVolume"]["sphere"]
    away = sum((one - two) ** 2 for one, two in zip(centre, ground["centre"], strict=True)) ** 0.5
    assert ground["rows"] > 10 and away < radius


@pytest.mark.parametrize(
    ("address", "kind"),
    [
        ("/", "text/html; charset=utf-8"),
        ("/viewer.js", "text/javascript; charset=utf-8"),
        ("/three-tiles.LICENSE.txt", "text/plain; charset=utf-8"),
        ("/3dtiles/tileset.json?v=1", "application/json"),
        ("/3dtiles/content/1.glb", "model/gltf-binary"),
        ("/report.html", "text/html; charset=utf-8"),
    ],
)
def test_what_the_viewer_needs_is_served_with_its_type(server: Server, address: str, kind: str) -> None:
    status, told, content = ask(server, address)
    assert (status, told) == (200, kind) and content
    assert ask(server, address, method="HEAD")[2] == b""


@pytest.mark.parametrize(
    "address",
    [
        *("/../secret.txt", "/3dtiles/../../secret.txt", "/%2e%2e/secret.txt", "/3dtiles/out.json"),
        *("//etc/passwd", "/3dtiles/%00", "/run.json", "/3dtiles", "/nothing", "/" + "a" * 3000),
    ],
)
def test_what_is_not_of_the_site_is_refused(server: Server, address: str) -> None:
    status, _, content = ask(server, address)
    assert status == 404 and b"secret" not in content


def test_a_foreign_name_that_points_here_is_refused(server: Server) -> None:
    assert ask(server, "/", host="evil.example")[0] == 403
    assert ask(server, "/", host="localhost:8017")[0] == 200
    assert ask(server, "/", method="POST")[0] == 501


def test_only_this_computer_is_served(server: Server) -> None:
    assert server.server_address[0] == "127.0.0.1"


def test_a_port_in_use_is_one_line(site: TileSite) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(ValueError, match=f"--port {port}: is in use; give another"):
            open_server(site, port)


def test_a_static_folder_holds_all_that_is_served(site: TileSite, tmp_path: Path) -> None:
    page = write_site(site, tmp_path / "static")
    assert page.name == "index.html"
    there = {path.relative_to(page.parent).as_posix() for path in page.parent.rglob("*") if path.is_file()}
    assert there >= {*site.made, "3dtiles/tileset.json", "3dtiles/content/1.glb", "report.html"}
    with pytest.raises(ValueError, match="is the folder of the run"):
        write_site(site, site.folder)


def test_a_folder_without_a_run_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="give the folder of a run"):
        make_site(tmp_path)


@pytest.mark.slow
def test_control_c_ends_it_without_an_error(site: TileSite) -> None:
    command = [sys.executable, "-m", "eaves", "view", site.folder, "--serve", "--port", "0", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as serving:
        assert serving.stdout is not None
        assert "http://127.0.0.1:" in serving.stdout.readline()
        serving.send_signal(signal.SIGINT)
        assert serving.wait(20) == 0
        assert serving.stderr is not None and serving.stderr.read() == ""


FIRST_BUILDING = """
const box = document.getElementById('scene').getBoundingClientRect();
for (let x = 5; x < box.width; x += 20) for (let y = 5; y < box.height; y += 20) {
  const id = eaves.pick(x, y);
  if (id) return [box.left + x, box.top + y, id];
}
"""


@pytest.mark.skipif(bool(missing()), reason=missing())
def test_a_browser_shows_the_tiles_and_the_address_keeps_the_view(server: Server, artefacts: Path) -> None:
    start = f"http://127.0.0.1:{server.server_address[1]}/"
    with Browser() as window:

        def visit(state: str) -> None:
            window.call("POST", "/url", {"url": "about:blank"})
            window.call("POST", "/url", {"url": f"{start}#{state}"})
            limit = time.monotonic() + 60
            while window.run("return document.documentElement.dataset.still") != "yes":
                assert time.monotonic() < limit, window.errors()
                time.sleep(0.05)

        visit("colour=type")
        assert window.run("return document.getElementById('shown').textContent").startswith("9 of 9")
        window.picture(artefacts / "serve.png")
        ids = window.run("return [...eaves.models.values()].flatMap(one => one.rows).map(row => row.id)")
        assert len(set(ids)) == 9
        window.run(f"eaves.choose({ids[4]!r}); eaves.look([10, -60, 50], [10, 5, 0]); eaves.keepAddress()")
        address = window.run("return location.hash.slice(1)")
        assert "colour=type" in address and f"id={ids[4]}" in address
        visit(address)
        assert window.run("return document.documentElement.dataset.chosen") == ids[4]
        assert window.run("return eaves.camera.position.toArray()") == pytest.approx([10, -60, 50], abs=0.01)
        window.run("eaves.view('above')")
        window.settle()
        x, y, picked = window.run(FIRST_BUILDING)
        window.click(x, y)
        assert picked in ids and window.run("return document.documentElement.dataset.chosen") == picked
        assert picked in window.run("return document.getElementById('building').textContent")
        assert window.errors() == []
