"""Solids raised from plans: closed, oriented, with exact volumes."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from eaves.geometry.arrangement import arrange
from eaves.geometry.coverage import Coverage
from eaves.reconstruct.attributes import measure_volume
from eaves.reconstruct.extrusion import extrude
from eaves.reconstruct.soundness import find_defect

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
