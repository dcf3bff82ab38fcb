"""Writes the files of tests/validate/files: for each code one that fails and one that is barely valid.

Run `python -m tests.validate.make_files`. Coordinates are millimetres; the transform makes metres of them.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

FILES = Path(__file__).parent / "files"

Point = tuple[int, int, int]
Ring = list[Point]
Face = list[Ring]
Shell = list[Face]


def prism(outline: list[tuple[int, int]], low: int, high: int) -> Shell:
    """A closed shell over a counter-clockwise outline."""
    top = [(x, y, high) for x, y in outline]
    base = [(x, y, low) for x, y in outline]
    count = len(outline)
    walls = [[[base[k], base[(k + 1) % count], top[(k + 1) % count], top[k]]] for k in range(count)]
    return [[base[::-1]], [top], *walls]


def box(west: int, south: int, low: int, east: int, north: int, high: int) -> Shell:
    """A closed shell: the faces of a box, base first, top second."""
    return prism([(west, south), (east, south), (east, north), (west, north)], low, high)


def inside_out(shell: Shell) -> Shell:
    """The shell facing the other way."""
    return [[ring[::-1] for ring in face] for face in shell]


def square(west: int, south: int, east: int, north: int, height: int = 0) -> Ring:
    """A counter-clockwise ring."""
    return [(west, south, height), (east, south, height), (east, north, height), (west, north, height)]


def tent(corners: Ring, apex: Point) -> Shell:
    """The sloping faces of a pyramid over a counter-clockwise ring, without its base."""
    count = len(corners)
    return [[[corners[k], corners[(k + 1) % count], apex]] for k in range(count)]


def dented_box(depth: int) -> Shell:
    """A box of 1 m whose top is a pit with its lowest point `depth` above the base."""
    whole = box(0, 0, 0, 1000, 1000, 1000)
    return [whole[0], *whole[2:], *tent(whole[1][0], (500, 500, depth))]


def geometry(kind: str, boundaries: Any, lod: str = "2.2") -> dict[str, Any]:
    return {"type": kind, "lod": lod, "boundaries": boundaries}


def solid(shell: Shell, *voids: Shell) -> dict[str, Any]:
    return geometry("Solid", [shell, *voids])


def surface(*faces: Face) -> dict[str, Any]:
    return geometry("MultiSurface", list(faces))


def city(*geometries: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """A CityJSON document with one building of these geometries; the points become vertex numbers."""
    return city_of({"building": {"type": "Building", "geometry": list(geometries)}}, **changes)


def city_of(objects: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """A CityJSON document of city objects whose boundaries hold points."""
    numbers: dict[Point, int] = {}

    def number(value: Any) -> Any:
        if isinstance(value, tuple):
            return numbers.setdefault(value, len(numbers))
        return [number(item) for item in value] if isinstance(value, list) else value

    written = {
        name: {
            **item,
            "geometry": [{**g, "boundaries": number(g["boundaries"])} for g in item.get("geometry", [])],
        }
        for name, item in objects.items()
    }
    return {
        "type": "CityJSON",
        "version": "2.0",
        "transform": {"scale": [0.001, 0.001, 0.001], "translate": [85000.0, 447000.0, 0.0]},
        "CityObjects": written,
        "vertices": [list(point) for point in numbers],
        **changes,
    }


def parts(*solids: dict[str, Any], kind: str = "BuildingPart", own: Sequence[Any] = ()) -> dict[str, Any]:
    """A document with a building, with solids of its `own`, and several BuildingParts or other children."""
    names = [f"part {number}" for number in range(len(solids))]
    objects: dict[str, Any] = {"building": {"type": "Building", "children": names, "geometry": list(own)}}
    for name, item in zip(names, solids, strict=True):
        objects[name] = {"type": kind, "parents": ["building"], "geometry": [item]}
    return city_of(objects)


CUBE = box(0, 0, 0, 1000, 1000, 1000)
TETRAHEDRON: Shell = [
    [[(0, 0, 0), (0, 1000, 0), (1000, 0, 0)]],
    [[(0, 0, 0), (1000, 0, 0), (0, 0, 1000)]],
    [[(1000, 0, 0), (0, 1000, 0), (0, 0, 1000)]],
    [[(0, 1000, 0), (0, 0, 0), (0, 0, 1000)]],
]
PLATE = square(0, 0, 3000, 3000)


def hole(west: int, south: int, east: int, north: int) -> Ring:
    return square(west, south, east, north)[::-1]


def folded(rise: int) -> dict[str, Any]:
    """A strip of two metres with a crease: its far edge, 20 mm beyond, lies `rise` mm higher."""
    return surface(
        [[(0, 0, 0), (2000, 0, 0), (2000, 1000, 0), (2000, 1020, rise), (0, 1020, rise), (0, 1000, 0)]]
    )


def bent(rise: int) -> dict[str, Any]:
    """A square with one corner lifted: every corner is a quarter of `rise` from the mean plane."""
    return surface([[(0, 0, 0), (1000, 0, 0), (1000, 1000, rise), (0, 1000, 0)]])


def apex_to_apex(gap: int) -> list[Shell]:
    """Two pyramids, one standing on the other's apex, `gap` apart."""
    low, high = square(0, 0, 1000, 1000, 0), square(0, 0, 1000, 1000, 2000 + gap)
    apex, above = (500, 500, 1000), (500, 500, 1000 + gap)
    upper = inside_out(tent(high, above))
    return [[[low[::-1]], *tent(low, apex)], [[high], *upper]]


