"""The roofs are what they are said to be, their solids are closed, and every point knows its truth."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
import shapely

from eaves.model import Solid
from eaves.simulate.objects.exact import Mass, roof_partition
from eaves.simulate.objects.houses import (
    chimney,
    flat,
    flat_dormer,
    gable,
    gable_dormer,
    gambrel,
    hip,
    make_building,
    mansard,
    nine_roofs_on_a_slope,
    nine_shapes,
    plan_rectangle,
    pyramid,
    shed,
    shifted_masses,
    wing,
)

SHAPES: dict[str, tuple[tuple[Mass, ...], int]] = {
    "flat": (flat(10, 8), 1),
    "parapet": (flat(10, 8, parapet=0.5), 2),
    "shed": (shed(10, 8, 0.3), 1),
    "gable": (gable(10, 8, 0.8), 2),
    "asymmetric": (gable(10, 8, 0.8, ridge_at=0.3), 2),
    "hip": (hip(12, 8, 0.8), 4),
    "half-hip": (hip(12, 8, 0.8, start=0.5), 4),
    "pyramid": (pyramid(9, 0.6), 4),
    "gambrel": (gambrel(12, 9, 1.8, 0.5, 1.2), 4),
    "mansard": (mansard(14, 10, 2.0, 0.4, 1.2), 8),
    "T": (gable(16, 8, 0.8) + wing(11, 7, 0.8, 0.0, 1.0), 4),
    "X": (gable(16, 8, 0.8) + wing(9, 6, 0.8, 0.0, 1.0) + wing(9, 6, 0.8, 0.0, -1.0), 6),
    "chimney": ((*gable(10, 8, 0.8), chimney(2, 0, 4.5)), 3),
    "dormers": ((*gable(12, 8, 1.0), gable_dormer(-3, -3, 0, 2, 2.0, 0.7), flat_dormer(3, 3, 0, 2, 2.6)), 5),
}


def volume(solid: Solid) -> float:
    """Signed volume by the divergence theorem (m³)."""
    total = 0.0
    for face in solid.faces:
        for ring in face.rings:
            corners = solid.vertices[list(ring)]
            for p, q in pairwise(corners[1:]):
                total += float(np.dot(corners[0], np.cross(p, q))) / 6.0
    return total


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("angle", [0.0, 0.4, 2.0])
def test_solid_is_closed_and_holds_the_volume_under_its_roof(name: str, angle: float) -> None:
    masses, count = SHAPES[name]
    building = make_building(shifted_masses(masses, 31.7, 12.3, 5.0, angle), 1, 1, name, 0.0, 0.3)
    solid = building.solid()
    assert len(building.faces) == count
    below = sum(
        face.polygon.area * float(face.height_at(shapely.get_coordinates(face.polygon.centroid))[0])
        for face in building.faces
    )
    assert volume(solid) == pytest.approx(below, rel=2e-4)
    edges = Counter(edge for f in solid.faces for r in f.rings for edge in zip(r, r[1:] + r[:1], strict=True))
    assert set(edges.values()) == {1} and all((q, p) in edges for p, q in edges)
    for face in solid.faces:
        corners = solid.vertices[list(face.rings[0])]
        normal = np.linalg.svd(corners - corners.mean(axis=0))[2][2]
        assert np.abs((corners - corners.mean(axis=0)) @ normal).max() < 0.01


def test_partition_tiles_the_outline() -> None:
    masses = gable(16, 8, 0.8) + wing(11, 7, 0.8, 2.0, 1.0)
    faces = roof_partition(masses)
    outline = shapely.union_all([mass.polygon for mass in masses])
    assert sum(polygon.area for polygon, _ in faces) == pytest.approx(outline.area, abs=0.02)


def test_ridge_of_a_gable_lies_on_both_planes() -> None:
    front, back = gable(10, 8, 0.8)[0].planes
    assert front[2] == pytest.approx(3.2) and back[2] == pytest.approx(3.2)


def test_part_that_touches_in_a_point_is_refused() -> None:
    block = Mass(plan_rectangle(4, 4), ((0.0, 0.0, 3.0),))
    diagonal = Mass(plan_rectangle(4, 4, 4, 4), ((0.0, 0.0, 3.0),))
    with pytest.raises(ValueError, match="connected"):
        make_building((block, diagonal), 1, 1, "pair", 0.0, 0.0)


def test_nine_roofs_know_the_truth_of_each_point() -> None:
    scene = nine_roofs_on_a_slope(density=4.0, noise=0.0)
    assert [building.kind for building in scene.buildings] == [kind for kind, _ in nine_shapes()]
    faces = scene.faces
    assert set(np.unique(scene.plane)) == {0, *faces}
    for number, face in faces.items():
        on = scene.cloud.xyz[scene.plane == number]
        assert np.abs(on[:, 2] - face.height_at(on)).max() < 2e-4
    assert np.array_equal(scene.building > 0, scene.truth_class == 6)
    assert set(np.unique(scene.truth_class)) == {2, 6}
    for building in scene.buildings:
        assert building.model().lod == "2.2"


def test_same_seed_gives_the_same_points() -> None:
    one, two, other = (nine_roofs_on_a_slope(density=1.0, seed=seed) for seed in (3, 3, 4))
    assert np.array_equal(one.cloud.xyz, two.cloud.xyz)
    assert not np.array_equal(one.cloud.xyz, other.cloud.xyz)
