"""LAS, LAZ and COPC files that others wrote come back point by point, and are written back."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pyproj
import pytest
from copc_writer import write_copc
from laspy.copc import Bounds as CopcBounds
from laspy.copc import load_octree_for_query

from eaves.exports import copc as copc_writer
from eaves.formats import Chunk, Source, iter_chunks, open_source, read, write_classified
from eaves.formats.crs import parse_crs, system_of
from eaves.formats.points.las import iter_records
from eaves.model import Bounds

COUNT = 3000
WITHHELD = np.arange(0, COUNT, 7)
KINDS = ["las-0", "las-1", "las-3", "las-6", "laz-1", "laz-3", "laz-6", "laz-7", "copc"]


def survey(point_format: int = 6, count: int = COUNT, epsg: int | None = 28992) -> laspy.LasData:
    """Points with classes, returns, an extra dimension and every seventh one withheld."""
    version = "1.4" if point_format >= 6 else "1.2"
    header = laspy.LasHeader(version=version, point_format=point_format)
    header.scales, header.offsets = np.full(3, 0.01), np.array([84000.0, 447000.0, 0.0])
    header.add_extra_dim(laspy.ExtraBytesParams("amplitude", "u2"))
    if epsg is not None and point_format >= 6:
        header.add_crs(pyproj.CRS.from_epsg(epsg))
    rng = np.random.default_rng(11)
    las = laspy.LasData(header)
    las.x, las.y, las.z = (rng.random((count, 3)) * [200, 100, 20] + [84900, 447100, 0]).T
    las.number_of_returns = rng.integers(1, 5, count)
    las.return_number = np.minimum(rng.integers(1, 5, count), np.asarray(las.number_of_returns))
    las.classification = rng.integers(1, 20, count)
    las.intensity = rng.integers(0, 60000, count)
    las.amplitude = np.arange(count).astype(np.uint16)
    las.withheld = (np.arange(count) % 7 == 0).astype(np.uint8)
    return las


def written(folder: Path, kind: str) -> tuple[Path, laspy.LasData]:
    """A file of one kind and its points in the order of the file."""
    name, _, number = kind.partition("-")
    las = survey(int(number or 6))
    path = folder / ("survey.copc.laz" if name == "copc" else f"survey.{name}")
    if name == "copc":
        order = write_copc(path, las)
        return path, laspy.LasData(las.header, las.points[order])
    las.write(path)
    return path, las


def joined(source: Source, bounds: Bounds | None = None, size: int = 10**6) -> Chunk:
    chunks = list(iter_chunks(source, bounds, size))
    names = ("xyz", "position", "return_number", "number_of_returns", "classification", "withheld")
    return Chunk(*(np.concatenate([getattr(chunk, name) for chunk in chunks]) for name in names))


@pytest.mark.parametrize("kind", KINDS)
def test_points_come_back_in_order_without_the_withheld(tmp_path: Path, kind: str) -> None:
    path, las = written(tmp_path, kind)
    source = open_source(path)
    assert (source.kind, source.count) == (kind.partition("-")[0], COUNT)
    found, used = joined(source), np.flatnonzero(np.asarray(las.withheld) == 0)
    assert len(used) < COUNT and np.array_equal(found.position, used)
    assert np.allclose(found.xyz, np.asarray(las.xyz)[used], atol=1e-9)
    for name in ("return_number", "number_of_returns", "classification"):
        assert np.array_equal(getattr(found, name), np.asarray(las[name])[used])
    world = np.asarray(las.xyz)
    assert np.allclose(
        [source.bounds.west, source.bounds.north], [world[:, 0].min(), world[:, 1].max()], atol=1e-9
    )


@pytest.mark.parametrize("kind", KINDS)
def test_many_chunks_give_what_one_gives(tmp_path: Path, kind: str) -> None:
    source = open_source(written(tmp_path, kind)[0])
    one, many = joined(source), joined(source, size=170)
    assert np.array_equal(one.xyz, many.xyz) and np.array_equal(one.position, many.position)


@pytest.mark.parametrize("kind", ["las-1", "laz-6", "copc"])
def test_bounds_give_the_points_inside(tmp_path: Path, kind: str) -> None:
    source = open_source(written(tmp_path, kind)[0])
    whole, bounds = joined(source), Bounds(84910.0, 447105.0, 84935.0, 447120.0)
    inside = bounds.contains(whole.xyz)
    part = joined(source, bounds, 170)
    assert 0 < inside.sum() < len(inside) / 4
    assert np.array_equal(part.position, whole.position[inside])
    assert np.array_equal(part.xyz, whole.xyz[inside])
    assert not list(iter_chunks(source, bounds.translated(1e5, 0)))


def test_laspy_opens_the_copc_file_of_the_tests(tmp_path: Path) -> None:
    path, las = written(tmp_path, "copc")
    with laspy.CopcReader.open(path) as reader:
        points = reader.query()
    assert len(points) == COUNT
    assert sorted(np.asarray(points["amplitude"])) == sorted(np.asarray(las.amplitude))


def test_of_copc_only_the_nodes_needed_are_read(tmp_path: Path) -> None:
    source = open_source(written(tmp_path, "copc")[0])
    corner = (84900.0, 447100.0, 84910.0, 447110.0)
    touched = sum(len(position) for position, _ in iter_records(source.layout, 10**6, corner))
    assert 0 < touched < COUNT / 2


@pytest.mark.parametrize("kind", KINDS)
def test_classes_are_written_back_into_the_same_records(tmp_path: Path, kind: str) -> None:
    path, las = written(tmp_path, kind)
    classes = np.where(np.arange(COUNT) % 3 == 0, 255, 6).astype(np.uint8)
    ids = np.arange(COUNT, dtype=np.uint32)
    out = tmp_path / "out" / "classified.laz"
    write_classified(open_source(path), out, classes, {"building_id": ids}, chunk_points=170)
    back = laspy.read(out)
    assert np.array_equal(back.X, las.X) and np.array_equal(back.Z, las.Z)
    for name in ("intensity", "return_number", "number_of_returns", "withheld", "amplitude"):
        assert np.array_equal(back[name], las[name]), name
    assert np.array_equal(back.building_id, ids)
    kept = (np.asarray(las.withheld) != 0) | (classes == 255)
    assert np.array_equal(np.asarray(back.classification), np.where(kept, las.classification, 6))
    assert open_source(out).kind == "laz"
    assert open_source(out).system == open_source(path).system


def test_the_same_dimension_twice_is_replaced(tmp_path: Path) -> None:
    path, _ = written(tmp_path, "laz-6")
    classes = np.full(COUNT, 255, np.uint8)
    for step, name in enumerate(("one.laz", "two.laz"), 1):
        write_classified(
            open_source(path), tmp_path / name, classes, {"part": np.full(COUNT, step, np.uint8)}
        )
        path = tmp_path / name
    back = laspy.read(path)
    assert set(back.part) == {2} and list(back.point_format.extra_dimension_names) == ["amplitude", "part"]


def test_a_dimension_of_pairs_gives_way_to_numbers_of_the_same_name(tmp_path: Path) -> None:
    las = survey()
    las.add_extra_dim(laspy.ExtraBytesParams("part", "2u1"))
    las.part = np.ones((COUNT, 2), np.uint8)
    las.write(tmp_path / "a.laz")
    part = (np.arange(COUNT) % 5).astype(np.uint8)
    write_classified(
        open_source(tmp_path / "a.laz"), tmp_path / "b.laz", np.full(COUNT, 2, np.uint8), {"part": part}
    )
    assert np.array_equal(laspy.read(tmp_path / "b.laz").part, part)


def test_writing_twice_gives_the_same_bytes(tmp_path: Path) -> None:
    source = open_source(written(tmp_path, "copc")[0])
    for name in ("a.laz", "b.laz"):
        write_classified(source, tmp_path / name, np.full(COUNT, 2, np.uint8))
    assert (tmp_path / "a.laz").read_bytes() == (tmp_path / "b.laz").read_bytes()


@pytest.mark.parametrize("kind", KINDS)
def test_copied_records_give_the_same_bytes(tmp_path: Path, kind: str) -> None:
    source = open_source(written(tmp_path, kind)[0])
    copies = [tmp_path / "0.bin", tmp_path / "1.bin"]
    for k, path in enumerate(copies):
        with path.open("wb") as copy:
            assert sum(map(len, iter_chunks(source, part=(k, 2), copy=copy))) <= COUNT
    for name, given in (("a.laz", ()), ("b.laz", copies), ("c.laz", copies[:1])):
        write_classified(source, tmp_path / name, np.full(COUNT, 2, np.uint8), copies=given)
    whole = (tmp_path / "a.laz").read_bytes()
    assert whole == (tmp_path / "b.laz").read_bytes() == (tmp_path / "c.laz").read_bytes()


def test_a_wrong_number_of_classes_is_refused(tmp_path: Path) -> None:
    source = open_source(written(tmp_path, "las-1")[0])
    with pytest.raises(ValueError, match="classification has 5 values"):
        write_classified(source, tmp_path / "out.laz", np.zeros(5, np.uint8))
    assert not (tmp_path / "out.laz").exists()


@pytest.mark.parametrize("suffix", ["las", "laz"])
@pytest.mark.parametrize("count", [0, 1, 2])
def test_tiny_files_are_read_and_written(tmp_path: Path, count: int, suffix: str) -> None:
    path = tmp_path / f"tiny.{suffix}"
    las = survey(6, count)
    las.withheld = np.zeros(count, np.uint8)
    las.write(path)
    source = open_source(path)
    assert source.count == count and sum(map(len, iter_chunks(source))) == count
    write_classified(source, tmp_path / "out.laz", np.zeros(count, np.uint8))
    assert len(laspy.read(tmp_path / "out.laz").points) == count


def test_several_files_become_one_cloud(tmp_path: Path) -> None:
    survey().write(tmp_path / "a.laz")
    survey().write(tmp_path / "b.las")
    cloud = read(tmp_path)
    once = COUNT - len(WITHHELD)
    assert len(cloud) == 2 * once and cloud.system.code == "EPSG:28992"
    assert np.array_equal(cloud.point_id[once:], cloud.point_id[:once] + COUNT)


def rows(points: laspy.PackedPointRecord, names: list[str]) -> np.ndarray:
    """The values of points, in an order that follows from the values."""
    values = np.column_stack([np.asarray(points[name], float) for name in names])
    return values[np.lexsort(values.T)]


def check_copc(path: Path, made: Path) -> None:
    """That a COPC file has every value of another file, in nodes that hold their points."""
    las, rng = laspy.read(path), np.random.default_rng(2)
    assert made.read_bytes()[375:384] == b"\0\0copc\0\0\0"
    with laspy.CopcReader.open(made) as reader:
        found, header = reader.query(), reader.header
        names = sorted({*las.point_format.dimension_names} & {*found.point_format.dimension_names})
        np.testing.assert_array_equal(rows(found, names), rows(las.points, names))
        nodes = load_octree_for_query(reader.source, reader.copc_info, reader.root_page)
        assert sum(node.point_count for node in nodes) == len(las) == open_source(made).count
        assert max(node.point_count for node in nodes) <= copc_writer.NODE_POINTS
        for node in nodes:
            xyz = reader._fetch_and_decompress_points_of_nodes([node])
            xyz = np.column_stack([xyz.x, xyz.y, xyz.z])
            assert (xyz >= node.bounds.mins - 1e-6).all() and (xyz <= node.bounds.maxs + 1e-6).all()
        for share in (0.5, 0.1):
            low = header.mins[:2] + rng.random(2) * (header.maxs - header.mins)[:2] * (1 - share)
            high = low + (header.maxs - header.mins)[:2] * share
            steps = np.round((np.array([low, high]) - header.offsets[:2]) / header.scales[:2])
            xy = np.column_stack([las.X, las.Y])
            inside = ((xy >= steps[0]) & (xy <= steps[1])).all(axis=1)
            assert inside.sum() == len(reader.query(CopcBounds(low, high)))
            touched = sum(len(one) for one, _ in iter_records(open_source(made).layout, 10**6, (*low, *high)))
            assert inside.sum() <= touched <= len(las)
    assert len(nodes) == 1 or touched < len(las)


@pytest.mark.parametrize(("form", "count", "new"), [(3, 60_000, 7), (1, 1, 6), (8, COUNT, 8)])
def test_copc_has_every_value_of_the_points(tmp_path: Path, form: int, count: int, new: int) -> None:
    las, path, made = survey(form, count), tmp_path / "classified.laz", tmp_path / "classified.copc.laz"
    las.gps_time = np.sort(np.random.default_rng(1).random(count))
    las["scan_angle_rank" if form < 6 else "scan_angle"] = np.arange(count) % 41 - 20
    if form == 3:
        las.header.add_crs(pyproj.CRS.from_epsg(28992))
    las.write(path)
    dutch = system_of(parse_crs("EPSG:28992"), path, (84960.0, 447120.0))
    assert copc_writer.write_copc(path, made, dutch) == count
    check_copc(path, made)
    back = laspy.read(made)
    assert (back.header.point_format.id, str(back.header.version)) == (new, "1.4")
    assert (open_source(made).kind, open_source(made).system.code) == ("copc", "EPSG:28992")
    order = np.argsort(back.gps_time)
    angle = np.asarray(back.scan_angle, float)[order] * (0.006 if form < 6 else 1)
    np.testing.assert_allclose(angle, np.arange(count) % 41 - 20, atol=0.003)
    before = made.read_bytes()
    copc_writer.write_copc(path, made, dutch)
    assert made.read_bytes() == before


def test_without_points_there_is_no_copc(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    survey(6, 0).write(tmp_path / "a.laz")
    assert copc_writer.write_copc(tmp_path / "a.laz", tmp_path / "a.copc.laz") == 0
    assert "has no points" in caplog.text and [path.name for path in tmp_path.iterdir()] == ["a.laz"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["delft/ahn3.laz", "kleve/kleve.laz"])
def test_copc_of_a_survey_is_the_survey(data: Path, tmp_path: Path, name: str) -> None:
    copc_writer.write_copc(data / name, tmp_path / "a.copc.laz")
    check_copc(data / name, tmp_path / "a.copc.laz")
