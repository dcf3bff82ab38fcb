"""A DSM in place of points: cells are points, with a DTM those at its height are the ground."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyogrio
import pytest
import rasterio
import shapely
from tests.cli.test_commands import eaves as run
from tests.conftest import build_files

import eaves
from eaves.formats import InputError, read, write_raster
from eaves.formats.crs import parse_crs, system_of
from eaves.formats.points import raster_cells
from eaves.formats.points.converted import remarks_on as raster_remarks
from eaves.formats.points.remote import localise
from eaves.model import CoordinateSystem, Raster
from eaves.simulate import nine_roofs_on_a_slope
from eaves.simulate.objects.exact import ExactScene

PLACE = (84960.0, 447120.0)


def system(code: str, place: tuple[float, float] = PLACE) -> CoordinateSystem:
    return system_of(parse_crs(code), "test", place)


def write_heights(path: Path, values: np.ndarray, cell: float = 0.5) -> Path:
    """A raster whose south-west corner is `PLACE`."""
    raster = Raster(values.astype(np.float32), PLACE[0], PLACE[1] + cell * values.shape[0], cell)
    write_raster(path, raster, system("EPSG:28992+5709"))
    return path


def points_of(path: Path, folder: Path, dtm: Path | None = None) -> eaves.PointCloud:
    [local], _ = localise(path, folder, dtm=dtm)
    return read(local)


def test_each_cell_with_a_height_is_a_point_in_its_middle(tmp_path: Path) -> None:
    values = np.arange(12.0).reshape(3, 4)
    values[1, 2] = np.nan
    cloud = points_of(write_heights(tmp_path / "dsm.tif", values), tmp_path)
    row, column = np.nonzero(np.isfinite(values))
    expected = [PLACE[0] + 0.5 * (column + 0.5), PLACE[1] + 0.5 * (3 - row - 0.5), values[row, column]]
    assert np.allclose(cloud.xyz + [*cloud.origin, 0.0], np.column_stack(expected), atol=1e-3)
    assert cloud.system.code == system("EPSG:28992+5709").code
    assert not cloud.has_returns


def test_cells_in_feet_lie_where_the_raster_does(tmp_path: Path) -> None:
    raster = Raster(np.full((4, 6), 30.0, np.float32), 0.3048 * 636000.0, 0.3048 * 849000.0, 0.9144)
    write_raster(tmp_path / "dsm.tif", raster, system("EPSG:2994", (636000.0, 849000.0)))
    cloud = points_of(tmp_path / "dsm.tif", tmp_path)
    assert np.allclose(cloud.xyz[:, 2], 30.0, atol=1e-3)
    low, high = (end + [*cloud.origin, 0.0] for end in (cloud.xyz.min(axis=0), cloud.xyz.max(axis=0)))
    inner = raster.bounds.buffered(-0.4572)
    assert np.allclose([*low[:2], *high[:2]], list(vars(inner).values()), atol=2e-3)


def test_with_a_terrain_of_other_cells_those_at_its_height_are_ground(tmp_path: Path) -> None:
    surface = np.tile(0.1 * np.arange(0.25, 40.0, 0.5), (80, 1))
    high = np.zeros((80, 80), bool)
    high[20:50, 20:50] = True
    dsm = write_heights(tmp_path / "dsm.tif", surface + 6.0 * high)
    dtm = write_heights(tmp_path / "dtm.tif", np.tile(0.1 * np.arange(1.0, 40.0, 2.0), (20, 1)), 2.0)
    cloud = points_of(dsm, tmp_path, dtm)
    assert cloud.classification is not None
    assert np.array_equal(cloud.classification == 2, ~high.ravel())


def stored(path: Path, values: np.ndarray, scale: float = 1.0, offset: float = 0.0, unit: str = "") -> Path:
    """A raster of values as stored, with what its band states."""
    with rasterio.open(
        path, "w", driver="GTiff", width=values.shape[1], height=values.shape[0], count=1, dtype=values.dtype,
        crs="EPSG:28992", transform=rasterio.Affine(0.5, 0, *PLACE[:1], 0, -0.5, PLACE[1] + 30),
    ) as image:  # fmt: skip
        image.write(values, 1)
        image.scales, image.offsets = [scale], [offset]
        if unit:
            image.units = [unit]
    return path


SLOPE = np.add.outer(np.arange(40.0), np.arange(40.0))
"""Heights (m) of a slope from 0 to 78."""


@pytest.mark.parametrize(
    ("kind", "scale", "offset", "unit", "metres"),
    [("int16", 0.01, 0.0, "", 1.0), ("uint16", 0.1, -50.0, "", 1.0), ("float32", 1.0, 0.0, "ft", 0.3048)],
)
def test_heights_come_by_scale_offset_and_unit_of_the_band(
    kind: str, scale: float, offset: float, unit: str, metres: float, tmp_path: Path
) -> None:
    values = np.round((SLOPE - offset) / scale).astype(kind)
    cloud = points_of(stored(tmp_path / "dsm.tif", values, scale, offset, unit), tmp_path)
    assert np.allclose(np.sort(cloud.xyz[:, 2]), np.sort(SLOPE.ravel()) * metres, atol=2e-3)


@pytest.mark.parametrize(
    ("value", "kind"), [(-9999, "float32"), (-3.4028235e38, "float32"), (-32768, "int16")]
)
def test_an_undeclared_value_is_left_out_and_named(value: float, kind: str, tmp_path: Path) -> None:
    values = SLOPE.astype(kind)
    values[-3:, :3] = value
    [local], _ = localise(stored(tmp_path / "dsm.tif", values), tmp_path)
    assert len(read(local)) == values.size - 9
    [remark] = raster_remarks(local)
    assert f"9 cells hold the value {value:g}" in remark
    assert len(read(localise(tmp_path / "dsm.tif", tmp_path)[0][0])) == values.size - 9  # as kept


def test_a_value_around_the_data_is_left_out__level_ground_around_a_house_is_not(tmp_path: Path) -> None:
    framed = np.pad(SLOPE + 20, 10).astype(np.float32)
    [local], _ = localise(stored(tmp_path / "framed.tif", framed), tmp_path)
    assert len(read(local)) == SLOPE.size and "value 0," in raster_remarks(local)[0]
    level = np.full((60, 60), 10.0, np.float32)
    level[25:35, 25:40] = 16.0
    [local], _ = localise(stored(tmp_path / "level.tif", level), tmp_path)
    assert len(read(local)) == level.size and raster_remarks(local) == []


@pytest.mark.slow
def test_a_raster_larger_than_a_piece_is_read_whole(tmp_path: Path) -> None:
    rows = raster_cells.PIECE // 1000 * 2 + 3
    values = np.arange(rows * 1000.0).reshape(rows, 1000) / 1000.0
    cloud = points_of(write_heights(tmp_path / "dsm.tif", values), tmp_path)
    assert len(cloud) == values.size
    assert np.allclose(cloud.xyz[:, 2], values.ravel(), atol=2e-3)


@pytest.fixture(scope="module")
def dense() -> ExactScene:
    return nine_roofs_on_a_slope(density=30.0, noise=0.02, seed=3)


@pytest.mark.parametrize("with_dtm", [False, True])
def test_the_nine_roofs_are_found_in_their_dsm(with_dtm: bool, dense: ExactScene, tmp_path: Path) -> None:
    cloud = dense.classified()
    write_raster(tmp_path / "dsm.tif", eaves.make_dsm(cloud, cloud.bounds, cell=0.5), origin=cloud.origin)
    write_raster(tmp_path / "dtm.tif", eaves.make_dtm(cloud, cloud.bounds), origin=cloud.origin)
    dtm = tmp_path / "dtm.tif" if with_dtm else None
    summary = build_files(tmp_path / "dsm.tif", tmp_path / "out", dtm=dtm)
    assert (summary.found, summary.modelled, summary.trust.get("high", 0)) == (9, 9, 0)
    assert any("as from image matching" in words for words in summary.run["scan"]["remarks"])
    _, _, wkb, fields = pyogrio.raw.read(
        tmp_path / "out" / "footprints.gpkg", layer="footprints", columns=["h_ridge", "review_reason"]
    )
    assert all("its points are cells of a raster" in reason for reason in fields[1])
    outlines = shapely.transform(shapely.from_wkb(wkb), lambda xy: xy - cloud.origin)
    for building in dense.buildings:
        shared = shapely.intersection(building.footprint, outlines)
        iou = shapely.area(shared) / shapely.area(shapely.union(building.footprint, outlines))
        tops = [face.height_at(shapely.get_coordinates(face.polygon)).max() for face in building.faces]
        assert iou.max() > 0.9
        if len(building.faces) != 3:  # the gable's chimney, two cells wide, is taken for the ridge
            assert abs(fields[0][iou.argmax()] - max(tops)) < 0.25


def write_bad_files(folder: Path) -> None:
    place = rasterio.Affine(1.0, 0.0, 0.0, 0.0, -1.0, 4.0)
    profile = {"driver": "GTiff", "width": 4, "height": 4, "count": 3, "dtype": "uint8"}
    with rasterio.open(folder / "image.tif", "w", transform=place, **profile) as image:
        image.write(np.zeros((3, 4, 4), np.uint8))
    (folder / "text.tif").write_text("1 2 3\n")
    band = '<VRTRasterBand dataType="Float32" band="1"/>'
    (folder / "list.tif").write_text(f'<VRTDataset rasterXSize="4" rasterYSize="4">{band}</VRTDataset>')
    write_heights(folder / "empty.tif", np.full((4, 4), np.nan))
    whole = write_heights(folder / "whole.tif", np.random.default_rng(0).random((300, 300))).read_bytes()
    (folder / "cut.tif").write_bytes(whole[: len(whole) // 2])


REFUSED = {
    "image": "image.tif: has 3 bands, no heights alone; give a DSM of one band",
    "list": "list.tif: is not a raster that can be read; give a GeoTIFF",
    "text": "text.tif: is not a raster that can be read; give a GeoTIFF",
    "empty": "empty.tif: has no cell with a height; check its band",
    "cut": "cut.tif: is damaged; copy or download it again",
    "none": r"none.tif: cannot be read \(No such file",
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_raster_of_heights_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    write_bad_files(tmp_path)
    with pytest.raises(InputError, match=REFUSED[name]) as refusal:
        localise(tmp_path / f"{name}.tif", tmp_path)
    assert "\n" not in str(refusal.value)


def test_a_terrain_without_a_raster_is_refused(nine_roofs_file: Path, tmp_path: Path) -> None:
    done = run("build", nine_roofs_file, "-o", tmp_path / "out", "--dtm", "dtm.tif")
    assert done.returncode == 2
    assert "--dtm dtm.tif: no input is a raster; give a DSM (.tif), or leave it out" in done.stderr
