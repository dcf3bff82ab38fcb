"""A run to look at, and a place for the screenshots."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from eaves.model.summary import Summary
from eaves.pipeline import build


@pytest.fixture(scope="session")
def nine_run(nine_roofs_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Summary:
    """The nine roofs, built."""
    return build(nine_roofs_file, tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="session")
def artefacts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where screenshots are kept: the folder EAVES_ARTEFACTS names, else pytest's own."""
    named = os.environ.get("EAVES_ARTEFACTS")
    folder = Path(named) if named else tmp_path_factory.mktemp("artefacts")
    folder.mkdir(parents=True, exist_ok=True)
    return folder
