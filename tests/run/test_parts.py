"""Parts of a run: data only, checked, and computed again where they are damaged."""

from __future__ import annotations

import json
import logging
import pickle
import shutil
from collections.abc import Callable
from datetime import date, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from tests.conftest import build_in_blocks

from eaves.model import Failure, Footprint
from eaves.run.store import PartFile, is_whole_part, pack, save_part, unpack

build = partial(build_in_blocks, 60.0)

Break = Callable[[Path], object]


def test_a_value_comes_back_as_it_was() -> None:
    value: Any = {
        "plain": [None, True, 1, -2.5e-300, "ä\n", float("inf")],
        "tuple": ((0, 1), ["~", 2], ["~"], {"~": 3, 4: 5}),
        "bytes": b"\0\xff",
        "times": [datetime(2020, 1, 2, 3, 4, 5), date(2020, 1, 2), timedelta(days=1, microseconds=7)],
        "numpy": np.float32(0.1),
    }
    arrays = {"array": np.arange(3.0), "by columns": np.eye(3)[:2].T, "none": np.zeros((0, 3), np.int32)}
    back = unpack(pack({**value, **arrays}))
    for name, array in arrays.items():
        again = back.pop(name)
        assert again.dtype == array.dtype and again.flags.writeable and np.array_equal(again, array)
    assert back == value
    empty = unpack(pack(np.zeros((0, 3))))
    assert empty.shape == (0, 3)
    failure = Failure("no_area", "why", "outline", Footprint(shapely.box(0, 0, 1, 2), id="a", score=0.5))
    again = unpack(pack([failure]))[0]
    assert again == failure and again.footprint.polygon.equals_exact(failure.footprint.polygon, 0)


@pytest.mark.parametrize(
    "kind", ["os:system", "eaves.pipeline:build", "eaves.nowhere:Block", "eaves.model:one"]
)
def test_a_part_makes_nothing_but_data_of_the_package(kind: str) -> None:
    data = pack(Failure("no_area", "why", "outline"))
    name = f"{Failure.__module__}:Failure".encode()
    assert name in data
    text = data[4:].replace(name, kind.encode())
    with pytest.raises(ValueError, match="no data of eaves"):
        unpack(len(text).to_bytes(4, "little") + text)


def test_a_pickle_in_place_of_a_part_is_never_loaded(tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self) -> tuple[Any, ...]:
            return Path.touch, (tmp_path / "code ran",)

    (tmp_path / "a.part").write_bytes(pickle.dumps(Bomb()))
    with pytest.raises(ValueError, match="no part of a run"):
        PartFile(tmp_path / "a.part")
    with pytest.raises(ValueError, match="about holds objects"):
        save_part(tmp_path / "b.part", {"about": np.array([Bomb()], dtype=object)})
    assert not (tmp_path / "code ran").exists() and not (tmp_path / "b.part").exists()


@pytest.mark.parametrize("dtype", ["f8", "u1", "<i4", "?", "S3"])
def test_arrays_come_back_as_they_were(tmp_path: Path, dtype: str) -> None:
    path, values = tmp_path / "a.part", np.arange(12).astype(dtype)
    arrays = {
        "flat": values,
        "by_rows": values.reshape(3, 4),
        "by_columns": values.reshape(3, 4).T,
        "a/strange-name": values[::2],
        "none": values[:0],
        "one": np.array(7),
    }
    save_part(path, arrays)
    part = PartFile(path)
    assert list(part) == list(arrays) and "flat" in part and "other" not in part
    for name, array in arrays.items():
        for back in (part[name], part.mapped(name)) if array.size else (part[name],):
            assert back.dtype == array.dtype and back.flags.writeable
            assert back.shape == array.shape and np.array_equal(back, array)


def test_any_changed_byte_makes_a_part_unsound(tmp_path: Path) -> None:
    path = tmp_path / "a.part"
    save_part(path, {"x": np.arange(50.0), "none": np.zeros((0, 3))})
    whole = path.read_bytes()
    assert is_whole_part(path)
    for place in range(len(whole)):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        assert not is_whole_part(path), place
    for length in (0, 1, 7, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        assert not is_whole_part(path), length


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-23])


@pytest.mark.parametrize(
    ("what", "damage"),
    [
        ("points/*/*.bin", cut),
        ("points/*.part", cut),
        ("regions/*.part", lambda path: path.write_bytes(b"")),
        ("buildings/*.part", cut),
        ("regions/*.key", cut),
    ],
)
def test_a_damaged_part_is_named_and_computed_again(
    what: str,
    damage: Break,
    kept: Path,
    one_roof_file: Path,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    out = tmp_path / "out"
    shutil.copytree(kept, out)
    for step in ("points", "regions", "buildings"):  # as a writer that was killed leaves them
        (out / ".eaves-work" / step / ".0_0.part.half").mkdir()
        (out / ".eaves-work" / step / ".0_0.part.half" / "0_0.part").touch()
    broken = next((out / ".eaves-work").glob(what))
    damage(broken)
    with caplog.at_level(logging.WARNING, "eaves"):
        assert build(one_roof_file, out, resume=True).complete
    assert any(str(broken) in record.getMessage() for record in caplog.records)
    models = [(folder / "buildings.city.jsonl").read_text() for folder in (kept, out)]
    assert models[0] == models[1]


@pytest.fixture(scope="module")
def kept(one_roof_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run with all its parts."""
    folder = tmp_path_factory.mktemp("kept") / "out"
    assert build(one_roof_file, folder, keep=True).complete
    return folder


def test_the_field_of_ids_and_the_files_beside_a_shapefile_are_part_of_the_plan(tmp_path: Path) -> None:
    from eaves.flow.refusals import hash_of

    for suffix in (".shp", ".dbf", ".prj", ".txt"):
        (tmp_path / f"a{suffix}").write_text("1")
    before = hash_of(tmp_path / "a.shp")
    (tmp_path / "a.txt").write_text("2")
    assert hash_of(tmp_path / "a.shp") == before
    (tmp_path / "a.dbf").write_text("2")
    assert hash_of(tmp_path / "a.shp") != before
    from eaves.flow.run import open_run
    from eaves.simulate import nine_roofs_on_a_slope, write_simulation

    files = write_simulation(nine_roofs_on_a_slope(density=1.0), tmp_path / "nine")
    plans = [
        open_run(files["points"], tmp_path / "o", footprints=files["vectors"], id_field=field).plan
        for field in (None, "id")
    ]
    assert plans[0] != plans[1] and json.dumps(plans[0])
