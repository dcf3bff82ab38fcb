"""Houses wall to wall under one roof: drawn at once, cut by their walls, each raised by itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely
from shapely import Polygon, box

from eaves.figures.attributes import surface_heights
from eaves.model import BuildingModel, Failure, Footprint, Points, Values
from eaves.reconstruct import reconstruct_building
from eaves.reconstruct.arrangement import Arrangement
from eaves.reconstruct.stage import BlockPart, draw_block
from eaves.roof import segment_roof
from eaves.validate import validate_model

HOUSE, DEPTH = 6.0, 9.0
STEP = 0.25

Roof = Callable[[Values, Values], Values]


def points_of(roof: Roof, width: float) -> Points:
    x, y = np.meshgrid(np.arange(0.5 * STEP, width, STEP), np.arange(0.5 * STEP, DEPTH, STEP))
    return np.column_stack([x.ravel(), y.ravel(), roof(x, y).ravel()])


def modelled(points: Points, parts: Sequence[Polygon]) -> list[BuildingModel]:
    """The models of the houses of a block, and that each has LoD 2.2 and is valid."""
    planes = segment_roof(points, STEP)
    block = draw_block(points, parts, planes, 0.0, Arrangement())
    models = []
    for number, outline in enumerate(parts):
        inside = shapely.contains_xy(outline, points[:, 0], points[:, 1])
        part = BlockPart(block, number, planes_in(planes, inside))
        model = reconstruct_building(points[inside], Footprint(outline), part.planes, 0.0, part=part)
        assert isinstance(model, BuildingModel) and model.lod == "2.2", model
        assert not validate_model(model)
        models.append(model)
    return models


def planes_in(planes: list, inside: np.ndarray) -> list:
    place = np.cumsum(inside) - 1
    kept = [(plane, plane.members[inside[plane.members]]) for plane in planes]
    return [
        type(plane)(plane.coefficients, place[members], plane.rmse) for plane, members in kept if len(members)
    ]


def side_by_side(walls: Sequence[float]) -> list[Polygon]:
    return [box(west, 0.0, east, DEPTH) for west, east in pairwise(walls)]


def gable(x: Values, y: Values) -> Values:
    return 6.0 + 0.8 * np.minimum(y, DEPTH - y)


def on_wall(model: BuildingModel, x: float) -> set[tuple[float, ...]]:
    """The corners of a model on the wall at `x`."""
    corners = np.concatenate([solid.vertices for solid in model.solids["2.2"]])
    return set(map(tuple, corners[np.abs(corners[:, 0] - x) < 0.2].tolist()))


def heights(model: BuildingModel, x: float) -> Values:
    y = np.arange(0.6, DEPTH, 0.7)
    return surface_heights(model.solids["2.2"], np.column_stack([np.full(len(y), x), y]))[0]


def test_one_gable_runs_through_four_houses() -> None:
    walls = [0.0, HOUSE, 2 * HOUSE, 3 * HOUSE, 4 * HOUSE]
    models = modelled(points_of(gable, walls[-1]), side_by_side(walls))
    planes = [{plane.coefficients for plane in model.planes} for model in models]
    assert len(planes[0]) == 2 and all(same == planes[0] for same in planes)
    for west, east, wall in zip(models[:-1], models[1:], walls[1:-1], strict=True):
        shared = on_wall(west, wall)
        assert shared == on_wall(east, wall)
        assert max(z for _, _, z in shared) == pytest.approx(6.0 + 0.4 * DEPTH, abs=0.01)
        assert len(shared) >= 5


def test_houses_keep_a_step_of_half_a_metre() -> None:
    walls = [0.0, HOUSE, 2 * HOUSE, 3 * HOUSE, 4 * HOUSE]
    points = points_of(lambda x, y: gable(x, y) + 0.5 * ((x // HOUSE) % 2), walls[-1])
    models = modelled(points, side_by_side(walls))
    for west, east, wall in zip(models[:-1], models[1:], walls[1:-1], strict=True):
        step = heights(east, wall + 0.3) - heights(west, wall - 0.3)
        assert np.allclose(np.abs(step), 0.5, atol=0.02)


def test_a_wall_where_the_roof_has_no_border_stays() -> None:
    walls = [0.0, 5.1, 13.3, 20.0]
    models = modelled(points_of(gable, walls[-1]), side_by_side(walls))
    assert [model.footprint.polygon.bounds[2] for model in models] == walls[1:]


def test_the_order_of_points_changes_nothing() -> None:
    walls = [0.0, HOUSE, 2 * HOUSE]
    points = points_of(lambda x, y: gable(x, y) + 0.5 * (x > HOUSE), walls[-1])
    mixed = np.random.default_rng(1).permutation(points)
    for one, other in zip(
        modelled(points, side_by_side(walls)), modelled(mixed, side_by_side(walls)), strict=True
    ):
        assert np.array_equal(one.solids["2.2"][0].vertices, other.solids["2.2"][0].vertices)


def test_the_courtyard_of_a_block_stays_open() -> None:
    x, y = np.meshgrid(np.arange(0.5 * STEP, 20.0, STEP), np.arange(0.5 * STEP, 20.0, STEP))
    built = (np.abs(x - 10.0) > 4.0) | (np.abs(y - 10.0) > 4.0)
    points = np.column_stack([x[built], y[built], np.full(np.count_nonzero(built), 6.0)])
    parts = [box(0, 0, 20, 6), box(0, 14, 20, 20), box(0, 6, 6, 14), box(14, 6, 20, 14)]
    for model, part in zip(modelled(points, parts), parts, strict=True):
        assert sum(plane.polygon.area for plane in model.planes) == pytest.approx(part.area, abs=0.1)


def test_a_part_comes_with_its_planes_by_places_among_the_points_in_order() -> None:
    class Looking(Arrangement):
        name = "looking"

        def raise_part(self, part: BlockPart, points: Points, *others: Any) -> BuildingModel | Failure:
            for plane in part.planes:
                slope_x, slope_y, height = plane.coefficients
                x, y, z = points[plane.members].T
                assert np.abs(slope_x * x + slope_y * y + height - z).max() < 0.01
            return super().raise_part(part, points, *others)

    points = np.random.default_rng(4).permutation(points_of(gable, HOUSE))
    planes, outline = segment_roof(points, STEP), box(0.0, 0.0, HOUSE, DEPTH)
    block = draw_block(points, [outline], planes, 0.0, Arrangement())
    part = BlockPart(block, 0, planes)
    model = reconstruct_building(points, Footprint(outline), planes, 0.0, Looking(), part=part)
    assert isinstance(model, BuildingModel) and model.lod == "2.2"


def test_a_method_that_draws_no_blocks_models_a_house_of_one_by_itself() -> None:
    points, outline = points_of(gable, HOUSE), box(0.0, 0.0, HOUSE, DEPTH)
    planes = segment_roof(points, STEP)
    part = BlockPart(draw_block(points, [outline], planes, 0.0, Arrangement()), 0, planes)
    model = reconstruct_building(points, Footprint(outline), planes, 0.0, "prism", part=part)
    assert isinstance(model, BuildingModel) and model.lod == "1.2"
