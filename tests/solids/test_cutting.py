"""A polygon cut by lines: the cells fill it, share their nodes, and the polygon stays where it was."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.testing import assert_allclose

from eaves.solids.coverage import NARROWEST_NECK, OUTSIDE, Coverage
from eaves.solids.cutting import arrange

SQUARE = shapely.box(0.0, 0.0, 10.0, 10.0)


def cut(polygon: shapely.Polygon, *segments: tuple[float, float, float, float]) -> Coverage:
    plan = arrange(polygon, np.array(segments).reshape(-1, 4))
    assert plan is not None
    return plan


def test_two_lines_that_cross_make_four_cells() -> None:
    plan = cut(SQUARE, (-1.0, 4.0, 11.0, 4.0), (3.0, -1.0, 3.0, 11.0))
    assert_allclose(np.sort(plan.area), [12.0, 18.0, 28.0, 42.0])
    assert len(plan.nodes) == 9 and len(plan.start) == 2 * 12


@pytest.mark.parametrize("line", [(2.0, 2.0, 8.0, 7.0), (-1.0, 5.0, 8.0, 5.0), (11.0, 0.0, 11.0, 10.0)])
def test_ends_that_hang_free_cut_nothing(line: tuple[float, float, float, float]) -> None:
    plan = cut(SQUARE, line)
    assert plan.count == 1 and plan.area[0] == pytest.approx(100.0)


def test_a_rectangle_that_touches_nothing_is_a_cell_in_the_hole_of_another() -> None:
    inner = [(3.0, 2.9, 3.0, 7.1), (7.0, 2.9, 7.0, 7.1), (2.9, 3.0, 7.1, 3.0), (2.9, 7.0, 7.1, 7.0)]
    yard = shapely.Polygon(SQUARE.exterior, [shapely.box(8.0, 8.0, 9.0, 9.0).exterior])
    plan = cut(yard, *inner)
    assert_allclose(np.sort(plan.area), [16.0, 83.0])
    assert [len(shape.interiors) for shape in plan.polygons()[np.argsort(plan.area)]] == [0, 2]


def test_lines_that_nearly_meet_in_a_place_meet_in_one_node() -> None:
    plan = cut(SQUARE, (-1.0, 5.0, 11.0, 5.01), (5.0, -1.0, 5.01, 11.0), (-1.0, -1.02, 11.0, 11.0))
    assert plan.count == 6
    assert len(plan.nodes) == 4 + 4 + 1


def test_a_line_just_beside_a_corner_or_an_edge_leaves_the_outline_as_it_was() -> None:
    for line in [(0.02, -1.0, 0.02, 11.0), (-1.0, 9.01, 1.01, 11.0), (-1.0, -1.02, 11.0, 11.0)]:
        plan = cut(SQUARE, line)
        whole = shapely.union_all(plan.polygons())
        assert shapely.equals(whole, SQUARE) or shapely.hausdorff_distance(whole, SQUARE) <= 0.001
        assert plan.area.sum() == pytest.approx(100.0, abs=0.01)


@pytest.mark.parametrize("seed", range(12))
def test_cells_of_many_lines_are_valid_and_fill_the_outline(seed: int) -> None:
    rng = np.random.default_rng(seed)
    outline = shapely.Polygon([(0, 0), (12, 0), (12, 7), (7, 7), (7, 12), (0, 12)])
    angle, far = rng.uniform(0.0, np.pi, 60), rng.uniform(1.0, 20.0, 60)
    angle[:30] = rng.choice([0.0, 0.5 * np.pi, 1e-3], 30)
    middle, step = (
        rng.uniform(0.0, 12.0, (60, 2)),
        far[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]),
    )
    plan = cut(outline, *np.hstack([middle - step, middle + step]))
    shapes = plan.polygons()
    assert shapely.is_valid(shapes).all() and plan.count > 100
    assert plan.area.sum() == pytest.approx(outline.area, rel=1e-3)
    assert shapely.union_all(shapes).symmetric_difference(outline).area < 1e-3 * outline.area
    assert len(np.unique(plan.nodes, axis=0)) == len(plan.nodes)
    assert ((plan.cell != OUTSIDE) | (plan.cell[plan.twin] != OUTSIDE)).all()


def test_a_polygon_narrower_than_a_neck_has_no_cells() -> None:
    assert arrange(shapely.box(0.0, 0.0, 10.0, 0.5 * NARROWEST_NECK), np.zeros((0, 4))) is None
