"""The real tile of `eaves demo --real`: an open one of a fixed address, checked by its hash."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import typer

from eaves.formats import InputError
from eaves.formats.points.remote import Traffic, fetch
from eaves.report.build import build


@dataclass(frozen=True)
class RealTile:
    """A file of points by its address, the hash of its bytes, its reference system and who is credited."""

    address: str
    sha256: str
    crs: str
    credit: str


SAINT_BARTHELEMY = RealTile(
    "https://raw.githubusercontent.com/IGNF/lidar-prod/2cb12d9ef5ac9f3a3ed08e8776453e167cd4f251/"
    "tests/files/St_Barth_RGAF09_UTM20N_IGN_1988_SB_subset_100m.laz",
    "d98b32d7c6bff8a99131e4260f935f69541399a9f18ff8c153739cf65762113b",
    "EPSG:5490",
    "IGN, LiDAR HD, Licence Ouverte Etalab 2.0",
)
"""A dense quarter under trees, 100 m wide, 249,120 points, 1 MB."""


def fetch_tile(tile: RealTile, folder: Path) -> Path:
    """The tile in a folder.

    Raises
    ------
    InputError
        When there is no network, or its bytes are others than they were.
    """
    path = fetch(tile.address, folder, None, None, Traffic())
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    if digest != tile.sha256:
        path.unlink()
        raise InputError(f"{tile.address}: its SHA-256 is {digest}, not {tile.sha256}; it was changed there")
    return path


def run_real(folder: Path, tile: RealTile = SAINT_BARTHELEMY) -> int | None:
    """Fetch the tile and build it; 0 when all is well, None where it cannot be had, and says why."""
    try:
        path = fetch_tile(tile, folder / "points")
    except InputError as error:
        typer.echo(f"no real tile: {error}\na simulated town takes its place")
        return None
    typer.echo(f"{path.name}: {tile.credit}")
    summary = build(path, folder / "built", crs=tile.crs)
    typer.echo(summary.as_text())
    return 0 if summary.complete else 1
