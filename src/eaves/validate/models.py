"""Building models, validated before they are written, on the coordinates that will be written."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import shapely

from eaves.geometry.rings import COORDINATE_STEP, PLANARITY, SNAP
from eaves.model import BuildingModel, Finding, Integers, Mask
from eaves.model.checks import check_type
from eaves.validate.polygons import (
    FALL_TOGETHER,
    LARGEST_EXTENT,
    Boundaries,
    Shell,
    Triangles,
    faces_with,
    faces_with_rings_alike,
    faces_with_short_rings,
    fit_planes,
    lay_flat,
    normal_deviations,
    on_planes,
    shadow_axes,
    tangled_faces,
    to_grid,
    triangulate,
    why_invalid,
)
from eaves.validate.shells import check_shells, composite_defects, solid_defects, solids_overlap

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


NORMALS_DEG = 20.0
"""Largest angle between the normals of two triangles of a polygon; val3dity's default `planarity_n_tol`."""

EVEN = 1e-6
"""Polygons whose points are this near (m) to their plane have no fold."""

SOLID_TYPES = ("Solid", "MultiSolid", "CompositeSolid")


@dataclass(frozen=True, eq=False)
class ReadPrimitive:
    """One geometry of one building: `solids` holds shells, the outer one first; surfaces are one shell."""

    building: str
    """Id of the city object."""
    family: str
    """Id of the building that the object belongs to: its own, or that of the building it is a part of."""
    lod: str
    type: str
    solids: list[list[Shell]]


@dataclass(frozen=True)
class Tolerances:
    """val3dity's tolerances.

    Parameters
    ----------
    snap : float
        Vertices nearer than this (m, > 0) are one.
    planarity : float
        Largest distance (m, > 0) of a vertex from the plane of its face.
    normals : float
        Largest angle (degrees, > 0) between the normals of the triangles of a face.

    Raises
    ------
    ValueError
        When a tolerance is not above 0.

    Examples
    --------
    >>> from eaves.validate import Tolerances
    >>> Tolerances(planarity=0.02).planarity
    0.02
    """

    snap: float = SNAP
    planarity: float = PLANARITY
    normals: float = NORMALS_DEG

    def __post_init__(self) -> None:
        for name in ("snap", "planarity", "normals"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"tolerance '{name}' is {getattr(self, name)}; give a positive number")


def check_primitives(
    primitives: list[ReadPrimitive], vertices: Integers, step: float, tolerances: Tolerances | None = None
) -> list[Finding]:
    """All findings of primitives on integer vertices (V, 3) of `step` metres, in the primitives' order."""
    return [finding for _, finding in find_defects(primitives, vertices, step, tolerances)]


def find_defects(
    primitives: list[ReadPrimitive], vertices: Integers, step: float, tolerances: Tolerances | None = None
) -> list[tuple[int, Finding]]:
    """The findings of `check_primitives`, each with the number of its primitive."""
    limits = tolerances or Tolerances()
    findings = [
        (number, make_finding(902, p.building, f"lod {p.lod}", f"a {p.type} without surfaces"))
        for number, p in enumerate(primitives)
        if not p.solids or any(not shells or not all(shells) for shells in p.solids)
    ]
    empty = {number for number, _ in findings}
    owners = [
        (number, solid, shell)
        for number, primitive in enumerate(primitives)
        if number not in empty
        for solid, shells in enumerate(primitive.solids)
        for shell in range(len(shells))
    ]
    if owners:
        boundaries = lay_flat([primitives[n].solids[o][s] for n, o, s in owners], vertices, step, limits.snap)
        findings += _check(primitives, owners, boundaries, limits)
    return sorted(findings, key=lambda entry: entry[0])


def _check(
    primitives: list[ReadPrimitive],
    owners: list[tuple[int, int, int]],
    boundaries: Boundaries,
    limits: Tolerances,
) -> list[tuple[int, Finding]]:
    """Findings with the number of their primitive, of shells that belong to (primitive, solid, shell)."""
    findings: list[tuple[int, Finding]] = []

    def report(code: int, shell: int, face: int, detail: str) -> None:
        number, solid, part = owners[shell]
        primitive = primitives[number]
        where = [f"lod {primitive.lod}"]
        where += [f"solid {solid}"] if len(primitive.solids) > 1 else []
        where += [f"shell {part}"] if len(primitive.solids[solid]) > 1 else []
        where += [f"polygon {face - boundaries.shells[shell]}"] if face >= 0 else []
        findings.append((number, make_finding(code, primitive.building, ", ".join(where), detail)))

    face_codes, triangles = check_faces(boundaries, limits)
    for face, (code, detail) in sorted(face_codes.items()):
        report(code, int(boundaries.shell_of_face[face]), face, detail)
    sound = np.ones(boundaries.shell_count, bool)
    sound[boundaries.shell_of_face[list(face_codes)]] = False
    solid_shells = np.array([primitives[number].type in SOLID_TYPES for number, _, _ in owners])
    corner = _corners(boundaries)
    for defect in check_shells(boundaries, triangles, np.flatnonzero(sound & solid_shells), corner):
        sound[defect.shell] = False
        report(defect.code, defect.shell, defect.face, defect.detail)
    findings += _check_solids(primitives, owners, boundaries, triangles, sound & solid_shells, corner)
    return findings


