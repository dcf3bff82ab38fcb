"""Closed shells of whole millimetres, and a CityJSON document of a solid."""

from __future__ import annotations

from typing import Any

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


def tent(corners: Ring, apex: Point) -> Shell:
    """The sloping faces of a pyramid over a counter-clockwise ring, without its base."""
    count = len(corners)
    return [[[corners[k], corners[(k + 1) % count], apex]] for k in range(count)]


def dented_box(depth: int) -> Shell:
    """A box of 1 m whose top is a pit with its lowest point `depth` above the base."""
    whole = box(0, 0, 0, 1000, 1000, 1000)
    return [whole[0], *whole[2:], *tent(whole[1][0], (500, 500, depth))]


def city_of(shell: Shell, **more: Any) -> dict[str, Any]:
    """A CityJSON document with one building of a solid; the points become vertex numbers."""
    numbers: dict[Point, int] = {}
    faces = [[[numbers.setdefault(p, len(numbers)) for p in ring] for ring in face] for face in shell]
    solid = {"type": "Solid", "lod": "2.2", "boundaries": [faces], **more}
    return {
        "type": "CityJSON",
        "version": "2.0",
        "transform": {"scale": [0.001, 0.001, 0.001], "translate": [85000.0, 447000.0, 0.0]},
        "CityObjects": {"building": {"type": "Building", "geometry": [solid]}},
        "vertices": [list(point) for point in numbers],
    }
