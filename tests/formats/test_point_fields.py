"""All that the points carry: read on request, kept through blocks beside the right point, given back."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import laspy
import numpy as np
import pytest
from tests.conftest import build_files, build_in_blocks
from tests.formats.copc_writer import write_copc

import eaves
from eaves.detect import Detector
from eaves.flow.run import open_run
from eaves.formats import InputError
from eaves.methods import ignore
from eaves.model import Regions
from eaves.simulate import coloured, write_simulation
from eaves.simulate.objects.exact import ExactScene

COUNT = 3000
PLAIN = ("intensity", "point_source_id")
TIMED, RGB = ("gps_time",), ("red", "green", "blue")
FORMATS = {
    0: PLAIN,
    1: (*PLAIN, *TIMED),
    2: (*PLAIN, *RGB),
    3: (*PLAIN, *TIMED, *RGB),
    6: (*PLAIN, *TIMED),
    7: (*PLAIN, *TIMED, *RGB),
    8: (*PLAIN, *TIMED, *RGB, "nir"),
}
"""Point format → its fields (LAS 1.4, tables 7 to 19)."""


def write_fields(path: Path, point_format: int, **header_options: Any) -> laspy.LasData:
    """A file of random points with random fields, an extra dimension in whole steps of 0.01 among them."""
    rng = np.random.default_rng(point_format)
    header = laspy.LasHeader(version="1.4" if point_format > 5 else "1.2", point_format=point_format)
    header.scales = np.full(3, 0.001)
    scaled = laspy.ExtraBytesParams("width", "int32", scales=np.array([0.01]), offsets=np.array([5.0]))
    header.add_extra_dims([scaled, laspy.ExtraBytesParams("entropy", "float32")])
    las = laspy.LasData(header)
    las.x, las.y, las.z = rng.uniform(0.0, 100.0, (3, COUNT))
    for name in FORMATS[point_format]:
        las[name] = rng.integers(0, 65535, COUNT)
    angle = rng.integers(-60, 60, COUNT)
    las["scan_angle" if point_format > 5 else "scan_angle_rank"] = angle
    las.entropy, las.width = rng.random(COUNT), rng.integers(0, 999, COUNT) / 100.0
    las.write(path)
    return las


@pytest.mark.parametrize("suffix", ["las", "laz"])
@pytest.mark.parametrize("point_format", FORMATS)
def test_every_field_of_a_format_is_that_of_the_file(point_format: int, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"points.{suffix}"
    las = write_fields(path, point_format)
    names = (*FORMATS[point_format], "scan_angle", "entropy", "width")
    cloud = eaves.read(path, fields=names)
    for name in FORMATS[point_format] + ("entropy", "width"):
        assert np.array_equal(cloud.fields[name], np.asarray(las[name], np.float64)), name
    degrees = np.asarray(las.scan_angle) * 0.006 if point_format > 5 else np.asarray(las.scan_angle_rank)
    assert np.allclose(cloud.fields["scan_angle"], degrees)


def test_fields_of_a_part_of_a_copc_file_are_those_of_its_points(tmp_path: Path) -> None:
    xyz = np.round(np.random.default_rng(2).uniform(0.0, 200.0, (20_000, 3)), 3)
    las = laspy.LasData(laspy.LasHeader(version="1.4", point_format=6))
    las.header.scales = np.full(3, 0.001)
    las.x, las.y, las.z = xyz.T
    las.intensity = np.round(xyz[:, 0]).astype(np.uint16)
    path = tmp_path / "points.copc.laz"
    write_copc(path, las)
    cloud = eaves.read(path, bounds=eaves.Bounds(50.0, 50.0, 90.0, 70.0), fields=("intensity",))
    assert 0 < len(cloud) < len(xyz)
    assert np.array_equal(cloud.fields["intensity"], np.round(cloud.xyz[:, 0] + cloud.origin[0]))


def test_nothing_is_read_that_is_not_asked_for(tmp_path: Path) -> None:
    write_fields(tmp_path / "points.laz", 8)
    assert eaves.read(tmp_path / "points.laz").fields == {}


def test_a_field_that_a_file_lacks_is_refused_in_one_line(tmp_path: Path) -> None:
    write_fields(tmp_path / "points.laz", 1)
    words = r"points.laz: its points have no field 'nir', but intensity, .*width.*; give files that have it"
    with pytest.raises(InputError, match=words):
        eaves.read(tmp_path / "points.laz", fields=("nir",))
    (tmp_path / "points.xyz").write_text("1 2 3\n2 3 4\n")
    with pytest.raises(InputError, match="no field 'nir', but coordinates alone"):
        eaves.read(tmp_path / "points.xyz", fields=("nir",))


class Tagged(Detector):
    """High points, of a scan in which every point bears its place."""

    name: ClassVar[str] = "tagged"
    needs: ClassVar[tuple[str, ...]] = ("tag", "nir")

    def label(self, scene: Any, emit: Any = ignore) -> Any:
        cloud = scene.cloud
        east, north = (cloud.xyz[:, axis] + cloud.origin[axis] for axis in (0, 1))
        assert np.allclose(cloud.fields["tag"], east - 3.0 * north, atol=2e-3)
        assert np.array_equal(cloud.fields["nir"], np.round(cloud.xyz[:, 2] * 100.0))
        return Regions((scene.height > 2.0).astype(np.int32))


def write_tagged(path: Path, scene: ExactScene, part: slice) -> Path:
    """A part of a scene's points, each with what its place says."""
    header = laspy.LasHeader(version="1.4", point_format=8)
    header.scales = np.full(3, 0.001)
    header.add_extra_dims([laspy.ExtraBytesParams("tag", "float64")])
    las = laspy.LasData(header)
    world = np.round(scene.cloud.xyz[part] + [*scene.cloud.origin, 0.0], 2)
    las.x, las.y, las.z = world.T
    las.tag, las.nir = world[:, 0] - 3.0 * world[:, 1], np.round(world[:, 2] * 100.0)
    las.return_number = las.number_of_returns = np.ones(len(world), np.uint8)
    las.write(path)
    return path


