"""An aerial image lies where it belongs, within its size; what cannot be laid is one line."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
import rasterio
from numpy.typing import NDArray
from rasterio.errors import NotGeoreferencedWarning
from rasterio.io import MemoryFile
from rasterio.transform import Affine

from eaves.formats.crs import parse_crs, system_of
from eaves.model import Bounds
from eaves.model.coordinates import LOCAL_METRES
from eaves.report import contents as basemap
from eaves.report.contents import BEYOND, WORLD_RADIUS, fit_web_mercator, read_basemap

PLACE = Bounds(84960.0, 447120.0, 85200.0, 447300.0)
DUTCH = system_of(parse_crs("EPSG:28992"), "test", (PLACE.west, PLACE.south))
QUARTERS = np.array([[[200, 30, 40], [40, 180, 60]], [[50, 70, 210], [220, 200, 60]]], np.uint8)
"""Colours of the quarters, north row first."""


def grid_of(bounds: Bounds, columns: int, rows: int) -> Affine:
    across, down = bounds.width / columns, bounds.height / rows
    return Affine(across, 0.0, bounds.west, 0.0, -down, bounds.north)


def write_image(path: Path, bands: NDArray[Any], bounds: Bounds, crs: str | None, **more: Any) -> Path:
    count, rows, columns = bands.shape
    transform = grid_of(bounds, columns, rows)
    profile = {"driver": "GTiff", "height": rows, "width": columns, "count": count, "dtype": bands.dtype}
    with rasterio.open(path, "w", transform=transform, crs=crs, **profile) as image:
        image.write(bands)
        if "colormap" in more:
            image.write_colormap(1, more["colormap"])
    return path


def quarters(rows: int = 180, columns: int = 240) -> NDArray[np.uint8]:
    large = QUARTERS.repeat(rows // 2, axis=0).repeat(columns // 2, axis=1)
    return np.ascontiguousarray(np.moveaxis(large, -1, 0))


def colours_of(jpeg: bytes) -> NDArray[np.uint8]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with MemoryFile(jpeg) as memory, memory.open() as image:
            return np.asarray(image.read())


def assert_quarters(colours: NDArray[np.uint8]) -> None:
    _, rows, columns = colours.shape
    for i in (0, 1):
        for j in (0, 1):
            seen = colours[:, rows * (2 * i + 1) // 4, columns * (2 * j + 1) // 4]
            assert np.abs(seen.astype(int) - QUARTERS[i, j]).max() < 12, (i, j)


@pytest.mark.parametrize("crs", ["EPSG:28992", "EPSG:4326", "EPSG:32631"])
def test_an_image_in_any_system_lies_in_place(tmp_path: Path, crs: str) -> None:
    there = pyproj.Transformer.from_crs("EPSG:28992", crs, always_xy=True)
    sides = there.transform_bounds(PLACE.west, PLACE.south, PLACE.east, PLACE.north)
    frame, (rows, columns) = Bounds(*sides), (220, 260)
    x = frame.west + (np.arange(columns) + 0.5) * frame.width / columns
    y = frame.north - (np.arange(rows) + 0.5) * frame.height / rows
    east, north = there.transform(*np.meshgrid(x, y), direction="INVERSE")
    which = (
        (np.asarray(north) < PLACE.south + 90).astype(int),
        (np.asarray(east) > PLACE.west + 120).astype(int),
    )
    path = write_image(tmp_path / "image.tif", np.moveaxis(QUARTERS[which], -1, 0), frame, crs)
    found = read_basemap(path, DUTCH, PLACE)
    assert (found.bounds, found.name) == (PLACE, "image.tif")
    assert_quarters(colours_of(found.jpeg))


def test_grey_of_16_bits_and_a_palette_become_colours(tmp_path: Path) -> None:
    ramp = np.tile(np.linspace(1000, 60000, 240).astype(np.uint16), (1, 180, 1))
    seen = colours_of(
        read_basemap(write_image(tmp_path / "a.tif", ramp, PLACE, "EPSG:28992"), DUTCH, PLACE).jpeg
    )
    assert seen[0, 90, 5] < 15 and seen[0, 90, -5] > 240 and np.ptp(seen[:, 90, 100].astype(int)) < 4
    numbers = np.arange(4, dtype=np.uint8).reshape(2, 2).repeat(90, axis=0).repeat(120, axis=1)[None]
    table = {number: (*QUARTERS.reshape(4, 3)[number].tolist(), 255) for number in range(4)}
    path = write_image(tmp_path / "b.tif", numbers, PLACE, "EPSG:28992", colormap=table)
    assert_quarters(colours_of(read_basemap(path, DUTCH, PLACE).jpeg))


def test_beyond_its_rim_is_grey(tmp_path: Path) -> None:
    half = Bounds(PLACE.west, PLACE.south, PLACE.west + 120, PLACE.north)
    path = write_image(tmp_path / "half.tif", quarters(180, 120), half, "EPSG:28992")
    seen = colours_of(read_basemap(path, DUTCH, PLACE).jpeg)
    assert np.abs(seen[:, :, -20:].astype(int) - BEYOND).max() < 12
    assert np.ptp(seen[:, 40, 30].astype(int)) > 50


def test_it_is_made_coarser_until_it_is_small_enough(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(basemap, "BYTES", 40_000)
    noise = np.random.default_rng(1).integers(0, 255, (3, 450, 600), np.uint8)
    found = read_basemap(write_image(tmp_path / "n.tif", noise, PLACE, "EPSG:28992"), DUTCH, PLACE)
    assert 20_000 < len(found.jpeg) <= 40_000 and 100 < found.width < 600


def test_what_cannot_be_laid_is_one_line(tmp_path: Path) -> None:
    plain = write_image(tmp_path / "plain.tif", quarters(), PLACE, None)
    with pytest.raises(ValueError, match="has no reference system; give it one"):
        read_basemap(plain, DUTCH, PLACE)
    away = write_image(tmp_path / "away.tif", quarters(), Bounds(0, 0, 240, 180), "EPSG:32633")
    with pytest.raises(ValueError, match="shows nothing of the run"):
        read_basemap(away, DUTCH, PLACE)
    with pytest.raises(ValueError, match="the run has no reference system"):
        read_basemap(away, LOCAL_METRES, PLACE)
    (tmp_path / "words.tif").write_text("no image")
    with pytest.raises(ValueError, match="is not an image"):
        read_basemap(tmp_path / "words.tif", DUTCH, PLACE)


def test_places_on_web_mercator_are_those_of_proj__over_six_kilometres() -> None:
    xy = np.random.default_rng(5).uniform(-3000.0, 3000.0, (200, 2))
    x, y = xy.T
    terms = np.array([np.ones(200), x, y, x * x, x * y, y * y])
    fitted = fit_web_mercator(DUTCH, (85000.0, 447200.0), 3000.0)
    assert fitted is not None
    move = pyproj.Transformer.from_crs("EPSG:28992", "EPSG:3857", always_xy=True).transform
    east, north = move(*(xy + [85000.0, 447200.0]).T)
    around = 2 * np.pi * WORLD_RADIUS
    assert np.allclose(np.array(fitted) @ terms * around, [east + around / 2, around / 2 - north], atol=0.01)
    assert fit_web_mercator(LOCAL_METRES, (0.0, 0.0), 100.0) is None
