"""Primitives: the geometries of many buildings, checked together from rings to solids."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import shapely

from eaves.geometry.tolerance import PLANARITY, SNAP
from eaves.model import Finding, Integers, Mask
from eaves.validate.codes import make_finding
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
    triangulate,
    why_invalid,
)
from eaves.validate.shells import check_shells, composite_defects, solid_defects, solids_overlap

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
