"""Solids raised from plans: closed, oriented, with exact volumes."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from eaves.figures.attributes import measure_volume
from eaves.geometry.face_table import FaceTable
from eaves.solids.coverage import Coverage
from eaves.solids.cutting import arrange
from eaves.solids.extrude import NEAR_NODE, extrude, split_crossings
from eaves.solids.soundness import find_defect, fold_defect, on_own_plane

SQUARE = shapely.box(0, 0, 4, 4)
CROSS = np.array([[0.0, 2.0, 4.0, 2.0], [2.0, -1.0, 2.0, 5.0]])


def four_cells() -> Coverage:
    plan = arrange(SQUARE, CROSS)
    assert plan is not None and plan.count == 4
    return plan


def quadrants(plan: Coverage, values: dict[tuple[bool, bool], float]) -> np.ndarray:
    """Horizontal planes by quadrant: (east, north) → height."""
    centre = [shape.centroid for shape in plan.polygons()]
    return np.array([[0.0, 0.0, values[point.x > 2, point.y > 2]] for point in centre])


def test_stepped_cells_make_one_closed_solid_of_exact_volume() -> None:
    plan = four_cells()
    heights = {(False, False): 5.0, (True, False): 3.0, (False, True): 4.0, (True, True): 2.0}
    solids = extrude(plan, quadrants(plan, heights), 0.0)
    assert solids is not None and len(solids) == 1
    assert find_defect(solids[0]) == ""
    assert measure_volume(solids[0]) == pytest.approx(4.0 * (5 + 3 + 4 + 2))


def test_checkerboard_does_not_touch_itself_along_the_middle() -> None:
    plan = four_cells()
    heights = {(False, False): 5.0, (True, False): 3.0, (False, True): 3.0, (True, True): 5.0}
    solids = extrude(plan, quadrants(plan, heights), 0.0)
    assert solids is not None
    assert [find_defect(solid) for solid in solids] == [""]
    assert measure_volume(solids[0]) == pytest.approx(64.0, abs=0.05)


def test_gable_shares_its_ridge_and_has_no_wall_under_it() -> None:
    plan = arrange(shapely.box(0, 0, 10, 6), np.array([[-1.0, 3.0, 11.0, 3.0]]))
    assert plan is not None
    south = [shape.centroid.y < 3 for shape in plan.polygons()]
    planes = np.array([[0.0, 0.5, 4.0] if one else [0.0, -0.5, 7.0] for one in south])
    (solid,) = extrude(plan, planes, 0.0) or []
    assert find_defect(solid) == ""
    assert len(solid.faces) == 1 + 2 + 6  # each gable wall stands on two plan edges, one for each roof face
    assert measure_volume(solid) == pytest.approx(10 * 6 * 4.75)


def test_planes_that_cross_along_an_edge_get_a_vertex_there() -> None:
    plan = arrange(shapely.box(0, 0, 4, 2), np.array([[2.0, -1.0, 2.0, 3.0]]))
    assert plan is not None
    west = [shape.centroid.x < 2 for shape in plan.polygons()]
    planes = np.array([[0.0, 0.5, 4.0] if one else [0.0, -0.5, 5.0] for one in west])
    (solid,) = extrude(plan, planes, 0.0) or []
    assert find_defect(solid) == ""
    assert np.any(np.all(np.isclose(solid.vertices, [2.0, 1.0, 4.5]), axis=1))
    assert measure_volume(solid) == pytest.approx(4 * 4.5 + 4 * 4.5)


@pytest.mark.parametrize("beside", [0.005, 0.012, 0.019])
def test_a_crossing_beside_a_node_inside_is_at_that_node(beside: float) -> None:
    plan = four_cells()
    planes = quadrants(plan, {(False, False): 4.0, (True, False): 5.0, (False, True): 4.0, (True, True): 0.0})
    planes[planes[:, 2] == 0.0] = [2.0, 0.0, 5.0 - 2.0 * (2.0 + beside)]
    split = split_crossings(plan, planes, np.zeros((plan.count, 3)))
    assert len(split.nodes) == len(plan.nodes)
    assert split.length.min() > NEAR_NODE
    assert np.any(np.all(np.isclose(split.nodes, [2.0 + beside, 2.0]), axis=1))
    (solid,) = extrude(plan, planes, 0.0) or []
    assert find_defect(solid) == ""


def test_a_crossing_further_away_gets_a_node_of_its_own() -> None:
    plan = four_cells()
    planes = quadrants(plan, {(False, False): 4.0, (True, False): 5.0, (False, True): 4.0, (True, True): 0.0})
    planes[planes[:, 2] == 0.0] = [2.0, 0.0, 5.0 - 2.0 * (2.0 + 0.021)]
    split = split_crossings(plan, planes, np.zeros((plan.count, 3)))
    assert len(split.nodes) == len(plan.nodes) + 1
    assert np.array_equal(split.nodes[:-1], plan.nodes)


def test_a_crossing_beside_the_outline_moves_no_node_of_it() -> None:
    plan = arrange(SQUARE, CROSS[:1])
    assert plan is not None
    south = [shape.centroid.y < 2 for shape in plan.polygons()]
    planes = np.array([[0.0, 0.0, 5.0] if one else [2.0, 0.0, 5.0 - 2.0 * 0.012] for one in south])
    split = split_crossings(plan, planes, np.zeros((plan.count, 3)))
    assert np.array_equal(split.nodes[:-1], plan.nodes)
    assert split.nodes[-1].tolist() == [0.012, 2.0]


def test_a_fold_is_seen_on_the_plane_of_its_face() -> None:
    """Face of a block in Delft: two nodes 12 mm apart, and a triangle 1 mm high between three of them."""
    corners = [
        (154.857, 170.042, 12.384),
        (152.776, 172.864, 9.48),
        (152.401, 172.467, 9.571),
        (152.278, 172.631, 9.402),
        (151.416, 172.03, 9.4),
        (151.147, 171.883, 9.372),
        (151.137, 171.877, 9.372),
        (143.569, 166.32, 9.547),
        (143.225, 165.747, 9.772),
        (146.227, 164.027, 12.366),
    ]
    for ring, defect in ((range(10), "a roof face with a fold"), ((0, 1, 2, 3, 4, 6, 7, 8, 9), "")):
        rings = [np.array(corners)[list(ring)]]
        assert fold_defect(FaceTable.of([rings]), {0: on_own_plane(rings)}) == defect


def test_courtyard_is_a_hole_of_ground_and_roof() -> None:
    ring = shapely.difference(shapely.box(0, 0, 10, 10), shapely.box(3, 3, 7, 7))
    plan = arrange(ring, np.zeros((0, 4)))
    assert plan is not None
    (solid,) = extrude(plan, np.array([[0.0, 0.0, 3.0]]), 0.0) or []
    assert find_defect(solid) == ""
    assert measure_volume(solid) == pytest.approx(84 * 3)
    assert [len(face.rings) for face in solid.faces[:2]] == [2, 2]


def test_cells_that_meet_in_a_point_become_two_solids() -> None:
    plan = four_cells()
    label = np.array(
        [-1 if (shape.centroid.x > 2) != (shape.centroid.y > 2) else 0 for shape in plan.polygons()]
    )
    plan, _ = plan.merged(label)
    solids = extrude(plan, np.tile([0.0, 0.0, 3.0], (plan.count, 1)), 0.0)
    assert solids is not None and len(solids) == 2
    assert all(find_defect(solid) == "" for solid in solids)
