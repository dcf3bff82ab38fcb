"""The measures of `eaves.evaluate` take values and paths alike."""

from __future__ import annotations

from pathlib import Path

import pytest

import eaves
from eaves.flow.results import ModelledBuildings
from eaves.formats.in_memory import write_cloud
from eaves.model import LOCAL_METRES, Provenance
from eaves.simulate import ExactScene, nine_roofs_on_a_slope


@pytest.fixture(scope="module")
def truth() -> ExactScene:
    return nine_roofs_on_a_slope(density=4.0)


@pytest.fixture(scope="module")
def run(truth: ExactScene, tmp_path_factory: pytest.TempPathFactory) -> eaves.Results:
    out = tmp_path_factory.mktemp("run") / "out"
    return eaves.build(truth.cloud, out, crs="metres", outputs=("footprints", "models"))


def test_ground_of_files_is_that_of_clouds(truth: ExactScene, tmp_path: Path) -> None:
    true = truth.classified()
    for name, cloud in (("found", eaves.classify_ground(truth.cloud)), ("true", true)):
        write_cloud(tmp_path / f"{name}.las", cloud)
    by_path = eaves.evaluate.ground(tmp_path / "found.las", str(tmp_path / "true.las"))
    assert by_path == eaves.evaluate.ground(eaves.classify_ground(truth.cloud), true)


def test_tables_and_files_have_the_same_scores(run: eaves.Results) -> None:
    file, table = run.folder / "footprints.gpkg", run.footprints
    for judged, true in ((table, table), (file, table), (file, file)):
        assert eaves.evaluate.footprints(judged, true).mean_iou == 1.0
        assert eaves.evaluate.detection(judged, true).area.correctness == 1.0


def test_roofs_are_taken_from_runs_files_and_points(run: eaves.Results, truth: ExactScene) -> None:
    file, points = run.folder / "buildings.city.jsonl", truth.classified()
    of_run, of_file = (eaves.evaluate.roofs(one, points).figures for one in (run, file))
    assert of_run["models"] == 9 and of_run["within 0.2 m"] == of_file["within 0.2 m"] > 0.95
    again = ModelledBuildings([house.model() for house in truth.buildings], LOCAL_METRES, Provenance())
    assert eaves.evaluate.roofs(again, run).figures["models"] == 9
