"""The codes of `validate`: val3dity's numbers and names, each with the rule it stands for."""

from __future__ import annotations

from eaves.model import Finding

RULES: dict[int, tuple[str, str]] = {
    101: ("TOO_FEW_POINTS", "A ring has at least three points."),
    102: ("CONSECUTIVE_POINTS_SAME", "Two consecutive points of a ring are not at the same place."),
    103: (
        "RING_NOT_CLOSED",
        "First and last point are the same place.",
    ),
    104: ("RING_SELF_INTERSECTION", "A ring does not cross, touch or retrace itself on its polygon's plane."),
    201: ("INTERSECTION_RINGS", "The rings of a polygon do not cross and do not share a line."),
    202: ("DUPLICATED_RINGS", "No two rings of a polygon are identical."),
    203: ("NON_PLANAR_POLYGON_DISTANCE_PLANE", "Every point is near the polygon's least-squares plane."),
    204: (
        "NON_PLANAR_POLYGON_NORMALS_DEVIATION",
        "A polygon's triangles have like normals: no fold.",
    ),
    205: ("POLYGON_INTERIOR_DISCONNECTED", "The interior of a polygon is one piece."),
    206: ("INNER_RING_OUTSIDE", "Inner rings lie inside the outer ring."),
    207: ("INNER_RINGS_NESTED", "No inner ring lies inside another one."),
    208: ("ORIENTATION_RINGS_SAME", "Inner rings run against the outer ring."),
    301: ("TOO_FEW_POLYGONS", "A shell has at least four polygons."),
    302: ("SHELL_NOT_CLOSED", "Every edge of a shell is shared by two polygons: it is watertight."),
    303: ("NON_MANIFOLD_CASE", "No edge has more than two polygons; those of a vertex form one umbrella."),
    305: ("MULTIPLE_CONNECTED_COMPONENTS", "The polygons of a shell are connected."),
    306: ("SHELL_SELF_INTERSECTION", "Polygons of a shell meet only in the edges and vertices they share."),
    307: ("POLYGON_WRONG_ORIENTATION", "All polygons of a shell face the same side."),
    401: ("INTERSECTION_SHELLS", "The shells of a solid neither cross nor share a part of a face."),
    402: ("DUPLICATED_SHELLS", "No two shells of a solid are identical."),
    403: ("INNER_SHELL_OUTSIDE", "Inner shells lie inside the outer shell."),
    404: ("SOLID_INTERIOR_DISCONNECTED", "The interior of a solid is one piece."),
    405: ("WRONG_ORIENTATION_SHELL", "The outer shell faces outwards, inner shells face the void."),
    501: ("INTERSECTION_SOLIDS", "The solids of a composite do not overlap."),
    502: ("DUPLICATED_SOLIDS", "No two solids of a composite are identical."),
    503: ("DISCONNECTED_SOLIDS", "The solids of a composite form one solid."),
    601: (
        "BUILDINGPARTS_OVERLAP",
        "The solids of a building, its parts and its installations do not overlap.",
    ),
    901: (
        "INVALID_INPUT_FILE",
        "The file is CityJSON; its boundaries name existing vertices.",
    ),
    902: ("EMPTY_PRIMITIVE", "A geometry has at least one surface."),
    914: ("DUPLICATE_KEY", "No object has two members of one name."),
    904: ("FORMAT_NOT_SUPPORTED", "The version of CityJSON is 1.0, 1.1 or 2.0."),
}
"""Code → (name, the rule that was broken). 903 (wrong parameters) raises ValueError instead."""


def make_finding(code: int, building: str, where: str, detail: str) -> Finding:
    """A Finding with the name that belongs to its code."""
    return Finding(code, RULES[code][0], building, where, detail)
