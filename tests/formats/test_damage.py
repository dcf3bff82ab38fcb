"""Cut, lying and mutated files give an InputError of one line that names them, or points; nothing else."""

from __future__ import annotations

import resource
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import laspy
import numpy as np
import pytest
from copc_writer import write_copc
from test_point_files import survey
from tests.conftest import but_first

from eaves.formats import InputError, iter_chunks, open_source, write_classified
from eaves.model import Bounds

COUNT = 400
MUTATIONS = 300
SECONDS = 2.0
"""Processor time a file of a few hundred points may take, however slow the machine."""
ROOM_BYTES = 1 << 30
"""What the address space may grow by while a small damaged file is read."""
CORNER = Bounds(84900.0, 447100.0, 84930.0, 447130.0)
KINDS = ["las", "laz", "copc"]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("whole")
    survey(1, COUNT).write(folder / "a.las")
    survey(6, COUNT).write(folder / "a.laz")
    write_copc(folder / "a.copc", survey(6, COUNT), levels=2)
    return {path.suffix[1:]: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def bounded() -> Iterator[None]:
    """An address space that may grow by ROOM_BYTES and no more."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + ROOM_BYTES, hard))
    yield
    resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def outcome(path: Path, data: bytes) -> int | None:
    """How many points the bytes give, or None for an InputError; anything else fails the test."""
    path.write_bytes(data)
    started = time.process_time()
    try:
        source = open_source(path)
        count = sum(map(len, iter_chunks(source)))
        for _ in iter_chunks(source, CORNER):
            pass
    except InputError as error:
        assert str(path) in str(error) and "\n" not in str(error)
        return None
    finally:
        assert time.process_time() - started < SECONDS
    return count


def patched(data: bytes, form: str, place: int, value: float) -> bytes:
    copy = bytearray(data)
    struct.pack_into(form, copy, place, value)
    return bytes(copy)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.usefixtures("bounded")
def test_a_file_cut_anywhere_is_refused(tmp_path: Path, files: dict[str, bytes], kind: str) -> None:
    data = files[kind]
    assert outcome(tmp_path / "a.laz", data) == COUNT - len(range(0, COUNT, 7))
    for end in range(0, len(data), 64):
        assert outcome(tmp_path / "a.laz", data[:end]) is None, f"{end} of {len(data)} bytes"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("what", "form", "place", "values"),
    [
        ("header size", "<H", 94, (0, 100, 60000)),
        ("offset to points", "<I", 96, (0, 1, 2**31, 2**32 - 1)),
        ("number of records", "<I", 100, (9999, 10_001, 2**32 - 1)),
        ("point format", "<B", 104, (11, 63, 127, 255)),
        ("record length", "<H", 105, (0, 1, 19, 27, 65535)),
        ("scale", "<d", 131, (0.0, float("nan"), float("inf"))),
        ("offset", "<d", 155, (float("nan"), float("-inf"))),
    ],
)
@pytest.mark.usefixtures("bounded")
def test_a_wrong_header_is_refused(
    tmp_path: Path,
    files: dict[str, bytes],
    kind: str,
    what: str,
    form: str,
    place: int,
    values: tuple[float, ...],
) -> None:
    for value in values:
        assert outcome(tmp_path / "a.laz", patched(files[kind], form, place, value)) is None, (what, value)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.usefixtures("bounded")
def test_a_wrong_point_count_is_refused(tmp_path: Path, files: dict[str, bytes], kind: str) -> None:
    form, place = ("<I", 107) if kind == "las" else ("<Q", 247)
    largest = 2**32 - 1 if kind == "las" else 2**64 - 1
    for value in (COUNT + 10_000, 10**9, largest):
        assert outcome(tmp_path / "a.laz", patched(files[kind], form, place, value)) is None, value


@pytest.mark.usefixtures("bounded")
def test_a_wrong_record_length_is_refused(tmp_path: Path, files: dict[str, bytes]) -> None:
    for kind in KINDS:
        data = files[kind]
        first = struct.unpack_from("<H", data, 94)[0]
        assert outcome(tmp_path / "a.laz", patched(data, "<H", first + 20, 65535)) is None, kind
    evlr = struct.unpack_from("<Q", files["copc"], 235)[0]
    for form, place, value in (("<Q", evlr + 20, 2**63), ("<Q", 235, 2**63), ("<I", 243, 9999)):
        assert outcome(tmp_path / "a.laz", patched(files["copc"], form, place, value)) is None


def test_a_wrong_number_of_records_is_refused(tmp_path: Path, files: dict[str, bytes]) -> None:
    path = tmp_path / "a.las"
    path.write_bytes(patched(files["las"], "<I", 100, 9999))
    with pytest.raises(InputError, match="write it again"):
        open_source(path)


@pytest.mark.usefixtures("bounded")
def test_a_wrong_bounding_box_is_measured(tmp_path: Path, files: dict[str, bytes]) -> None:
    whole = tmp_path / "whole.las"
    whole.write_bytes(files["las"])
    for place in range(179, 227, 8):
        for value in (float("nan"), 1e300, -1e300):
            path = tmp_path / "box.las"
            path.write_bytes(patched(files["las"], "<d", place, value))
            found, wanted = open_source(path).bounds, open_source(whole).bounds
            assert np.allclose([found.west, found.north], [wanted.west, wanted.north], atol=0.011)


@pytest.mark.usefixtures("bounded")
def test_a_hierarchy_that_is_not_the_chunk_table_is_refused(tmp_path: Path, files: dict[str, bytes]) -> None:
    data = files["copc"]
    root = struct.unpack_from("<Q", data, 375 + 54 + 40)[0]
    for form, place, value in (
        ("<i", root, 31),
        ("<Q", root + 16, 5),
        ("<i", root + 28, 7),
        ("<i", root + 28, -2),
        ("<Q", 375 + 54 + 40, 2**63),
        ("<Q", 375 + 54 + 48, 33),
        ("<Q", root + 32 + 16, root),  # a page that names its own page
    ):
        assert outcome(tmp_path / "a.laz", patched(data, form, place, value)) is None, (place - root, value)


@pytest.mark.parametrize("kind", but_first(KINDS))
@pytest.mark.usefixtures("bounded")
def test_random_bytes_do_no_harm(tmp_path: Path, files: dict[str, bytes], kind: str) -> None:
    rng, data = np.random.default_rng(len(kind)), np.frombuffer(files[kind], np.uint8)
    refused = 0
    for number in range(MUTATIONS):
        copy = data.copy()
        # Every other file is hurt where it hurts most: in header, records and the first chunk.
        reach = min(len(copy), 900) if number % 2 else len(copy)
        places = rng.integers(0, reach, rng.integers(1, 9))
        copy[places] = rng.integers(0, 256, len(places))
        count = outcome(tmp_path / "a.laz", copy.tobytes())
        refused += count is None
        assert count is None or count <= COUNT * 20
    assert 0 < refused < MUTATIONS


def test_nothing_is_written_of_a_damaged_file(tmp_path: Path, files: dict[str, bytes]) -> None:
    path, out = tmp_path / "a.laz", tmp_path / "out"
    path.write_bytes(files["laz"])
    source = open_source(path)
    data = bytearray(files["laz"])
    data[source.layout.data_offset + 40 : source.layout.data_offset + 80] = bytes([255] * 40)
    path.write_bytes(bytes(data))
    with pytest.raises(InputError, match="damaged"):
        write_classified(source, out / "classified.laz", np.zeros(COUNT, np.uint8))
    assert list(out.iterdir()) == []


def test_a_header_that_cannot_be_copied_costs_its_extras_and_not_the_points(
    tmp_path: Path, files: dict[str, bytes], caplog: pytest.LogCaptureFixture
) -> None:
    path, out = tmp_path / "a.laz", tmp_path / "classified.laz"
    first = struct.unpack_from("<H", files["laz"], 94)[0]
    path.write_bytes(patched(files["laz"], "<B", first + 5, 255))
    classes = np.arange(COUNT, dtype=np.uint8) % 7
    write_classified(open_source(path), out, classes, {"building_id": np.arange(COUNT, dtype=np.int32)})
    assert "cannot be copied" in caplog.text
    found, whole = laspy.read(out), tmp_path / "whole.laz"
    whole.write_bytes(files["laz"])
    wanted, used = laspy.read(whole), np.arange(COUNT) % 7 != 0
    assert np.array_equal(found.xyz, wanted.xyz)
    assert np.array_equal(np.asarray(found.classification)[used], classes[used])
    assert np.array_equal(found.building_id, np.arange(COUNT))


def test_a_version_that_cannot_hold_the_points_costs_its_extras_and_not_the_points(
    tmp_path: Path, files: dict[str, bytes], caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "a.laz"
    # The number of points as LAS 1.2 knows it, beside the version.
    data = patched(patched(files["laz"], "<B", 25, 2), "<I", 107, COUNT)
    path.write_bytes(data)
    write_classified(open_source(path), tmp_path / "b.laz", np.full(COUNT, 2, np.uint8))
    assert "cannot be copied" in caplog.text
    assert laspy.read(tmp_path / "b.laz").header.version.minor == 4


def test_points_out_of_this_world_are_left_out_and_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "a.xyz"
    path.write_text("85000 447000 3\n85001 447001 1e300\n1e300 447000 3\n85002 447002 -4\n")
    (chunk,) = iter_chunks(open_source(path))
    assert chunk.position.tolist() == [0, 3] and "2 points" in caplog.text
    write_classified(open_source(path), tmp_path / "b.laz", np.array([2, 2, 2, 6], np.uint8))
    found = laspy.read(tmp_path / "b.laz")
    assert np.asarray(found.withheld).tolist() == [0, 1, 1, 0] and found.classification[3] == 6
