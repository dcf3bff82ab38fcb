"""What is proved sound by a loop is sound by polygons and their triangles, too."""

from __future__ import annotations

import numpy as np

from eaves.geometry.tolerance import PLANARITY
from eaves.model import Face, Solid
from eaves.model.building import GROUND_SURFACE, ROOF_SURFACE
from eaves.solids.cutting import arrange
from eaves.solids.soundness import (
    FLATTEST_SHARE,
    fold_defect,
    on_own_plane,
    plan_defect,
    surely_sound,
)
from tests.solids.test_extrusion import CROSS, SQUARE


def tent(rng: np.random.Generator) -> Solid:
    """A ground face and a roof face over it: rings of up to nine corners, some crossing, some folded, some
    with corners that are near to others."""
    count = int(rng.integers(3, 10))
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
    if rng.random() < 0.3:
        rng.shuffle(angle)
    radius = rng.choice([0.0015, 0.5, 4.0]) + rng.uniform(0.0, 4.0, count)
    xy = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    a, b = rng.normal(0.0, 0.8, 2)
    z = 5.0 + a * xy[:, 0] + b * xy[:, 1] + rng.choice([0.0, 0.002, 0.02]) * rng.normal(size=count)
    top = np.round(np.column_stack([xy, z]), 3)
    vertices = np.concatenate([top, top * [1.0, 1.0, 0.0]])
    below = tuple(range(2 * count - 1, count - 1, -1))
    return Solid(vertices, (Face((below,), GROUND_SURFACE), Face((tuple(range(count)),), ROOF_SURFACE, 0)))


def test_faces_proved_sound_have_no_defect() -> None:
    rng = np.random.default_rng(8)
    clear, steady, sloped = 0, 0, 0
    for _ in range(1500):
        solid = tent(rng)
        is_clear, unsure = surely_sound(solid)
        assert 0 not in unsure
        clear += is_clear
        sloped += len(solid.faces[1].rings[0]) > 3
        if is_clear:
            assert plan_defect(solid) == ""
        if not unsure and plan_defect(solid) == "" and len(solid.faces[1].rings[0]) > 3:
            steady += 1
            flat = {1: on_own_plane(solid, solid.faces[1].rings)}
            assert np.abs(flat[1][:, 2]).max() <= FLATTEST_SHARE * PLANARITY
            assert not fold_defect(solid, flat)
    assert clear > 500 and steady > 0.2 * sloped


def test_plain_plans_are_all_proved_clear() -> None:
    rng = np.random.default_rng(9)
    found = [tent(rng) for _ in range(400)]
    sound = [solid for solid in found if plan_defect(solid) == ""]
    assert np.mean([surely_sound(solid)[0] for solid in sound]) > 0.95


def test_points_stay_in_cells_that_become_one() -> None:
    plan = arrange(SQUARE, CROSS)
    assert plan is not None
    x, y = np.meshgrid(np.linspace(-0.5, 4.5, 11), np.linspace(-0.5, 4.5, 11))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    for label in (np.array([0, 1, 1, 0]), np.zeros(4, np.int64), np.array([0, -1, 1, 1])):
        kept = plan.cells_merged(label, plan.cells_of(points))
        again = plan.merged(label)[0].cells_of(points)
        assert all(np.array_equal(one, other) for one, other in zip(kept, again, strict=True))
