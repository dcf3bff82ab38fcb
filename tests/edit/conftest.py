"""A kept run of nine roofs, and sessions of copies of it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from eaves.edit.actions import Session
from eaves.pipeline import build
from eaves.simulate import nine_roofs_on_a_slope, write_simulation


@pytest.fixture(scope="session")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that keeps its parts."""
    place = tmp_path_factory.mktemp("table")
    files = write_simulation(nine_roofs_on_a_slope(density=8.0, seed=1), place / "nine")
    outputs = ("footprints", "models", "classified", "rasters")
    build(files["points"], place / "out", keep=True, jobs=1, outputs=outputs)
    return place / "out"


@pytest.fixture
def out(kept: Path, tmp_path: Path) -> Path:
    shutil.copytree(kept, tmp_path / "out")
    return tmp_path / "out"


@pytest.fixture
def session(out: Path) -> Iterator[Session]:
    with closing(Session(out)) as one:
        yield one