def cavity(reach: int) -> list[Shell]:
    """A box with a void: a pyramid whose base edges lie in its walls, and whose apex is `reach` below its
    top.

    With the base ring on the walls the void cuts the box's inside in two, except where it stays off the
    walls.
    """
    base = square(reach, reach, 4000 - reach, 4000 - reach, 1000)
    return [box(0, 0, 0, 4000, 4000, 4000), inside_out([[base[::-1]], *tent(base, (2000, 2000, 3000))])]


def meaning(count: int) -> dict[str, Any]:
    """Semantics of a shell for so many faces."""
    return {"surfaces": [{"type": "WallSurface"}], "values": [[0] * count]}


def documents() -> dict[str, dict[str, Any]]:
    """File name without ending → document."""
    west, east = box(0, 0, 0, 1000, 1000, 1000), box(1000, 0, 0, 2000, 1000, 1000)
    corner = [
        (0, 0),
        (1002, 0),
        (1002, 998),
        (2000, 998),
        (2000, 2000),
        (1000, 2000),
        (1000, 1000),
        (0, 1000),
    ]
    stub = [(0, 0, 0), (1000, 0, 0)]
    close = [(0, 0), (1000, 0), (1000, 1000), (2, 1000), (0, 1000)]
    needle = [(0, 0, 0), (2000, 0, 0), (2000, 1000, 0), (1000, 1, 0), (0, 1000, 0)]
    bow = [(0, 0, 0), (1000, 1000, 0), (1000, 0, 0), (0, 1000, 0)]
    room = box(0, 0, 0, 4000, 4000, 4000)
    first, second = apex_to_apex(0)
    void_at_wall = inside_out(box(0, 1000, 1000, 1000, 2000, 2000))
    diamond: Ring = [(0, 1500, 0), (1500, 3000, 0), (3000, 1500, 0), (1500, 0, 0)]
    lonely: Ring = [(1, 1500, 0), (1500, 2999, 0), (2999, 1500, 0), (1500, 0, 0)]
    spike = inside_out(
        [
            [[(1000, 1000, 1000), (1000, 2000, 1000), (2000, 1000, 1000)]],
            *tent([(1000, 1000, 1000), (2000, 1000, 1000), (1000, 2000, 1000)], (1000, 1000, 4000)),
        ]
    )
    return {
        "101_too_few_points_invalid": city(solid([*CUBE[:-1], [stub]])),
        "101_too_few_points_valid": city(solid(TETRAHEDRON)),
        "102_consecutive_points_same_invalid": city(surface([[*PLATE, PLATE[-1]]])),
        "102_consecutive_points_same_near_invalid": city(
            solid(prism([(0, 0), (1000, 0), (1000, 1000), (1, 1000), (0, 1000)], 0, 1000))
        ),
        "102_consecutive_points_same_valid": city(solid(prism(close, 0, 1000))),
        "103_ring_not_closed_valid": city(surface([PLATE])),
        "104_ring_self_intersection_invalid": city(surface([bow])),
        "104_ring_self_intersection_touching_invalid": city(
            surface([[(x, 0 if y == 1 else y, z) for x, y, z in needle]])
        ),
        "104_ring_self_intersection_valid": city(surface([needle])),
        "201_intersection_rings_invalid": city(surface([PLATE, hole(2000, 1000, 4000, 2000)])),
        "201_intersection_rings_valid": city(
            surface([PLATE, [(3000, 1500, 0), (1000, 1000, 0), (1000, 2000, 0)]])
        ),
        "202_duplicated_rings_invalid": city(
            surface([PLATE, hole(1000, 1000, 2000, 2000), hole(1000, 1000, 2000, 2000)])
        ),
        "202_duplicated_rings_valid": city(
            surface([PLATE, hole(1000, 1000, 2000, 2000), hole(2000, 2000, 2500, 2500)])
        ),
        "203_non_planar_polygon_distance_plane_invalid": city(bent(41)),
        "203_non_planar_polygon_distance_plane_valid": city(bent(39)),
        "204_non_planar_polygon_normals_deviation_invalid": city(folded(8)),
        "204_non_planar_polygon_normals_deviation_valid": city(folded(7)),
        "205_polygon_interior_disconnected_invalid": city(surface([PLATE, diamond])),
        "205_polygon_interior_disconnected_valid": city(surface([PLATE, lonely])),
        "206_inner_ring_outside_invalid": city(surface([PLATE, hole(3001, 1000, 4000, 2000)])),
        "206_inner_ring_outside_valid": city(surface([PLATE, hole(1000, 1000, 2999, 2000)])),
        "207_inner_rings_nested_invalid": city(
            surface([PLATE, hole(1000, 1000, 2000, 2000), hole(1001, 1001, 1999, 1999)])
        ),
        "207_inner_rings_nested_valid": city(
            surface([PLATE, hole(1000, 1000, 2000, 2000), hole(2001, 1001, 2999, 1999)])
        ),
        "208_orientation_rings_same_invalid": city(surface([PLATE, square(1000, 1000, 2000, 2000)])),
        "208_orientation_rings_same_valid": city(surface([PLATE, hole(1000, 1000, 2000, 2000)])),
        "301_too_few_polygons_invalid": city(solid(TETRAHEDRON[:3])),
        "301_too_few_polygons_valid": city(solid(TETRAHEDRON)),
        "302_shell_not_closed_invalid": city(solid(CUBE[1:])),
        "302_shell_not_closed_valid": city(
            solid(
                [
                    [CUBE[1][0], square(400, 400, 600, 600, 1000)[::-1]],
                    [square(400, 400, 600, 600, 1000)],
                    CUBE[0],
                    *CUBE[2:],
                ]
            )
        ),
        "303_non_manifold_case_edge_invalid": city(solid([*CUBE, *box(1000, 1000, 0, 2000, 2000, 1000)])),
        "303_non_manifold_case_vertex_invalid": city(solid([*first, *second])),
        "303_non_manifold_case_valid": city(solid(prism(corner, 0, 1000))),
        "305_multiple_connected_components_invalid": city(solid([*CUBE, *box(1002, 0, 0, 2000, 1000, 1000)])),
        "305_multiple_connected_components_valid": city_of(
            {
                "a": {
                    "type": "GenericCityObject",
                    "geometry": [geometry("MultiSolid", [[CUBE], [box(1002, 0, 0, 2000, 1000, 1000)]])],
                }
            }
        ),
        "306_shell_self_intersection_invalid": city(solid(dented_box(-1))),
        "306_shell_self_intersection_touching_invalid": city(solid(dented_box(0))),
        "306_shell_self_intersection_valid": city(solid(dented_box(1))),
        "307_polygon_wrong_orientation_invalid": city(solid([*CUBE[:-1], [CUBE[-1][0][::-1]]])),
        "307_polygon_wrong_orientation_valid": city(solid(CUBE)),
        "401_intersection_shells_invalid": city(
            solid(room, inside_out(box(1000, 1000, 1000, 2000, 2000, 4001)))
        ),
        "401_intersection_shells_shared_face_invalid": city(solid(room, void_at_wall)),
        "401_intersection_shells_valid": city(solid(room, spike)),
        "402_duplicated_shells_invalid": city(
            solid(
                room,
                inside_out(box(1000, 1000, 1000, 2000, 2000, 2000)),
                inside_out(box(1000, 1000, 1000, 2000, 2000, 2000)),
            )
        ),
        "402_duplicated_shells_valid": city(
            solid(
                room,
                inside_out(box(1000, 1000, 1000, 2000, 2000, 2000)),
                inside_out(box(2000, 2000, 2000, 3000, 3000, 3000)),
            )
        ),
        "403_inner_shell_outside_invalid": city(
            solid(room, inside_out(box(4001, 1000, 1000, 5000, 2000, 2000)))
        ),
        "403_inner_shell_outside_valid": city(
            solid(room, inside_out(box(1000, 1000, 1000, 3999, 2000, 2000)))
        ),
        "404_solid_interior_disconnected_invalid": city(solid(*cavity(0))),
        "404_solid_interior_disconnected_valid": city(solid(*cavity(1))),
        "405_wrong_orientation_shell_invalid": city(solid(inside_out(CUBE))),
        "405_wrong_orientation_shell_void_invalid": city(
            solid(room, box(1000, 1000, 1000, 2000, 2000, 2000))
        ),
        "405_wrong_orientation_shell_valid": city(
            solid(room, inside_out(box(1000, 1000, 1000, 2000, 2000, 2000)))
        ),
        "501_intersection_solids_invalid": city(
            geometry("CompositeSolid", [[west], [box(999, 0, 0, 2000, 1000, 1000)]])
        ),
        "501_intersection_solids_valid": city(geometry("CompositeSolid", [[west], [east]])),
        "502_duplicated_solids_invalid": city(geometry("CompositeSolid", [[west], [west]])),
        "502_duplicated_solids_valid": city_of(
            {"a": {"type": "GenericCityObject", "geometry": [geometry("MultiSolid", [[west], [west]])]}}
        ),
        "503_disconnected_solids_invalid": city(
            geometry("CompositeSolid", [[west], [box(1002, 0, 0, 2000, 1000, 1000)]])
        ),
        "503_disconnected_solids_valid": city(geometry("CompositeSolid", [[west], [east]])),
        "601_buildingparts_overlap_invalid": parts(solid(west), solid(box(999, 0, 0, 2000, 1000, 1000))),
        "601_buildingparts_overlap_cross_invalid": parts(
            solid(box(0, 1000, 0, 3000, 2000, 1000)), solid(box(1000, 0, 0, 2000, 3000, 1000))
        ),
        "601_buildingparts_overlap_inside_invalid": parts(
            solid(room), solid(box(1000, 1000, 1000, 2000, 2000, 2000))
        ),
        "601_buildingparts_overlap_installation_invalid": parts(
            solid(box(200, 200, 999, 800, 800, 2000)), kind="BuildingInstallation", own=[solid(CUBE)]
        ),
        "601_buildingparts_overlap_installation_valid": parts(
            solid(box(200, 200, 1000, 800, 800, 2000)), kind="BuildingInstallation", own=[solid(CUBE)]
        ),
        "601_buildingparts_overlap_valid": parts(solid(west), solid(box(1000, 500, 0, 2000, 1500, 2000))),
        "901_invalid_input_file_invalid": city(solid(CUBE), vertices=[[0, 0, 0]]),
        "901_invalid_input_file_valid": city(solid(CUBE)),
        "902_empty_primitive_invalid": city(solid([])),
        "902_empty_primitive_valid": city(),
        "911_unknown_type_invalid": city_of({"a": {"type": "House", "geometry": [solid(CUBE)]}}),
        "911_unknown_type_valid": city_of(
            {"a": {"type": "+House", "geometry": [solid(CUBE)]}},
            extensions={"Houses": {"url": "houses.ext.json", "version": "1.0"}},
        ),
        "912_broken_reference_invalid": city_of({"a": {"type": "Building", "children": ["b"]}}),
        "912_broken_reference_valid": city_of(
            {"a": {"type": "Building", "children": ["b"]}, "b": {"type": "BuildingPart", "parents": ["a"]}}
        ),
        "913_invalid_semantics_invalid": city({**solid(CUBE), "semantics": meaning(7)}),
        "913_invalid_semantics_valid": city({**solid(CUBE), "semantics": meaning(len(CUBE))}),
        "915_invalid_structure_invalid": city_of({"a": {"type": "Building", "attributes": []}}),
        "915_invalid_structure_valid": city_of({"a": {"type": "Building", "attributes": {}}}),
        "904_format_not_supported_invalid": city(solid(CUBE), version="0.9"),
        "904_format_not_supported_valid": city(solid(CUBE), version="1.0"),
    }


def main() -> None:
    FILES.mkdir(exist_ok=True)
    for name, document in documents().items():
        text = json.dumps(document, separators=(",", ":"))
        (FILES / f"{name}.city.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
