"""The nouns of one building: boundary, footprint, roof planes, solid, model, failure, finding."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.model.checks import Integers, Pictured, Points, Values

if TYPE_CHECKING:
    from shapely import Polygon

LODS = ("0", "1.2", "1.3", "2.0", "2.2", "2.3")
"""Levels of detail after Biljecki, Ledoux and Stoter 2016, coarse to fine."""

OVERHANGS = "2.3"
"""The level of detail with overhanging eaves."""

GROUND_SURFACE, WALL_SURFACE, ROOF_SURFACE = "GroundSurface", "WallSurface", "RoofSurface"
OUTER_CEILING_SURFACE = "OuterCeilingSurface"
"""The underside of an overhang or of a roof without walls."""
NO_PLANE = -1
"""`Solid.planes` of a face that belongs to no plane."""


@dataclass(frozen=True, eq=False)
class Boundary:
    """The raw outline of a set of points, before it is regularised.

    Parameters
    ----------
    rings : tuple of ndarray (M, 2)
        Closed rings (local m) without repeated last point: the outer one counter-clockwise, then holes
        clockwise.
    points : ndarray (N, 3)
        All points of the region (local m).
    spacing : float
        Mean distance (m) of the points in plan.
    not_last : ndarray (K, 3) or None
        Those of the points whose pulses have a later return; None where the scan does not say.
    ground : ndarray (K, 2) or None
        Ground points seen around them; None where that is not known.
    others : ndarray (K, 3) or None
        Points around them that are high and no building's.
    origin : (float, float)
        World metres of local (0, 0).

    Examples
    --------
    >>> import numpy as np
    >>> from eaves import Boundary
    >>> square = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
    >>> Boundary((square,), np.column_stack([square, np.full(4, 3.0)]), spacing=4.0).spacing
    4.0
    """

    rings: tuple[Values, ...]
    points: Points
    spacing: float
    not_last: Points | None = None
    ground: Points | None = None
    others: Points | None = None
    origin: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Footprint(Pictured):
    """The outline of one building.

    Parameters
    ----------
    polygon : shapely.Polygon
        A valid polygon, counter-clockwise, holes allowed, in local metres about `origin`.
    origin : (float, float)
        World metres of local (0, 0).
    id : str
        Identifier; empty until the building has one.
    score : float
        Confidence of the detector, 0 to 1.
    attributes : dict
        Further columns of the footprint.
    agreement : float or None
        Mean intersection over union, 0 to 1, with the outlines drawn through every second point of the
        boundary; None for an outline that was not drawn from points.

    Examples
    --------
    >>> import shapely
    >>> from eaves import Footprint
    >>> Footprint(shapely.box(0, 0, 10, 8), id="shed").polygon.area
    80.0
    """

    polygon: Polygon
    origin: tuple[float, float] = (0.0, 0.0)
    id: str = ""
    score: float = 1.0
    attributes: dict[str, Any] = field(default_factory=dict)
    agreement: float | None = None

    def __post_init__(self) -> None:
        # A precision grid is lost when a polygon is sent to another process, and overlays round to it: the
        # result must not depend on that.
        if shapely.get_precision(self.polygon):
            free = shapely.set_precision(self.polygon, 0.0, mode="pointwise")
            object.__setattr__(self, "polygon", free)

    @property
    def world(self) -> Polygon:
        """The polygon in world metres."""
        return shapely.transform(self.polygon, lambda xy: xy + np.array(self.origin))

    @property
    def area(self) -> float:
        """Area (m²) in plan."""
        return float(self.polygon.area)

    @property
    def __geo_interface__(self) -> dict[str, Any]:
        """The polygon in world metres, as shapely, geopandas and others take it."""
        return dict(self.world.__geo_interface__)

    def with_(self, **changes: Any) -> Footprint:
        """A copy with some fields replaced."""
        return replace(self, **changes)


@dataclass(frozen=True, eq=False)
class RoofPlane:
    """A plane z = a·x + b·y + c in local metres, and the points it was fitted to.

    Parameters
    ----------
    coefficients : (float, float, float)
        a, b and c (m).
    members : ndarray (K,) of int64
        Indices into the building's points.
    rmse : float
        Root mean square distance (m) of the members.
    polygon : shapely.Polygon or None
        Extent of the plane in plan, where known.

    Examples
    --------
    >>> import numpy as np
    >>> from eaves import RoofPlane
    >>> plane = RoofPlane((1.0, 0.0, 5.0), np.arange(3), rmse=0.02)
    >>> round(float(np.degrees(plane.slope)), 6)
    45.0
    """

    coefficients: tuple[float, float, float]
    members: Integers
    rmse: float
    polygon: Polygon | None = None

    def __repr__(self) -> str:
        slope, count = np.degrees(self.slope), len(self.members)
        return f"RoofPlane({self.coefficients}, slope {slope:.1f}°, {count} points, rmse {self.rmse:.3f} m)"

    @property
    def normal(self) -> Values:
        """Unit normal (3,), pointing up."""
        a, b, _ = self.coefficients
        return np.asarray(np.array([-a, -b, 1.0]) / np.sqrt(a * a + b * b + 1.0))

    @property
    def slope(self) -> float:
        """Radians from the horizontal."""
        a, b, _ = self.coefficients
        return float(np.arctan(np.hypot(a, b)))

    def height_at(self, xy: Values) -> Values:
        """Heights (N,) of the plane at (N, 2 or 3)."""
        a, b, c = self.coefficients
        return np.asarray(a * xy[:, 0] + b * xy[:, 1] + c)

    def distance_to(self, xyz: Points) -> Values:
        """Signed distances (N,) of points (N, 3) along the normal, positive above."""
        a, b, _ = self.coefficients
        return np.asarray((xyz[:, 2] - self.height_at(xyz)) / np.sqrt(a * a + b * b + 1.0))


@dataclass(frozen=True)
class Face:
    """One planar face of a solid.

    Parameters
    ----------
    rings : tuple of tuple of int
        Vertex numbers of the outer ring, counter-clockwise seen from outside, then of the holes.
    surface : str
        `GroundSurface`, `WallSurface`, `RoofSurface` or `OuterCeilingSurface`.
    plane : int or None
        For roof faces: index of the roof plane.

    Examples
    --------
    >>> from eaves import Face
    >>> Face(((0, 1, 2, 3),), "RoofSurface", plane=0).surface
    'RoofSurface'
    """

    rings: tuple[tuple[int, ...], ...]
    surface: str
    plane: int | None = None


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed, outward-oriented shell of F faces.

    Parameters
    ----------
    vertices : ndarray (V, 3)
        Coordinates in local metres, shared by the faces.
    corners : ndarray (C,) of int64
        The vertices of all rings, one ring behind the other.
    ring_sizes : ndarray (R,) of int64
        Number of corners of each ring.
    ring_counts : ndarray (F,) of int64
        Number of rings of each face; its outer ring is the first.
    surfaces : ndarray (F,) of str
        The surface of each face, as in `Face`.
    planes : ndarray (F,) of int64
        The plane of each face, as in `Face`; -1 for none.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> solid = nine_roofs_on_a_slope(density=1.0).buildings[0].model().solids["2.2"][0]
    >>> solid.vertices.shape, len(solid.faces), solid.faces[0].surface
    ((8, 3), 6, 'GroundSurface')
    """

    vertices: Points
    corners: Integers
    ring_sizes: Integers
    ring_counts: Integers
    surfaces: NDArray[np.str_]
    planes: Integers

    @classmethod
    def of(cls, vertices: Points, faces: Iterable[Face]) -> Solid:
        """The solid of vertices (V, 3) and of faces whose rings are numbers of these."""
        faces = tuple(faces)
        rings = [ring for face in faces for ring in face.rings]
        return cls(
            vertices,
            np.array([vertex for ring in rings for vertex in ring], np.int64),
            np.array([len(ring) for ring in rings], np.int64),
            np.array([len(face.rings) for face in faces], np.int64),
            np.array([face.surface for face in faces], np.str_),
            np.array([NO_PLANE if face.plane is None else face.plane for face in faces], np.int64),
        )

    @cached_property
    def faces(self) -> tuple[Face, ...]:
        """The faces, one by one."""
        corner = iter(self.corners.tolist())
        rings = iter([tuple(islice(corner, size)) for size in self.ring_sizes.tolist()])
        columns = self.ring_counts.tolist(), self.surfaces.tolist(), self.planes.tolist()
        return tuple(
            Face(tuple(islice(rings, count)), surface, None if plane == NO_PLANE else plane)
            for count, surface, plane in zip(*columns, strict=True)
        )

    def moved(self, shift: Values) -> Solid:
        """The solid moved by `shift` (3,) in metres."""
        return replace(self, vertices=self.vertices + shift)

    def __repr__(self) -> str:
        return f"Solid({len(self.vertices)} vertices, {len(self.ring_counts)} faces)"


