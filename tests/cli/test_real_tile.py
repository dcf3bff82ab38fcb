"""`eaves demo --real`: the tile is what its hash says, or a simulated town takes its place."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from http.server import ThreadingHTTPServer
from pathlib import Path

import pytest
from tests.formats.test_remote import Server

from eaves.formats import InputError
from eaves.simulate.demo import SAINT_BARTHELEMY, RealTile, fetch_tile, run_real


@pytest.fixture(scope="module")
def tile(nine_roofs_file: Path) -> Iterator[RealTile]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Server, folder=nine_roofs_file.parent))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    digest = hashlib.sha256(nine_roofs_file.read_bytes()).hexdigest()
    address = f"http://127.0.0.1:{server.server_port}/{nine_roofs_file.name}"
    yield RealTile(address, digest, "EPSG:28992", "nobody")
    server.shutdown()
    server.server_close()


def test_tile_comes_whole_and_with_its_credit(
    tile: RealTile, nine_roofs_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_real(tmp_path, tile) == 0
    assert fetch_tile(tile, tmp_path / "points").read_bytes() == nine_roofs_file.read_bytes()
    told = capsys.readouterr().out
    assert "nobody" in told and "9 buildings" in told


def test_changed_tile_is_refused_and_not_kept(tile: RealTile, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="it was changed there"):
        fetch_tile(replace(tile, sha256="0" * 64), tmp_path)
    assert not list(tmp_path.iterdir())


def test_without_a_network_it_says_so(
    tile: RealTile, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_real(tmp_path, replace(tile, address=f"{tile.address}.not")) is None
    assert "a simulated town takes its place" in capsys.readouterr().out
    assert SAINT_BARTHELEMY.address.startswith("https://") and len(SAINT_BARTHELEMY.sha256) == 64