def check_faces(boundaries: Boundaries, limits: Tolerances) -> tuple[dict[int, tuple[int, str]], Triangles]:
    """Code and detail of every bad face, and the triangles of the good ones.

    The first defect of a face ends its check.
    """
    codes: dict[int, tuple[int, str]] = {}
    good = np.ones(len(boundaries.faces), bool)

    def condemn(bad: Mask, code: int, detail: str) -> None:
        codes.update((int(face), (code, detail)) for face in np.flatnonzero(good & bad))
        good[bad] = False

    far: Mask = np.any(boundaries.local > LARGEST_EXTENT, axis=1)
    condemn(faces_with(boundaries, far), 901, "the coordinates are too far apart to be a building")
    condemn(faces_with_short_rings(boundaries.faces), 101, "a ring of fewer than three points")
    following = boundaries.faces.following
    repeated = boundaries.points == boundaries.points[following]
    condemn(faces_with(boundaries, repeated), 102, "two consecutive points at one place")
    planes = fit_planes(boundaries)
    for face in np.flatnonzero(good & (planes.distance > limits.planarity)):
        codes[int(face)] = (203, f"a point is {planes.distance[face]:.3f} m from the polygon's plane")
    good[list(codes)] = False
    flat = on_planes(boundaries, planes)
    alike = np.abs(flat - flat[following]).max(axis=1) < FALL_TOGETHER
    condemn(faces_with(boundaries, alike), 104, "two points fall together on the polygon's plane")
    axes = shadow_axes(planes)[boundaries.face_of_point]
    shadow = np.take_along_axis(boundaries.local, axes, axis=1).astype(np.float64)
    faces = np.flatnonzero(good)
    if len(faces):
        polygons = boundaries.faces.polygons_at(shadow, good)
        same_way = faces_with_rings_alike(boundaries.faces, shadow)
        for position in np.flatnonzero(~shapely.is_valid(polygons)):
            codes[int(faces[position])] = why_invalid(polygons[position])
        for face in np.flatnonzero(good & same_way):
            if codes.get(int(face), (0, ""))[0] != 104:
                codes[int(face)] = (208, "an inner ring runs the same way round as the outer one")
        good[list(codes)] = False
    uneven = good & (planes.distance > EVEN)
    try:
        on_plane = triangulate(boundaries, flat, uneven)
    except shapely.errors.GEOSException:  # valid on two axes, and not on the plane it nearly lies on
        tangled = tangled_faces(boundaries, flat, uneven)
        codes |= {int(face): (104, "the polygon crosses itself on its plane") for face in tangled}
        good[tangled] = False
        on_plane = triangulate(boundaries, flat, uneven & good)
    deviation = np.rad2deg(normal_deviations(on_plane, len(boundaries.faces)))
    triangles = triangulate(boundaries, shadow, good)
    for face in np.flatnonzero(deviation > limits.normals):
        codes[int(face)] = (204, f"the normals of its triangles differ by {deviation[face]:.1f} degrees")
    return codes, triangles


def _corners(boundaries: Boundaries) -> Integers:
    """The lowest corner (S, 3) of each shell, in steps: what `local` was measured from."""
    corner = np.zeros((boundaries.shell_count, 3), np.int64)
    shell, first = np.unique(boundaries.shell_of_face[boundaries.face_of_point], return_index=True)
    corner[shell] = boundaries.vertices[boundaries.points[first]] - boundaries.local[first]
    return corner


