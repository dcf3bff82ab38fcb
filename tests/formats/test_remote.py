"""Points by http from a server on this computer, whose every byte is counted."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import ClassVar

import laspy
import numpy as np
import pytest
from tests.formats.copc_writer import write_copc

from eaves.formats import InputError, find_inputs, iter_chunks, open_source
from eaves.formats.points.remote import SLOWEST, RemoteFile, Traffic, localise
from eaves.model.summary import Summary

SIDE = 400.0
CORNER = np.array([85_000.0, 447_000.0])


class Server(BaseHTTPRequestHandler):
    """Ranges of the files of a folder; `/plain/` without ranges, `/moved/` elsewhere."""

    sent = 0
    asked: ClassVar[list[int]] = []

    def __init__(self, *given: object, folder: Path) -> None:
        self.folder = folder
        super().__init__(*given)  # type: ignore[arg-type]

    def do_GET(self) -> None:
        path, _, query = self.path.partition("?")
        if path.startswith("/moved/"):
            self.send_response(302)
            self.send_header("Location", "ftp://elsewhere/a.laz" if "away" in query else self.path)
            self.end_headers()
            return
        file = self.folder / Path(path).name
        if not file.is_file():
            self.send_error(404)
            return
        data = file.read_bytes()
        first, last = (int(n) for n in self.headers["Range"].removeprefix("bytes=").split("-"))
        piece = data if path.startswith("/plain/") else data[first : last + 1]
        self.send_response(200 if path.startswith("/plain/") else 206)
        if not path.startswith("/plain/"):
            self.send_header("Content-Range", f"bytes {first}-{first + len(piece) - 1}/{len(data)}")
        self.send_header("Content-Length", str(len(piece)))
        self.end_headers()
        Server.sent += len(piece)
        Server.asked.append(first)
        with suppress(ConnectionError):  # who wanted a range does not wait for the whole
            self.wfile.write(piece)

    def log_message(self, format: str, *args: object) -> None:
        pass


@pytest.fixture(scope="module")
def copc(tmp_path_factory: pytest.TempPathFactory) -> Path:
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, 0.001), [*CORNER, 0.0]
    las = laspy.LasData(header)
    rng = np.random.default_rng(7)
    las.x, las.y = CORNER[:, None] + rng.uniform(0, SIDE, (2, 300_000))
    las.z = rng.normal(0, 5, 300_000)
    path = tmp_path_factory.mktemp("served") / "tile.copc.laz"
    write_copc(path, las, levels=4, coarser=64)
    return path


@pytest.fixture(scope="module")
def address(copc: Path) -> Iterator[str]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Server, folder=copc.parent))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


def points_of(path: Path, west: float, south: float, east: float, north: float) -> np.ndarray:
    xyz = np.concatenate([chunk.xyz for chunk in iter_chunks(open_source(path, "EPSG:28992"))])
    inside = (xyz[:, 0] >= west) & (xyz[:, 0] < east) & (xyz[:, 1] >= south) & (xyz[:, 1] < north)
    return np.asarray(xyz[inside][np.lexsort(xyz[inside].T)])


def test_of_a_hundredth_of_the_area_few_bytes_are_read_and_all_points(
    copc: Path, address: str, tmp_path: Path
) -> None:
    west, south = CORNER + 110.0
    bounds = (west, south, west + SIDE / 10, south + SIDE / 10)
    before = Server.sent
    Server.asked.clear()
    [local], traffic = localise(f"{address}/tile.copc.laz?token=secret", tmp_path, bounds)
    np.testing.assert_array_equal(points_of(Path(local), *bounds), points_of(copc, *bounds))
    whole = copc.stat().st_size  # so small that requests of 16 KB weigh
    assert traffic.read == Server.sent - before < 0.15 * whole and traffic.whole == whole
    assert len(set(Server.asked)) == len(Server.asked)  # nothing twice
    assert "secret" not in str(local) + json.dumps(traffic.as_json())
    again, kept = localise(f"{address}/tile.copc.laz?token=secret", tmp_path, bounds)
    assert again == [local] and kept.read <= 1 << 17


def test_without_bounds_the_file_is_read_whole(copc: Path, address: str, tmp_path: Path) -> None:
    [local], _ = localise(f"{address}/tile.copc.laz", tmp_path)
    assert Path(local).read_bytes() == copc.read_bytes()


@pytest.mark.parametrize(
    ("place", "rule"),
    [
        ("/plain/tile.copc.laz?token=secret", "its server gives no ranges"),
        ("/missing.laz?token=secret", "the server answers 404"),
        ("/moved/tile.laz?token=secret", "the server answers 302"),
        ("/moved/tile.laz?token=secret&away", "is neither http nor https"),
    ],
)
def test_server_that_does_not_give_the_file_is_one_line_without_secrets(
    place: str, rule: str, address: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=rule) as refused:
        localise(address + place, tmp_path)
    assert "secret" not in str(refused.value) and "\n" not in str(refused.value)


class Slow(BaseHTTPRequestHandler):
    """Answers nothing to `/silent`, a byte at a time to `/dripping`, a thousand times as fast to `/slow`."""

    def do_GET(self) -> None:
        if self.path == "/silent":
            self.rfile.read(1)  # until the other end gives up
            return
        first, last = (int(n) for n in self.headers["Range"].removeprefix("bytes=").split("-"))
        self.send_response(206)
        self.send_header("Content-Range", f"bytes {first}-{last}/{SLOWEST * 8}")
        self.end_headers()
        piece, pause = (b"a", 0.02) if self.path == "/dripping" else (b"a" * (SLOWEST // 2), 0.1)
        with suppress(ConnectionError):
            for _ in range(0, min(last + 1, SLOWEST * 8) - first, len(piece)):
                self.wfile.write(piece)
                time.sleep(pause)

    def log_message(self, format: str, *args: object) -> None:
        pass


@pytest.mark.parametrize("path", ["silent", "dripping", "slow"])
def test_a_server_that_is_slow_is_waited_for__one_that_never_ends_is_a_line(path: str) -> None:
    with ThreadingHTTPServer(("127.0.0.1", 0), Slow) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_port}/{path}"
        if path == "slow":  # for longer than the patience
            assert RemoteFile(address, Traffic(), patience=0.4).read() == b"a" * SLOWEST * 8
        else:
            with pytest.raises(
                InputError, match=rf"/{path}: cannot be read \(no answer within 0.4 s\); check"
            ):
                RemoteFile(address, Traffic(), patience=0.4)
        server.shutdown()


@pytest.mark.parametrize("given", ["ftp://host/a.laz", "s3://host/a.laz", "http://user:pass@host/a.laz"])
def test_other_schemes_and_users_are_refused(given: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        localise(given, tmp_path)
    assert "pass@" not in str(refused.value)


def listed(href: str, west: float = 0.0) -> dict[str, object]:
    box = [CORNER[0] + west, CORNER[1], CORNER[0] + west + SIDE, CORNER[1] + SIDE]
    return {"type": "Feature", "properties": {"proj:bbox": box}, "assets": {"data": {"href": href}}}


def test_list_names_files_of_its_folder_or_of_a_server_and_none_outside_the_bounds(
    copc: Path, address: str, tmp_path: Path
) -> None:
    features = [listed("./tile.copc.laz"), listed("far.laz", 5000.0), listed(f"{address}/tile.copc.laz")]
    cloud = copc.parent / "area.vpc"
    cloud.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    inside = (*CORNER, *(CORNER + 40.0))
    near, fetched = localise(cloud, tmp_path, inside)[0]
    assert find_inputs(near) == [copc] and Path(fetched).parent == tmp_path
    one, other = localise(f"{address}/area.vpc", tmp_path, inside)[0]
    assert one == other == fetched


@pytest.fixture(scope="module")
def ept(copc: Path) -> Path:
    """The points of the tile as an EPT of two levels, the second on a page of its own."""
    las, folder = laspy.read(copc), copc.parent
    las.header.vlrs.clear()
    las.evlrs = None
    head = {"bounds": [*CORNER, -200.0, *(CORNER + SIDE), SIDE - 200.0], "dataType": "laszip"}
    (folder / "ept.json").write_text(json.dumps(head | {"hierarchyType": "json"}))
    first = np.arange(len(las.points)) % 4 == 0
    octant = np.column_stack([las.x, las.y, las.z]) >= np.array([*(CORNER + SIDE / 2), SIDE / 2 - 200.0])
    parts = {"0-0-0-0": first}
    for place in np.ndindex(2, 2, 2):
        parts["-".join(map(str, (1, *place)))] = ~first & (octant == place).all(axis=1)
    counts = {name: int(which.sum()) for name, which in parts.items()}
    for sub, places in (("ept-hierarchy", ("0-0-0-0", "1-0-0-0")), ("ept-data", tuple(parts))):
        (folder / sub).mkdir()
        for name in places if sub == "ept-data" else ():
            las[parts[name]].write(folder / sub / f"{name}.laz")
    second = {name: count for name, count in counts.items() if name == "1-0-0-0"}
    pages = {"0-0-0-0": counts | {"1-0-0-0": -1}, "1-0-0-0": second}
    for name, page in pages.items():
        (folder / "ept-hierarchy" / f"{name}.json").write_text(json.dumps(page))
    for file in [*folder.glob("ept-hierarchy/*"), *folder.glob("ept-data/*")]:  # the server knows no folders
        (folder / file.name).write_bytes(file.read_bytes())
    return folder / "ept.json"


def test_tiles_of_an_ept_are_those_that_meet_the_bounds(ept: Path, address: str, tmp_path: Path) -> None:
    whole, _ = localise(ept, tmp_path)
    assert sum(open_source(one).count for one in whole) == 300_000
    for given in (ept, f"{address}/ept.json"):
        some, _ = localise(given, tmp_path, (*(CORNER + 1.0), *(CORNER + 40.0)))
        assert len(some) == 1 + sum(open_source(one).count > 0 for one in some[1:])
        inside = [laspy.read(one) for one in some]
        assert all((las.x <= CORNER[0] + SIDE / 2).all() for las in inside[1:])
    (ept.parent / "binary.json").write_text(ept.read_text().replace("laszip", "binary"))
    with pytest.raises(InputError, match="EPT of binary tiles; build it again with laszip"):
        localise(ept.parent / "binary.json", tmp_path)


@pytest.mark.parametrize("href", ["file:///etc/a.laz", "s3://bucket/a.laz"])
def test_list_on_a_server_names_no_local_file(href: str, copc: Path, address: str, tmp_path: Path) -> None:
    (copc.parent / "bad.vpc").write_text(json.dumps(listed(href)))
    with pytest.raises(InputError, match="is neither http nor https"):
        localise(f"{address}/bad.vpc", tmp_path)


def test_json_that_lists_nothing_is_refused(tmp_path: Path) -> None:
    (tmp_path / "no.vpc").write_text('{"type": "FeatureCollection"}')
    with pytest.raises(InputError, match="is no list of point files"):
        localise(tmp_path / "no.vpc", tmp_path)


def test_a_list_as_deep_as_a_well_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.vpc").write_text("[" * 100_000)
    with pytest.raises(InputError, match=r"a\.vpc: is no list of point files"):
        localise(tmp_path / "a.vpc", tmp_path)


def test_closing_line_counts_the_bytes_read(tmp_path: Path) -> None:
    remote = {"bytes_read": 1_200_000, "bytes": 3_200_000, "addresses": ["http://host/a.copc.laz"]}
    text = Summary(tmp_path, 10, 0, 0, {}, {}, {}, {}, 1.0, (), run={"remote": remote}).as_text()
    assert text.endswith("; 1.2 of 3.2 MB read over the network")
