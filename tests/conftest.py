"""Data shared by the tests."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import laspy
import numpy as np
import pytest

from eaves.flow.results import Results
from eaves.flow.run import Progress, no_progress, open_run
from eaves.model.summary import Summary
from eaves.pipeline import Correction, build, build_run, end_run, hold_folder, no_correction
from eaves.run.options import EVERYTHING
from eaves.simulate.objects.houses import ExactScene, nine_roofs_on_a_slope
from tests.judges import summary_of


@pytest.fixture(scope="session")
def one_roof_file(nine_roofs_file: Path) -> Path:
    """One house of that file, where it is the folder or the command that is tested."""
    path = nine_roofs_file.with_name("one.laz")
    las = laspy.read(nine_roofs_file)
    near = (las.x < las.header.mins[0] + HOUSE) & (las.y < las.header.mins[1] + HOUSE)
    las.points = las.points[near]
    las.write(path)
    return path


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Say in one line which independent judges were not there."""
    skipped = terminalreporter.stats.get("skipped", ())
    if line := summary_of(str(report.longrepr) for report in skipped):
        terminalreporter.write_line(line)


HOUSE = 35.0
"""Metres between the houses of the nine."""


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real data; tests that need it skip where EAVES_DATA does not name one."""
    folder = os.environ.get("EAVES_DATA")
    if not folder:
        pytest.skip("EAVES_DATA names no folder with the benchmark data")
    return Path(folder)


@pytest.fixture
def cjio(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module cjio.cityjson, without its rounding of every float the process writes as JSON.

    On import it replaces parts of `json.encoder`, after which PROJJSON loses digits and systems their code.
    """
    monkeypatch.setattr(json.encoder, "c_make_encoder", json.encoder.c_make_encoder)
    monkeypatch.setattr(json.encoder, "float", float, raising=False)
    module: ModuleType = pytest.importorskip("cjio.cityjson")
    return module


@pytest.fixture(scope="session")
def nine_roofs() -> ExactScene:
    return nine_roofs_on_a_slope(density=6.0, noise=0.02, seed=3)


@pytest.fixture(scope="session")
def nine_roofs_file(nine_roofs: ExactScene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scene as a LAZ file without classes, in a random order, at a place on Earth."""
    path = tmp_path_factory.mktemp("nine") / "nine.laz"
    order = np.random.default_rng(5).permutation(len(nine_roofs.cloud))
    write_laz(path, (nine_roofs.cloud.xyz + [85000.0 - 85000.0 % 240, 447120.0, 0.0])[order])
    return path


def but_first(cases: Iterable[Any], count: int = 1) -> list[Any]:
    """The cases of a law, all but the first `count` slow: these stand for the others in `make test`."""
    listed = list(cases)
    rest = [one if isinstance(one, tuple) else (one,) for one in listed[count:]]
    return [*listed[:count], *(pytest.param(*one, marks=pytest.mark.slow) for one in rest)]


def build_files(*words: Any, **options: Any) -> Results:
    """What `eaves.build` gives, without the page unless outputs are named."""
    return build(*words, **{"outputs": EVERYTHING[:-1], **options})


def build_in_blocks(
    side: float,
    inputs: Any,
    out: Path,
    *words: Any,
    sink: Any = None,
    allow_failures: bool = False,
    tile_blocks: int = 1,
    progress: Progress = no_progress,
    correction: Correction = no_correction,
    generations: tuple[int, ...] = (),
    **options: Any,
) -> Summary:
    """What `build_files` gives with blocks of a side (m), of which small scenes have several, and with
    `per_tile` in tiles of so many blocks a side; inputs of later scans as in an update."""
    run = replace(open_run(inputs, out, *words, **options), side=side, tile_side=tile_blocks * side)
    run = replace(run, generations=generations)
    with hold_folder(run) as workers:
        summary = build_run(run, workers, progress, sink, correction)
        end_run(run, summary)
    return summary.checked(allow_failures)


def write_laz(path: Path, xyz: np.ndarray, epsg: int | None = 28992, **fields: np.ndarray) -> None:
    """A LAZ file (LAS 1.4, point format 6) of points in the units of its system, with fields by name."""
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales = np.full(3, 0.001)
    header.offsets = np.floor(xyz.min(axis=0)) if len(xyz) else np.zeros(3)
    if epsg is not None:
        import pyproj

        header.add_crs(pyproj.CRS.from_epsg(epsg))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    las.return_number = np.ones(len(xyz), np.uint8)
    las.number_of_returns = np.ones(len(xyz), np.uint8)
    for name, values in fields.items():
        las[name] = values.astype(np.uint8)
    las.write(path)
