"""How much work common things take, counted in calls: a bar for what time on a shared machine cannot show.

`python -m pytest benchmarks/speed/test_work.py`, a part of `make bench` and of `make test-all`.
"""

from __future__ import annotations

import cProfile
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.conftest import nine_roofs, nine_roofs_file

import eaves
from eaves import exports, pipeline
from eaves.buildings import building_file
from eaves.formats.points import laz
from eaves.model import BuildingModel, Footprint
from eaves.simulate.objects.houses import ExactScene
from eaves.validate import validate_model

__all__ = ["nine_roofs", "nine_roofs_file"]  # fixtures of the tests

MODELLING, CHECKING = 9_650, 3_200
"""Calls of functions, Python's and libraries', for one gabled house."""
WRITING = {"citygml": 500, "glb": 950, "dxf": 295, "obj": 210}
"""Format → calls of functions for each of nine houses; a GLB file also looks up the version."""
COUNT = """
import json, pathlib, sys
from benchmarks.speed.counts import count_work
print(json.dumps(count_work(pathlib.Path(sys.argv[1]))))
"""
MOST = {
    "imported": 234,
    "ran": 186,
    "calls a building": 7550,
    "kernel calls a building": 285,
    "read": 5.0,
    "copied": 7.0,
    "sorted": 2.1,
    "ground": 1.0,
    "rasters": 1.0,
    "detect": 1.0,
}
"""Of a run over nine roofs in one block: modules, calls, and how often each point is handled."""


def calls_of(work: Callable[[], object]) -> int:
    """How many functions are called in some work that was done once before."""
    work()
    counter = cProfile.Profile()
    counter.runcall(work)
    return sum(entry.callcount for entry in counter.getstats())


def test_a_house_is_modelled_in_few_calls(nine_roofs: ExactScene) -> None:
    truth = nine_roofs.buildings[1]
    points = nine_roofs.cloud.xyz[nine_roofs.building == 2]
    footprint = Footprint(truth.footprint)

    def model() -> BuildingModel:
        planes = eaves.segment_roof(points, 0.4)
        answer = eaves.reconstruct_building(points, footprint, planes, truth.base)
        assert isinstance(answer, BuildingModel)
        return answer

    assert calls_of(model) <= MODELLING
    house = model()
    assert calls_of(lambda: validate_model(house)) <= CHECKING


@pytest.mark.parametrize("name", WRITING)
def test_a_house_is_written_in_few_calls(name: str, nine_roofs: ExactScene, tmp_path: Path) -> None:
    write = getattr(exports, f"write_{name}")
    models = [truth.model(nine_roofs.cloud.origin) for truth in nine_roofs.buildings]
    assert calls_of(lambda: write(tmp_path / name, models)) <= len(models) * WRITING[name]


def test_an_export_of_models_imports_no_reader_of_points() -> None:
    script = (
        "import sys; from eaves.flow import formats; print({'laspy', 'scipy', 'rasterio'} & {*sys.modules})"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


@pytest.mark.slow
def test_a_run_decodes_its_input_twice_and_its_models_once(
    nine_roofs_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    decoded, unpacked = [], []
    decompress, unpack = laz.decompress, building_file.unpack
    monkeypatch.setattr("eaves.formats.points.las.decompress", lambda *a: decoded.append(1) or decompress(*a))
    monkeypatch.setattr(building_file, "unpack", lambda data: unpacked.append(data) or unpack(data))
    assert pipeline.build(nine_roofs_file, tmp_path).complete
    assert (
        len(decoded) == 2
    )  # for the figures of the scan, and for the run: what else is needed is kept from then
    assert len(unpacked) == len(set(unpacked))


@pytest.fixture(scope="module")
def counts(nine_roofs_file: Path) -> dict[str, float]:
    words = [sys.executable, "-c", COUNT, str(nine_roofs_file)]
    done = subprocess.run(words, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2])
    return dict(json.loads(done.stdout.splitlines()[-1]))


def test_all_nine_roofs_are_counted(counts: dict[str, float]) -> None:
    assert counts["buildings"] == 9


@pytest.mark.parametrize("what", MOST)
def test_a_run_does_no_more_work_than(what: str, counts: dict[str, float]) -> None:
    assert counts[what] <= MOST[what]