@pytest.mark.slow
def test_fields_stay_with_their_points_through_blocks_files_and_processes(
    nine_roofs: ExactScene, tmp_path: Path
) -> None:
    files = [write_tagged(tmp_path / f"{k}.laz", nine_roofs, slice(k, None, 2)) for k in (0, 1)]
    summary = build_in_blocks(60.0, files, tmp_path / "out", detect=Tagged(), lod="0", jobs=2)
    assert summary.complete and summary.found > 0
    again = build_files(files, tmp_path / "one", detect=Tagged(), lod="0", per_tile=True)
    assert again.complete and again.found > 0
    for k in (0, 1):
        before, after = laspy.read(files[k]), laspy.read(tmp_path / "out" / f"classified_{k}.laz")
        assert np.array_equal(before.nir, after.nir) and np.array_equal(before.tag, after.tag)


def test_a_run_whose_files_lack_a_field_is_refused_before_it_reads(
    nine_roofs: ExactScene, nine_roofs_file: Path, tmp_path: Path
) -> None:
    files = [write_tagged(tmp_path / "0.laz", nine_roofs, slice(None)), nine_roofs_file]
    with pytest.raises(InputError, match=r"nine.laz: its points have no field 'nir'"):
        open_run(files, tmp_path / "out", detect=Tagged(), crs="EPSG:28992", crs_force=True)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_points_read_without_fields_are_read_again_with_them(nine_roofs: ExactScene, tmp_path: Path) -> None:
    path = write_tagged(tmp_path / "0.laz", nine_roofs, slice(None))
    build_files(path, tmp_path / "out", lod="0", keep=True)
    summary = build_files(
        path, tmp_path / "out", detect=Tagged(), lod="0", keep=True, resume=True, overwrite=True
    )
    assert summary.complete and summary.found > 0


def test_a_coloured_scene_is_written_with_its_colours(nine_roofs: ExactScene, tmp_path: Path) -> None:
    scene = coloured(nine_roofs, 3)
    path = write_simulation(scene, tmp_path)["points"]
    cloud = eaves.read(path, fields=("red", "green", "blue", "nir", "intensity"))
    for name, values in scene.cloud.fields.items():
        assert np.array_equal(cloud.fields[name], values), name
    assert np.array_equal(coloured(nine_roofs, 3).cloud.fields["red"], scene.cloud.fields["red"])
