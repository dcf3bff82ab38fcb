"""Wireframes: corners and edges of a square with a diagonal."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from benchmarks.wireframes.drawing import (
    corner_groups,
    joined_faces,
    without_straight_corners,
    write_obj_wireframe,
)
from benchmarks.wireframes.scores import Wireframe, compare_wireframes, evaluate_wireframe, read_wireframe

from eaves.formats import InputError
from eaves.simulate import nine_roofs_on_a_slope

SQUARE = np.array([[0, 0, 5], [10, 0, 5], [10, 10, 5], [0, 10, 5]], float)
EDGES = np.array([[0, 1], [1, 2], [2, 3], [0, 3], [0, 2]])
FRAME = Wireframe(SQUARE, EDGES)


def test_a_perfect_result_scores_perfectly() -> None:
    score = evaluate_wireframe(FRAME, FRAME)
    assert score.corners.quality == 1 and score.edges.quality == 1 and score.corner_offset_m == 0


def test_a_missing_edge_costs_completeness_of_edges_only() -> None:
    score = evaluate_wireframe(Wireframe(SQUARE, EDGES[:-1]), FRAME)
    assert score.edges.completeness == 0.8 and score.edges.correctness == 1 and score.corners.quality == 1


def test_a_corner_that_is_off_costs_its_edges_too() -> None:
    moved = SQUARE.copy()
    moved[2] += [2, 0, 0]
    score = evaluate_wireframe(Wireframe(moved, EDGES), FRAME)
    assert score.corners.completeness == 0.75 and score.edges.completeness == 0.4


def test_a_corner_a_little_off_counts_with_its_offset() -> None:
    moved = SQUARE.copy()
    moved[2] += [0, 0, 0.4]
    score = evaluate_wireframe(Wireframe(moved, EDGES), FRAME)
    assert score.corners.quality == 1 and score.corner_offset_m == pytest.approx(0.1)


def test_an_extra_corner_costs_correctness() -> None:
    score = evaluate_wireframe(Wireframe(np.vstack([SQUARE, [[5, 5, 5]]]), EDGES), FRAME)
    assert score.corners.correctness == 0.8 and score.corners.completeness == 1


def test_lines_and_faces_of_an_obj_file_are_read(tmp_path: Path) -> None:
    path = tmp_path / "roof.obj"
    vertices = "".join(f"v {x} {y} {z}\n" for x, y, z in SQUARE)
    path.write_text(vertices + "f 1/1 2/1 3/1 4/1\nl -4 -2\n", encoding="utf-8")
    assert read_wireframe(path).edges.tolist() == sorted(EDGES.tolist())


@pytest.mark.parametrize("text", ["", "v 1 2 x\n", "v 1 2 3\nl 1 9\n"])
def test_a_bad_file_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.obj"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"bad\.obj"):
        read_wireframe(path)


def test_folders_are_compared_roof_by_roof__a_missing_one_counts(tmp_path: Path) -> None:
    truth = nine_roofs_on_a_slope(density=4.0)
    mine, true = tmp_path / "mine", tmp_path / "true"
    mine.mkdir(), true.mkdir()
    for building in truth.buildings:
        write_obj_wireframe(true / f"{building.kind}.obj", [building.model(truth.cloud.origin)])
    for path in list(true.iterdir())[:-1]:
        (mine / path.name).write_bytes(path.read_bytes())
    evaluation = compare_wireframes(mine, true)
    assert evaluation.figures["roofs"] == 9
    assert evaluation.figures["corners, precision"] == 1
    assert 0.7 < float(evaluation.figures["corners, recall"]) < 1
    assert evaluation.figures["mean offset of corners (m)"] == 0
    assert sum(row["edges, recall"] == 1 for row in evaluation.rows) == 8


def test_written_wireframe_is_the_roof_in_world_coordinates(tmp_path: Path) -> None:
    truth = nine_roofs_on_a_slope(density=4.0)
    shed = next(building for building in truth.buildings if building.kind == "shed")
    write_obj_wireframe(tmp_path / "shed.obj", [shed.model(truth.cloud.origin)])
    frame = read_wireframe(tmp_path / "shed.obj")
    world = np.asarray(shed.footprint.exterior.coords)[:-1] + truth.cloud.origin
    assert len(frame.corners) == len(frame.edges) == 4
    assert np.allclose(np.sort(frame.corners[:, :2], axis=0), np.sort(world, axis=0), atol=1e-3)


def test_a_mesh_and_a_folder_are_told_apart(tmp_path: Path) -> None:
    (tmp_path / "roofs").mkdir()
    with pytest.raises(InputError, match="holds no wireframe"):
        compare_wireframes(tmp_path, tmp_path / "roofs")


def test_low_step_and_small_jog_are_drawn_as_one_corner() -> None:
    low = np.array([[0.0, 0, 5], [5, 0, 5], [5, 8, 5], [0, 8, 5]])
    step = low[1:3] + [0, 0, 0.4]
    group = corner_groups(np.vstack([low, step, [[9, 0, 5.4], [9, 0.3, 5.4]]]), 0.7)
    assert group[4] == group[1] and group[5] == group[2] and group[6] == group[7]
    assert len(set(group.tolist())) == 5


def test_no_two_corners_of_a_group_are_further_apart_than_the_detail__a_row_of_them() -> None:
    row = np.column_stack([0.5 * np.arange(7.0), np.zeros(7), np.zeros(7)])
    group = corner_groups(row, 0.7)
    assert max(np.ptp(row[group == one, 0]) for one in set(group.tolist())) <= 0.7


def test_corner_beside_the_line_of_its_neighbours_goes_and_one_away_from_it_stays() -> None:
    corners = np.array([[0.0, 0, 5], [5, 0.2, 5], [10, 0, 5], [10, 8, 5], [5, 8.5, 5], [0, 8, 5]])
    ring = {(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (0, 5)}
    assert without_straight_corners(corners, ring, 0.35) == {(0, 2), (2, 3), (3, 4), (4, 5), (0, 5)}


def test_faces_of_nearly_one_plane_are_drawn_as_one_and_those_of_a_ridge_are_not() -> None:
    square = np.array([[0.0, 0, 0], [5, 0, 0], [5, 5, 0], [0, 5, 0]])
    low, high = square + [0, 0, 5.0], square + [5, 0, 5.3]
    slope = square * [1, 1, 0] + [10, 0, 5.3] - [0, 0, 1] * square[:, :1] * 0.5
    assert joined_faces([[low], [high], [slope]], 0.2) == [[0, 1], [2]]
    assert joined_faces([[low], [high], [slope]], 0.05) == [[0], [1], [2]]
