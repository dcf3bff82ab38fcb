"""What is proved sound by a loop is sound by polygons and their triangles, too."""

from __future__ import annotations

import numpy as np

from eaves.geometry.face_table import FaceTable
from eaves.geometry.rings import PLANARITY
from eaves.model.building import GROUND_SURFACE, ROOF_SURFACE
from eaves.solids.soundness import FLATTEST_SHARE, fold_defect, on_own_plane, plan_defect, surely_sound

SURFACES = np.array([GROUND_SURFACE, ROOF_SURFACE])


def tent(rng: np.random.Generator) -> FaceTable:
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
    return FaceTable.of([[(top * [1.0, 1.0, 0.0])[::-1]], [top]])


def test_faces_proved_sound_have_no_defect() -> None:
    rng = np.random.default_rng(8)
    clear, steady, sloped = 0, 0, 0
    for _ in range(1500):
        faces = tent(rng)
        is_clear, unsure = surely_sound(faces, SURFACES)
        assert 0 not in unsure
        clear += is_clear
        sloped += faces.ring_sizes[1] > 3
        if is_clear:
            assert plan_defect(faces) == ""
        if not unsure and plan_defect(faces) == "" and faces.ring_sizes[1] > 3:
            steady += 1
            flat = {1: on_own_plane(faces.rings_of(1))}
            assert np.abs(flat[1][:, 2]).max() <= FLATTEST_SHARE * PLANARITY
            assert not fold_defect(faces, flat)
    assert clear > 500 and steady > 0.2 * sloped


def test_plain_plans_are_all_proved_clear() -> None:
    rng = np.random.default_rng(9)
    found = [tent(rng) for _ in range(400)]
    sound = [faces for faces in found if plan_defect(faces) == ""]
    assert np.mean([surely_sound(faces, SURFACES)[0] for faces in sound]) > 0.95
