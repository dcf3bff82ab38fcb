"""Building models are validated on the grid they will be written on."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from eaves.model import BuildingModel, Face, Footprint, Solid
from eaves.validate import validate_model
from tests.validate.made_shells import Shell, box, dented_box, inside_out, prism


def solid_of(shell: Shell, origin: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Solid:
    numbers: dict[tuple[int, int, int], int] = {}
    faces = tuple(
        Face(
            tuple(tuple(numbers.setdefault(point, len(numbers)) for point in ring) for ring in face),
            "WallSurface",
        )
        for face in shell
    )
    return Solid.of(np.array(list(numbers), float) / 1000 + origin, faces)


def model_of(**solids: tuple[Solid, ...]) -> BuildingModel:
    footprint = Footprint(shapely.box(0, 0, 1, 1), id="house")
    return BuildingModel(footprint, {name[1:].replace("_", "."): parts for name, parts in solids.items()})


CUBE = box(0, 0, 0, 1000, 1000, 1000)


def test_a_box_is_valid() -> None:
    assert validate_model(model_of(l2_2=(solid_of(CUBE),))) == []


def test_a_model_without_solids_is_valid() -> None:
    assert validate_model(model_of()) == []


def test_an_inside_out_box_is_found_at_its_level_only() -> None:
    findings = validate_model(model_of(l1_2=(solid_of(CUBE),), l2_2=(solid_of(inside_out(CUBE)),)))
    assert [(f.code, f.building, f.where) for f in findings] == [(405, "house", "lod 2.2")]


def test_parts_that_share_a_wall_do_not_overlap() -> None:
    parts = solid_of(CUBE), solid_of(box(1000, 0, 0, 2000, 1000, 2000))
    assert validate_model(model_of(l2_2=parts)) == []


def test_parts_that_overlap_by_a_millimetre_are_found() -> None:
    parts = solid_of(CUBE), solid_of(box(999, 0, 0, 2000, 1000, 2000))
    assert [f.code for f in validate_model(model_of(l2_2=parts))] == [601]


def test_rounding_to_the_grid_can_make_a_model_invalid() -> None:
    pit = solid_of(dented_box(1))
    assert validate_model(model_of(l2_2=(pit,))) == []
    lower = pit.vertices.copy()
    lower[np.isclose(lower[:, 2], 0.001), 2] = 0.0004
    assert [f.code for f in validate_model(model_of(l2_2=(Solid.of(lower, pit.faces),)))] == [306] * 4


def test_corners_on_one_oblique_line_make_no_self_intersection() -> None:
    """Once cut into triangles across a third corner, the base of this house met walls it only touches."""
    # fmt: off
    outline = [
        (5184, 2027), (6674, 2206), (6853, 717), (8342, 896), (8163, 2385), (7984, 3875), (7805, 5364),
        (7625, 6853), (7446, 8342), (5957, 8163), (4468, 7984), (4647, 6495), (4826, 5006), (3337, 4826),
        (3158, 6316), (2979, 7805), (1489, 7626), (0, 7447), (179, 5957), (1668, 6137), (1848, 4647),
        (358, 4468), (537, 2979), (2027, 3158), (2206, 1669), (717, 1490), (896, 0), (2385, 179),
        (3874, 359), (3695, 1848),
    ]
    # fmt: on
    assert shapely.Polygon(outline).is_valid
    assert validate_model(model_of(l2_2=(solid_of(prism(outline, 0, 3000)),))) == []


def test_a_vertex_that_is_not_finite_is_refused() -> None:
    bad = solid_of(CUBE)
    vertices = bad.vertices.copy()
    vertices[0, 2] = np.nan
    with pytest.raises(ValueError, match="house"):
        validate_model(model_of(l2_2=(Solid.of(vertices, bad.faces),)))


@pytest.mark.parametrize("seed", range(5))
def test_a_turned_box_is_valid_wherever_it_stands(seed: int) -> None:
    rng = np.random.default_rng(seed)
    box_ = solid_of(CUBE)
    angle = rng.uniform(0, 2 * np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    moved = box_.vertices * [9.7, 5.3, 4.1] @ turn.T + rng.uniform(-5e5, 5e5, 3)
    assert validate_model(model_of(l2_2=(Solid.of(moved, box_.faces),))) == []


def test_a_face_that_crosses_itself_on_its_plane_alone_is_found() -> None:
    steep = ((28660, 16160, 15964), (19096, 20617, 17868), (19096, 20617, 17855), (35266, 24492, 16774))
    findings = validate_model(model_of(l2_2=(solid_of([*CUBE, [list(steep)]]),)))
    assert [finding.code for finding in findings] == [104]
