"""Pictures for print, and results in notebooks."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

import eaves
from eaves.model.summary import Summary
from eaves.report.plots.drawings import agreement, cut_lines, cut_triangles, view_matrix
from eaves.report.plots.plot import plot_run


@pytest.mark.parametrize("what", ["plan", "section", "models"])
def test_a_picture_has_the_size_asked_for(nine_run: Summary, tmp_path: Path, what: str) -> None:
    image = imread(plot_run(nine_run.folder, tmp_path / f"{what}.png", what, size_cm=12.7, dpi=100))
    assert abs(image.shape[1] - 500) <= 1
    assert image[:, :, :3].std() > 0.02


@pytest.mark.parametrize("suffix", ["svg", "pdf"])
def test_a_picture_is_drawn_with_lines_too(nine_run: Summary, tmp_path: Path, suffix: str) -> None:
    assert plot_run(nine_run.folder, tmp_path / f"plan.{suffix}").stat().st_size > 1000


def test_a_result_agrees_with_itself(nine_run: Summary, tmp_path: Path) -> None:
    found = agreement(nine_run.folder, nine_run.folder / "footprints.gpkg")
    assert set(np.unique(found.values)) == {0.0, 1.0}
    plot_run(
        nine_run.folder, tmp_path / "errors.png", "errors", reference=nine_run.folder / "footprints.gpkg"
    )


def test_wrong_options_raise_different_errors(nine_run: Summary, tmp_path: Path) -> None:
    for wish, told in (
        ({"what": "map"}, "is no picture"),
        ({"what": "errors"}, "--reference"),
        ({"what": "section", "building": "nowhere"}, "no building has the id"),
        ({"path": tmp_path / "plan.gif"}, r"\.gif"),
    ):
        with pytest.raises(ValueError, match=told):
            plot_run(nine_run.folder, **wish)


def test_pieces_of_faces_and_edges_keep_area_and_length() -> None:
    corners = np.array([[[0.0, 0, 0], [40, 0, 0], [0, 30, 10]]])
    parts, whole = cut_triangles(corners)

    def area(triangles: np.ndarray) -> float:
        one, two = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
        return float(np.linalg.norm(np.cross(one, two), axis=1).sum())

    assert len(parts) > 30
    assert set(whole) == {0}
    assert np.isclose(area(parts), area(corners))
    lines = cut_lines(corners[:, :2])
    assert len(lines) == 8
    assert np.isclose(np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1).sum(), 40)
    assert np.allclose(view_matrix(-30, 38) @ view_matrix(-30, 38).T, np.eye(3))


def test_a_summary_shows_itself_and_gives_arrays(nine_run: Summary) -> None:
    assert "buildings found" in nine_run._repr_html_()
    points = nine_run.point_cloud()
    assert len(points) == nine_run.points
    one = nine_run.point_cloud(building=1)
    assert 0 < len(one) < len(points)
    assert set(one.fields["building_id"]) == {1}


@pytest.mark.parametrize("name", ["geopandas", "trimesh"])
def test_frames_and_meshes_come_or_name_the_package_that_is_missing(nine_run: Summary, name: str) -> None:
    made = "footprints" if name == "geopandas" else "models"
    if importlib.util.find_spec(name) is None:
        with pytest.raises(ImportError, match=r"\.\[notebook\]"):
            getattr(nine_run, made)
        return
    if name == "geopandas":
        assert len(nine_run.footprints) == nine_run.found == len(eaves.open_results(nine_run.folder))
    else:
        assert len(nine_run.models) == nine_run.modelled
        assert all(mesh.is_watertight and mesh.volume > 0 for mesh in nine_run.models.values())
