"""`eaves view --serve` and `--site`: what is written, who is served, and what a browser shows of it."""

from __future__ import annotations

import http.client
import json
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import shapely

from eaves.model.summary import Summary
from eaves.report.contents import read_contents
from eaves.report.output import iter_arrays, packed_array
from eaves.report.sample import Sample
from eaves.report.view import (
    SQUARE,
    Server,
    box_heights,
    open_server,
    open_site,
    split_points,
    squares_of,
    write_site,
)

from .browser import Browser, missing


@pytest.fixture(scope="module")
def site(nine_run: Summary, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site of the run, with a secret beside it and a way out."""
    folder = tmp_path_factory.mktemp("serve") / "site"
    write_site(nine_run.folder, folder)
    (folder.parent / "secret.txt").write_text("secret")
    (folder / "city" / "out.json").symlink_to(folder.parent / "secret.txt")
    return folder


@pytest.fixture(scope="module")
def server(site: Path) -> Iterator[Server]:
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


@pytest.mark.slow
def test_squares_hold_what_the_report_embeds(nine_run: Summary, site: Path) -> None:
    """The nine houses stand in one square: its arrays are those of the report, byte for byte."""
    square = json.loads((site / "city" / "0.json").read_text())["arrays"]
    embedded = dict(iter_arrays(read_contents(nine_run.folder)))
    for name in ("triangle_xyz", "triangle_kind", "triangle_building", "outline_building", "point_class"):
        assert square[name] == packed_array(embedded[name])
    boxes = json.loads((site / "city" / "boxes.json").read_text())
    rows = json.loads((site / "city" / "rows.json").read_text())
    assert boxes["buildings"] == 9 and "id" in rows["names"]


def test_every_building_and_its_points_are_in_one_square() -> None:
    """Two houses on both sides of a side of the squares; a point of one that lies beyond stays with it."""
    west, east = (shapely.box(x, 10.0, x + 8.0, 18.0) for x in (SQUARE - 9.0, SQUARE + 1.0))
    squares = squares_of([west, east])
    assert squares == {(0, 0): [0], (1, 0): [1]}
    xyz = np.array(
        [[SQUARE - 5.0, 12.0, 3.0], [SQUARE + 0.2, 12.0, 3.0], [SQUARE + 5.0, 90.0, 0.0], [-4.0, 0.0, 0.0]]
    )
    building = np.array([7, 7, 0, 0], np.int32)
    zeros = np.zeros(4, np.uint8)
    sample = Sample(xyz, zeros, building, building, zeros, total=4)
    parts = split_points(sample, [{"number": 7}, {"number": 8}], squares)
    assert [part.tolist() for part in parts] == [[0, 1], [2]]


def test_a_box_is_as_high_as_its_building() -> None:
    rows = [{"h_ground": 3.0, "measuredHeight": 7.5}, {"h_ground": 2.0, "measuredHeight": None}]
    assert box_heights(rows, 1.0).tolist() == [[2.0, 9.5], [1.0, 1.2]]


@pytest.mark.parametrize(
    ("address", "kind"),
    [
        ("/", "text/html; charset=utf-8"),
        ("/index.html", "text/html; charset=utf-8"),
        ("/city/boxes.json?v=1", "application/json"),
        ("/city/0.json", "application/json"),
    ],
)
def test_what_the_viewer_needs_is_served_with_its_type(server: Server, address: str, kind: str) -> None:
    status, told, content = ask(server, address)
    assert (status, told) == (200, kind) and content
    assert ask(server, address, method="HEAD")[2] == b""


@pytest.mark.parametrize(
    "address",
    [
        *("/../secret.txt", "/city/../../secret.txt", "/%2e%2e/secret.txt", "/city/out.json"),
        *("//etc/passwd", "/city/%00", "/run.json", "/city", "/nothing", "/" + "a" * 3000),
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


def test_a_port_in_use_is_one_line(site: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(ValueError, match=f"--port {port}: is in use; give another"):
            open_server(site, port)


def test_a_site_is_made_again_only_after_the_run(nine_run: Summary) -> None:
    page = open_site(nine_run.folder) / "index.html"
    first = page.stat().st_mtime_ns
    assert open_site(nine_run.folder) / "index.html" == page and page.stat().st_mtime_ns == first
    with pytest.raises(ValueError, match="is the folder of the run"):
        write_site(nine_run.folder, nine_run.folder)


def test_a_folder_without_a_run_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="give the folder of a run"):
        open_site(tmp_path)


@pytest.mark.slow
def test_control_c_ends_it_without_an_error(nine_run: Summary) -> None:
    command = [
        sys.executable,
        "-m",
        "eaves",
        "view",
        nine_run.folder,
        "--serve",
        "--port",
        "0",
        "--no-browser",
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as serving:
        assert serving.stdout is not None
        assert "http://127.0.0.1:" in serving.stdout.readline()
        serving.send_signal(signal.SIGINT)
        assert serving.wait(20) == 0
        assert serving.stderr is not None and serving.stderr.read() == ""


@pytest.mark.slow
@pytest.mark.skipif(bool(missing()), reason=missing())
def test_a_browser_shows_boxes_far_away_and_models_near__and_the_address_keeps_the_view(
    server: Server, artefacts: Path
) -> None:
    start = f"http://127.0.0.1:{server.server_address[1]}/"
    with Browser() as window:

        def visit(state: str) -> None:
            window.call("POST", "/url", {"url": "about:blank"})
            window.call("POST", "/url", {"url": f"{start}#{state}"})
            wait("document.documentElement.dataset.ready === 'yes'")
            wait("eaves.city.near.length === 1")

        def wait(what: str) -> None:
            limit = time.monotonic() + 60
            while not window.run(f"return {what}"):
                assert time.monotonic() < limit, window.errors()
                time.sleep(0.05)
            window.settle()

        visit("models=type")
        window.picture(artefacts / "serve.png")
        boxes = "eaves.scene.triangles.lod.filter(lod => lod === 255).length"
        near = window.run("return eaves.scene.triangles.count")
        assert window.run(f"return [{boxes}, eaves.all.length]") == [0, 9] and near > 90
        window.run("eaves.camera.distance = 5000; eaves.ask()")
        wait("eaves.city.near.length === 0")
        assert window.run(f"return [{boxes}, eaves.scene.triangles.count]") == [90, 90]
        ids = window.run("return eaves.all.map(row => row.id)")
        visit(f"id={ids[4]}&view=above")
        assert window.run("return document.documentElement.dataset.chosen") == ids[4]
        assert window.run("return eaves.scene.points.count") > 100
        assert "of its points are drawn" in window.run(
            "return document.getElementById('building').textContent"
        )
        assert window.run("return eaves.camera.flat") and window.errors() == []
