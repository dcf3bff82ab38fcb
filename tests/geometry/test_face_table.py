"""Figures of faces are those of the shapes that they were made of."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.geometry.face_table import FaceTable
from eaves.simulate import nine_roofs_on_a_slope


def on_slope(*corners: tuple[float, float]) -> np.ndarray:
    """Corners on a plane that rises 3 m over 4 m to the east."""
    xy = np.array(corners, float)
    return np.column_stack([xy, 2.0 + 0.75 * xy[:, 0]])


SQUARE = on_slope((0, 0), (8, 0), (8, 8), (0, 8))
HOLE = on_slope((2, 2), (2, 4), (4, 4), (4, 2))
WALL = np.array([[0, 0, 0], [8, 0, 0], [8, 0, 3], [0, 0, 3.0]])
BOW = on_slope((0, 0), (8, 8), (8, 0), (0, 4))
TABLE = FaceTable.of([[SQUARE, HOLE], [WALL], [SQUARE[::-1] * [1, 1, 0]]])


def test_a_slope_with_a_hole_has_the_figures_of_its_plane() -> None:
    assert TABLE.areas == pytest.approx([60.0 / 0.8, 24.0, 64.0])
    assert TABLE.slopes_deg == pytest.approx([np.degrees(np.arctan(0.75)), 90.0, 180.0])
    assert TABLE.azimuths_deg[0] == 270.0
    assert TABLE.planes[0] == pytest.approx([0.75, 0.0, 2.0])
    assert [low_high[0] for low_high in TABLE.heights] == [2.0, 8.0]
    assert TABLE.polygons()[0].area == pytest.approx(60.0)


def test_a_section_is_the_plan_of_what_lies_above() -> None:
    # the slope reaches z = 5 at x = 4, z = 6.5 at x = 6: east of the hole, whose eastern side it touches
    # first
    slope = FaceTable.of([[SQUARE, HOLE]])
    assert [slope.section_area(height) for height in (1.0, 4.25, 5.0, 6.5, 9.0)] == pytest.approx(
        [60.0, 8 * 5 - 2, 32.0, 16.0, 0.0]
    )


def test_an_upright_face_has_no_height_over_a_place() -> None:
    assert np.isnan(TABLE.planes[1]).all()


def test_what_is_level_falls_to_no_side() -> None:
    level = FaceTable.of([[SQUARE * [1, 1, 0]]])
    assert level.slopes_deg[0] == 0.0 and np.isnan(level.azimuths_deg[0])


def test_tables_are_taken_apart_joined_and_moved() -> None:
    parts = [TABLE.take(np.arange(3) == number) for number in range(3)]
    again = FaceTable.join(parts).moved(np.array([0.0, 0.0, 1.0]))
    assert [len(again.rings_of(face)) for face in range(3)] == [2, 1, 1]
    assert (again.rings_of(0)[1] == HOLE + [0, 0, 1]).all()


def test_triangles_fill_a_face_and_look_outwards() -> None:
    corner, face = TABLE.triangles()
    places = TABLE.corners[corner]
    normal = 0.5 * np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0])
    for number, vector in enumerate(TABLE.vectors):
        assert normal[face == number].sum(axis=0) == pytest.approx(vector)
        assert (normal[face == number] @ vector > 0.0).all()


def test_triangles_at_mirrored_places_run_around_as_their_rings_do() -> None:
    slope = TABLE.take(np.array([True, False, False]))
    places = slope.corners[:, :2] * [-1.0, 1.0]
    corner, _ = slope.cut(places, slope.polygons_at(places), np.array([0]))
    assert slope.ring_areas_at(places).tolist() == [-128.0, 8.0]
    a, b, c = places[corner].transpose(1, 0, 2)
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert area.sum() == -60.0 and area.max() < 0.0


def test_a_face_that_crosses_itself_is_a_fan__one_without_area_is_nothing() -> None:
    line = on_slope((0, 0), (4, 0), (8, 0))
    corner, face = FaceTable.of([[BOW], [line], [SQUARE]]).triangles()
    assert corner[:2].tolist() == [[0, 1, 2], [0, 2, 3]]
    assert face.tolist() == [0, 0, 2, 2]


def test_faces_of_a_solid_enclose_its_volume() -> None:
    house = next(one for one in nine_roofs_on_a_slope(density=1.0).buildings if one.kind == "flat")
    (solid,) = house.model().solids["2.2"]
    table = FaceTable.of_solids([solid])
    height = np.ptp(solid.vertices[:, 2])
    assert table.volume == pytest.approx(house.footprint.area * height)
    assert len(FaceTable.of_solids([solid], "RoofSurface")) == 1


def test_no_faces_have_no_figures() -> None:
    nothing = FaceTable.of([])
    assert not nothing and nothing.volume == 0.0
    assert (
        len(nothing.areas)
        == len(nothing.planes)
        == len(nothing.polygons())
        == len(nothing.triangles()[0])
        == 0
    )