EMPTY_SOLID = Solid.of(np.zeros((0, 3)), ())


@dataclass(frozen=True, eq=False)
class Installation:
    """An object on a roof that the building's solids leave out.

    Parameters
    ----------
    kind : str
        `chimney`, `dormer`, `plant` or `lift_housing`, by its size and the roof it stands on.
    polygon : Polygon
        Its outline, in metres about the footprint's origin.
    top : float
        Height of its top (m).
    height : float
        Median height of its points over the roof (m).
    points : int
        Points that show it.
    solid : Solid
        Its body: what stands over the building's solids, and shares no volume with them.

    Examples
    --------
    >>> import shapely
    >>> from eaves.model import Installation
    >>> Installation("chimney", shapely.box(0, 0, 1, 1), 9.5, 1.2, 20).solid.faces
    ()
    """

    kind: str
    polygon: Polygon
    top: float
    height: float
    points: int
    solid: Solid = EMPTY_SOLID


@dataclass(frozen=True, eq=False)
class BuildingModel(Pictured):
    """A building at one or more levels of detail.

    Parameters
    ----------
    footprint : Footprint
        Its outline; all coordinates count from `footprint.origin`.
    solids : dict of str to tuple of Solid
        Level of detail → parts: one, or several where one solid would touch itself.
    planes : tuple of RoofPlane
        The roof planes of the finest level.
    attributes : dict
        Heights, areas, volume, method and what else describes the building.
    installations : tuple of Installation
        Objects on the roof that are too small for the solids.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> nine_roofs_on_a_slope(density=1.0).buildings[0].model().lod
    '2.2'
    """

    footprint: Footprint
    solids: dict[str, tuple[Solid, ...]]
    planes: tuple[RoofPlane, ...] = ()
    attributes: dict[str, Any] = field(default_factory=dict)
    installations: tuple[Installation, ...] = ()

    @property
    def lod(self) -> str:
        """The finest level reached."""
        return max(self.solids, default="0")

    @property
    def world(self) -> dict[str, tuple[Solid, ...]]:
        """The solids with vertices in world metres."""
        shift = np.array([*self.footprint.origin, 0.0])
        return {lod: tuple(solid.moved(shift) for solid in parts) for lod, parts in self.solids.items()}

    def with_(self, **changes: Any) -> BuildingModel:
        """A copy with some fields replaced."""
        return replace(self, **changes)