def _check_solids(
    primitives: list[ReadPrimitive],
    owners: list[tuple[int, int, int]],
    boundaries: Boundaries,
    triangles: Triangles,
    sound: np.ndarray,
    corner: Integers,
) -> list[tuple[int, Finding]]:
    """Findings on solids, composites and the parts of buildings, among solids whose shells are all sound."""
    findings: list[tuple[int, Finding]] = []
    solids: dict[tuple[int, int], list[int]] = defaultdict(list)
    for shell, (number, solid, _) in enumerate(owners):
        solids[number, solid].append(shell)
    usable: dict[int, list[list[Integers]]] = defaultdict(list)
    for (number, solid), shells in solids.items():
        if not sound[shells].all():
            continue
        origin = corner[shells[0]]
        around = [
            triangles.of_faces(boundaries.shells[s], boundaries.shells[s + 1]).corners + (corner[s] - origin)
            for s in shells
        ]
        primitive = primitives[number]
        where = f"lod {primitive.lod}" + (f", solid {solid}" if len(primitive.solids) > 1 else "")
        defects = solid_defects(around)
        findings += [(number, make_finding(code, primitive.building, where, text)) for code, text in defects]
        if not defects:
            usable[number].append([shell + origin for shell in around])
    families: dict[tuple[str, str], list[int]] = defaultdict(list)
    for number in usable:
        primitive = primitives[number]
        families[primitive.family, primitive.lod].append(number)
        if primitive.type == "CompositeSolid" and len(usable[number]) > 1:
            defects = composite_defects(_about_one_origin(usable[number]))
            findings += [
                (number, make_finding(code, primitive.building, f"lod {primitive.lod}", text))
                for code, text in defects
            ]
    for (family, lod), members in families.items():
        for first, second in combinations(members, 2):
            if any(solids_overlap(*_about_one_origin([a, b])) for a in usable[first] for b in usable[second]):
                names = f"'{primitives[first].building}' and '{primitives[second].building}'"
                findings.append((first, make_finding(601, family, f"lod {lod}", f"{names} overlap")))
    return findings


def _about_one_origin(solids: list[list[Integers]]) -> list[list[Integers]]:
    """The solids moved together so that their lowest corner is the origin."""
    low = np.min([shell.reshape(-1, 3).min(axis=0) for shells in solids for shell in shells], axis=0)
    return [[shell - low for shell in shells] for shells in solids]


def validate_model(model: BuildingModel, tolerances: Tolerances | None = None) -> list[Finding]:
    """All findings of a model, on its coordinates rounded to the written grid; none means valid.

    Each part of a level of detail is checked as a solid, and the parts of one level against each other and,
    of the finest, against the objects on the roof. The levels appear in `where`, parts and objects by their
    number in `building`: `id/0`, `id/1`, …, `id/i1`, …

    Parameters
    ----------
    model : BuildingModel
        The building; coordinates in local metres.
    tolerances : Tolerances or None
        Limits for snapping, planarity and normals; None takes val3dity's defaults.

    Returns
    -------
    list of Finding
        Defects by val3dity's code numbers.

    Raises
    ------
    TypeError
        When `model` is no BuildingModel.
    ValueError
        When a vertex is not finite.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> eaves.validate_model(truth.buildings[0].model())
    []
    """
    check_type(model, BuildingModel, "model", "give the result of reconstruct_building that is no Failure")
    primitives, vertices = primitives_of(model)
    return check_primitives(primitives, vertices, COORDINATE_STEP, tolerances)


def find_invalid(models: Sequence[BuildingModel], tolerances: Tolerances | None = None) -> list[int]:
    """The numbers of the models that `validate_model` has findings of, all checked together: that takes half
    the time."""
    primitives: list[ReadPrimitive] = []
    vertices = [np.zeros((0, 3), np.int64)]
    count = 0
    for number, model in enumerate(models):
        geometries, places = primitives_of(model, count)
        primitives += [replace(geometry, family=str(number)) for geometry in geometries]
        vertices.append(places)
        count += len(places)
    defects = find_defects(primitives, np.concatenate(vertices), COORDINATE_STEP, tolerances)
    return sorted({int(primitives[number].family) for number, _ in defects})


def primitives_of(model: BuildingModel, first: int = 0) -> tuple[list[ReadPrimitive], Integers]:
    """The solids of a model, and their vertices (V, 3) in whole steps, which are counted from `first`."""
    primitives, vertices, count = [], [np.zeros((0, 3), np.int64)], first
    solids = [
        (lod, "" if len(parts) == 1 else f"/{number}", solid)
        for lod, parts in sorted(model.solids.items())
        for number, solid in enumerate(parts)
    ]
    solids += [
        (model.lod, f"/i{number}", installation.solid)
        for number, installation in enumerate(model.installations, 1)
    ]
    for lod, suffix, solid in solids:
        name = f"{model.footprint.id}{suffix}"
        if not np.isfinite(solid.vertices).all():
            raise ValueError(f"building '{name}' at lod {lod} has a vertex that is not finite")
        shell = [[[count + vertex for vertex in ring] for ring in face.rings] for face in solid.faces]
        primitives.append(ReadPrimitive(name, model.footprint.id, lod, "Solid", [[shell]]))
        vertices.append(to_grid(solid.vertices, COORDINATE_STEP))
        count += len(solid.vertices)
    return primitives, np.concatenate(vertices)
