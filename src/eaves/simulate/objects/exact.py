"""Exact buildings and clouds: masses that make a building, its true faces, solid and points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Polygon
from shapely.affinity import affine_transform, translate

from eaves.geometry import COORDINATE_STEP
from eaves.model import BuildingModel, Footprint, Integers, Labels, PointCloud, RoofPlane, Solid, Values
from eaves.solids import close_cells, coverage_of, drop_straight_nodes, find_defect, split_crossings

Plane = tuple[float, float, float]
"""Coefficients (a, b, c) of z = a·x + b·y + c."""

SAME_PLANE = 1e-6
"""Coefficients nearer than this describe one plane."""

SLIVER_AREA_M2 = 1e-5
"""A cell smaller than this is a rounding of the 1 mm arrangement and joins its highest neighbour's plane."""

NARROWEST = 0.01
"""A face with a corner nearer than this (m) in plan to another corner or edge of it is refused: rounded to 1
mm, its triangles would no longer lie in its plane."""


@dataclass(frozen=True, eq=False)
class Mass:
    """A part of a building: the plan polygon of its eaves, and planes of which the lowest is its roof."""

    polygon: Polygon
    planes: tuple[Plane, ...]
    part: str = "main"

    def translated(self, angle: float, x: float, y: float, z: float) -> Mass:
        """The mass turned about the origin by `angle` (radians, counter-clockwise), then shifted (m)."""
        cos, sin = np.cos(angle), np.sin(angle)
        polygon = affine_transform(self.polygon, [cos, -sin, sin, cos, x, y])
        planes = []
        for a, b, c in self.planes:
            turned = a * cos - b * sin, a * sin + b * cos
            planes.append((turned[0], turned[1], c + z - turned[0] * x - turned[1] * y))
        return replace(self, polygon=polygon, planes=tuple(planes))

    def height_at(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Heights (N,) of the roof at (N, 2); minus infinity outside the polygon."""
        coefficients = np.array(self.planes)
        heights = (xy @ coefficients[:, :2].T + coefficients[:, 2]).min(axis=1)
        inside = shapely.intersects_xy(self.polygon, xy[:, 0], xy[:, 1])
        return np.where(inside, heights, -np.inf)


def roof_partition(masses: tuple[Mass, ...]) -> list[tuple[Polygon, Plane]]:
    """The faces of the highest of the masses: plan polygons that tile their union, each with its plane.

    The polygons share every node with their neighbours (1 mm grid), so that a solid can be closed over them.
    """
    faces = [face for mass in masses for face in _lowest_faces(mass)]
    lines = [shapely.boundary(polygon) for polygon, _, _ in faces]
    lines += [shapely.boundary(mass.polygon) for mass in masses]
    for (p, plane_p, mass_p), (q, plane_q, mass_q) in combinations(faces, 2):
        if mass_p is not mass_q:
            lines.append(_crossing(p, plane_p, q, plane_q))
    network = shapely.union_all(lines, grid_size=COORDINATE_STEP)
    cells = [cell for cell in shapely.get_parts(shapely.polygonize([network])) if cell.area > 0]
    by_plane: dict[tuple[int, ...], list[Polygon]] = {}
    planes: dict[tuple[int, ...], Plane] = {}
    for cell, plane in _planes_over(cells, masses):
        key = tuple(round(value / SAME_PLANE) for value in plane)
        by_plane.setdefault(key, []).append(cell)
        planes.setdefault(key, plane)
    partition = []
    for key in sorted(by_plane):
        union = shapely.coverage_union_all(by_plane[key])
        partition += [(part, planes[key]) for part in shapely.get_parts(union)]
    return sorted(
        partition, key=lambda face: (round(face[0].bounds[0], 3), round(face[0].bounds[1], 3), face[1])
    )


def _lowest_faces(mass: Mass) -> list[tuple[Polygon, Plane, Mass]]:
    """The polygons of one mass over which each of its planes is the lowest."""
    faces = []
    for number, plane in enumerate(mass.planes):
        polygon = mass.polygon
        for rank, rival in enumerate(mass.planes):
            if rank != number:
                polygon = shapely.intersection(polygon, _half_plane(plane, rival, mass.polygon))
        faces += [
            (part, plane, mass)
            for part in shapely.get_parts(polygon)
            if part.geom_type == "Polygon" and part.area > SLIVER_AREA_M2
        ]
    return faces


def _half_plane(plane: Plane, rival: Plane, over: Polygon) -> Polygon:
    """A rectangle, over `over`, of the places where `plane` lies under `rival`; empty or all if parallel."""
    a, b, c = (p - r for p, r in zip(plane, rival, strict=True))
    slope = float(np.hypot(a, b))
    west, south, east, north = over.bounds
    if slope < SAME_PLANE:
        return shapely.box(west, south, east, north) if c <= 0 else Polygon()
    x, y = (west + east) / 2, (south + north) / 2
    size = 2 * (east - west + north - south)
    distance = (a * x + b * y + c) / slope
    down, along = np.array([-a, -b]) / slope, np.array([-b, a]) / slope
    foot = np.array([x, y]) + distance * down
    far = foot + (size + abs(distance)) * down
    return Polygon([foot - size * along, foot + size * along, far + size * along, far - size * along])


def _crossing(p: Polygon, plane_p: Plane, q: Polygon, plane_q: Plane) -> shapely.Geometry:
    """The line on which two planes are equally high, inside both polygons; empty where there is none."""
    a, b, c = (u - v for u, v in zip(plane_p, plane_q, strict=True))
    slope = float(np.hypot(a, b))
    overlap = shapely.intersection(p, q)
    if slope < SAME_PLANE or overlap.area < SLIVER_AREA_M2:
        return LineString()
    west, south, east, north = overlap.bounds
    centre = np.array([(west + east) / 2, (south + north) / 2])
    foot = centre - (centre @ [a, b] + c) / slope**2 * np.array([a, b])
    along = np.array([-b, a]) / slope * (east - west + north - south)
    crossing: shapely.Geometry = shapely.intersection(LineString([foot - along, foot + along]), overlap)
    return crossing


def _planes_over(cells: list[Polygon], masses: tuple[Mass, ...]) -> list[tuple[Polygon, Plane]]:
    """Each cell that lies in a mass, with the plane that is the roof there."""
    inside = shapely.point_on_surface(np.array(cells, object))
    xy = np.column_stack([shapely.get_x(inside), shapely.get_y(inside)])
    heights = np.stack([mass.height_at(xy) for mass in masses])
    highest = np.argmax(heights, axis=0)
    result = []
    for number, cell in enumerate(cells):
        if np.isfinite(heights[highest[number], number]):
            planes = np.array(masses[highest[number]].planes)
            lowest = int(np.argmin(planes[:, :2] @ xy[number] + planes[:, 2]))
            result.append((cell, masses[highest[number]].planes[lowest]))
    return result


def extrude_partition(
    cells: Sequence[Polygon], face: Integers, planes: Sequence[Plane] | Values, base: float
) -> Solid:
    """The closed solid between the planes of roof faces and the level `base` (m).

    The cells (C,) of faces `face` (C,) tile the footprint and share their nodes. `Face.plane` of a roof face
    is its number.

    Raises
    ------
    ValueError
        When that is no sound solid in one piece: it would touch itself, say, or reach down to its base.
    """
    plan = coverage_of(np.array(cells, object), COORDINATE_STEP)
    if plan is None:
        raise ValueError("the roof faces do not tile the footprint")
    plan, names = drop_straight_nodes(*plan.merged(face))
    tops, floors = np.array(planes)[names], np.tile([0.0, 0.0, base], (len(names), 1))
    plan = split_crossings(plan, tops, floors)
    if shapely.minimum_clearance(plan.polygons()).min() < NARROWEST:
        raise ValueError("a face is narrower somewhere than rounding allows")
    stands = np.ones(len(names), bool)
    solids, touching = close_cells(plan, tops, floors, stands, names, range(len(planes)))
    defect = "it touches itself" if len(touching) else " ".join(map(find_defect, solids))
    if defect or len(solids) != 1:
        raise ValueError(f"not one sound solid: {defect or f'{len(solids)} pieces'}")
    return solids[0]


@dataclass(frozen=True, eq=False)
class ExactFace:
    """A roof face with its true plane.

    Parameters
    ----------
    polygon : shapely.Polygon
        Its extent in plan (local m).
    coefficients : (float, float, float)
        Its plane z = a·x + b·y + c.
    number : int
        Its number in the scene, from 1.

    Examples
    --------
    >>> import numpy as np
    >>> import shapely
    >>> from eaves.simulate import ExactFace
    >>> ExactFace(shapely.box(0, 0, 4, 4), (0.5, 0.0, 3.0), 1).height_at(np.array([[2.0, 1.0]])).tolist()
    [4.0]
    """

    polygon: Polygon
    coefficients: Plane
    number: int

    def height_at(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Heights (N,) of the plane at (N, 2 or 3)."""
        a, b, c = self.coefficients
        return np.asarray(a * xy[:, 0] + b * xy[:, 1] + c)


@dataclass(frozen=True, eq=False)
class ExactBuilding:
    """A building with its true outline and roof, in local metres about the scene's origin.

    Parameters
    ----------
    number : int
        Its number in the scene, from 1.
    kind : str
        `flat`, `gable`, `hip`, …
    footprint : shapely.Polygon
        Outline of the eaves, which is what a LiDAR cloud shows and what every reference model here stands on.
    walls : shapely.Polygon
        Outline of the walls, inside the footprint by the overhang.
    faces : tuple of ExactFace
        Its roof faces.
    base : float
        Lowest terrain (m) on the outline.
    shell : Solid or None
        For buildings of a city model: the surfaces that are scanned; its roof faces refer to `faces`.
    closed : Solid or None
        The closed solid with those roof faces, where there is one.
    name : str
        Id in the city model.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> building = nine_roofs_on_a_slope(density=1.0).buildings[0]
    >>> building.kind, round(building.footprint.area)
    ('flat', 216)
    """

    number: int
    kind: str
    footprint: Polygon
    walls: Polygon
    faces: tuple[ExactFace, ...]
    base: float
    shell: Solid | None = None
    closed: Solid | None = None
    name: str = ""

    @property
    def id(self) -> str:
        """The name, or `building_<number>` where there is none."""
        return self.name or f"building_{self.number}"

    def solid(self) -> Solid:
        """The closed solid: the faces, extruded straight down from the eaves to the base."""
        if self.shell is not None:
            return self.closed or self.shell
        planes = [face.coefficients for face in self.faces]
        cells = [face.polygon for face in self.faces]
        return extrude_partition(cells, np.arange(len(cells)), planes, self.base)

    def model(self, origin: tuple[float, float] = (0.0, 0.0)) -> BuildingModel:
        """The reference model: LoD 2.2, with the true planes."""
        none = np.zeros(0, np.int64)
        planes = tuple(RoofPlane(face.coefficients, none, 0.0, face.polygon) for face in self.faces)
        attributes = {"kind": self.kind, "number": self.number, "h_ground": self.base}
        footprint = Footprint(self.footprint, origin, self.id, attributes=attributes)
        return BuildingModel(footprint, {"2.2": (self.solid(),)}, planes, attributes)

    def translated(self, x: float, y: float) -> ExactBuilding:
        """The building in coordinates about an origin that lies (−x, −y) metres away."""
        faces = tuple(
            ExactFace(translate(face.polygon, x, y), _moved_plane(face.coefficients, x, y), face.number)
            for face in self.faces
        )
        return replace(
            self,
            footprint=translate(self.footprint, x, y),
            walls=translate(self.walls, x, y),
            faces=faces,
            shell=_moved_solid(self.shell, x, y),
            closed=_moved_solid(self.closed, x, y),
        )


def _moved_solid(solid: Solid | None, x: float, y: float) -> Solid | None:
    return None if solid is None else replace(solid, vertices=solid.vertices + np.array([x, y, 0.0]))


def _moved_plane(plane: Plane, x: float, y: float) -> Plane:
    a, b, c = plane
    return a, b, c - a * x - b * y


@dataclass(frozen=True, eq=False)
class ExactScene:
    """A cloud without classes, and the truth of each of its N points.

    Parameters
    ----------
    cloud : PointCloud
        The points.
    truth_class : ndarray (N,) of uint8
        LAS classes.
    building : ndarray (N,) of int32
        Number of the building, 0 for none.
    plane : ndarray (N,) of int32
        Number of the roof face, 0 where a point is not on a roof.
    buildings : tuple of ExactBuilding
        The buildings, in the cloud's local metres.
    strip : ndarray (N,) of uint16 or None
        Flight strip of each point, from 1.
    time_s : ndarray (N,) or None
        Time (s) of each pulse in its strip.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> scene = nine_roofs_on_a_slope(density=1.0)
    >>> len(scene.truth_class) == len(scene.cloud)
    True
    """

    cloud: PointCloud
    truth_class: NDArray[np.uint8]
    building: Labels
    plane: Labels
    buildings: tuple[ExactBuilding, ...]
    strip: NDArray[np.uint16] | None = None
    time_s: NDArray[np.float64] | None = None

    @property
    def faces(self) -> dict[int, ExactFace]:
        """Every roof face by its number."""
        return {face.number: face for building in self.buildings for face in building.faces}

    def placed(self, crs: str) -> ExactScene:
        """The scene, placed in a projected system (EPSG code, or a file with WKT or PROJJSON)."""
        from eaves.formats import parse_crs, system_of

        system = system_of(parse_crs(crs), "--crs", self.cloud.origin)
        return replace(self, cloud=self.cloud.with_(system=system))

    def classified(self) -> PointCloud:
        """The cloud with its true classes."""
        return self.cloud.with_(classification=self.truth_class)