@dataclass(frozen=True)
class Failure:
    """Why hard data gave no result. It is false, so `if not result:` reads well.

    Parameters
    ----------
    code : str
        Short and stable, listed in docs/errors.md: `too_few_points`, `no_plane`, `not_a_house`, …
    reason : str
        One sentence with the values that made it fail.
    stage : str
        The stage that failed: `outline`, `reconstruct`, …
    footprint : Footprint or None
        The outline of the building, where known.

    Examples
    --------
    >>> import numpy as np
    >>> import eaves
    >>> result = eaves.trace_outline(np.zeros((3, 3)), spacing=0.5)
    >>> bool(result), result.code
    (False, 'too_few_points')
    """

    code: str
    reason: str
    stage: str = ""
    footprint: Footprint | None = field(default=None, compare=False, repr=False)

    def __bool__(self) -> bool:
        return False


@dataclass(frozen=True)
class Finding:
    """One defect found by `validate_model` or `validate_file`.

    Parameters
    ----------
    code : int
        val3dity's code number.
    name : str
        val3dity's name of the code.
    building : str
        Id of the building, with the number of the part where there are several.
    where : str
        Level of detail, shell and face.
    detail : str
        One sentence with the values.

    Examples
    --------
    >>> from eaves import Finding
    >>> Finding(203, "NON_PLANAR_POLYGON_DISTANCE_PLANE", "a", "lod 2.2", "0.05 m from the plane").code
    203
    """

    code: int
    name: str
    building: str
    where: str
    detail: str
