"""The nouns of one building: boundary, footprint, roof planes, solid, model, failure, finding."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.model.arrays import Points, Values

if TYPE_CHECKING:
    from shapely import Polygon

LODS = ("0", "1.2", "1.3", "2.0", "2.2")
"""Levels of detail after Biljecki, Ledoux and Stoter 2016, coarse to fine."""

GROUND_SURFACE, WALL_SURFACE, ROOF_SURFACE = "GroundSurface", "WallSurface", "RoofSurface"


@dataclass(frozen=True, eq=False)
class Boundary:
    """The raw outline of a set of points: rings of points in order, as a tracer found them.

    `rings` holds closed rings (M, 2) without repeated last point: the outer one counter-clockwise, then
    the holes clockwise. `points` (N, 3) are all points of the region, `spacing` their mean distance in
    plan (m). `not_last` (K, 3) are those of them whose pulses came back once more from below; None where the
    scan does not say.
    """

    rings: tuple[NDArray[np.float64], ...]
    points: Points
    spacing: float
    not_last: Points | None = None


@dataclass(frozen=True, eq=False)
class Footprint:
    """The outline of one building: a valid polygon, counter-clockwise, in local metres about `origin`."""

    polygon: Polygon
    origin: tuple[float, float] = (0.0, 0.0)
    id: str = ""
    score: float = 1.0
    attributes: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # A grid on which later overlays would round gets lost on the way to another process; the answer must
        # not depend on that.
        if shapely.get_precision(self.polygon):
            free = shapely.set_precision(self.polygon, 0.0, mode="pointwise")
            object.__setattr__(self, "polygon", free)

    def with_(self, **changes: Any) -> Footprint:
        """A copy with some fields replaced."""
        return replace(self, **changes)


@dataclass(frozen=True, eq=False)
class RoofPlane:
    """A plane z = a·x + b·y + c in local metres, and the points it was fitted to.

    `members` (K,) are indices into the building's points. `polygon` is the plane's extent in plan where
    known.
    """

    coefficients: tuple[float, float, float]
    members: NDArray[np.int64]
    rmse: float
    polygon: Polygon | None = None

    @property
    def normal(self) -> NDArray[np.float64]:
        """Unit normal (3,), pointing up."""
        a, b, _ = self.coefficients
        return np.asarray(np.array([-a, -b, 1.0]) / np.sqrt(a * a + b * b + 1.0))

    @property
    def slope(self) -> float:
        """Radians from the horizontal."""
        a, b, _ = self.coefficients
        return float(np.arctan(np.hypot(a, b)))

    def height_at(self, xy: NDArray[np.float64]) -> Values:
        """Heights (N,) of the plane at (N, 2 or 3)."""
        a, b, c = self.coefficients
        return np.asarray(a * xy[:, 0] + b * xy[:, 1] + c)

    def distance_to(self, xyz: Points) -> Values:
        """Signed distances (N,) of points (N, 3) along the normal, positive above."""
        a, b, _ = self.coefficients
        return np.asarray((xyz[:, 2] - self.height_at(xyz)) / np.sqrt(a * a + b * b + 1.0))


@dataclass(frozen=True)
class Face:
    """One planar face of a solid: rings of vertex numbers, counter-clockwise from outside, then holes."""

    rings: tuple[tuple[int, ...], ...]
    surface: str
    plane: int | None = None
    """Index of the roof plane it lies on, for roof faces."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed, outward-oriented shell: `vertices` (V, 3) in local metres, shared by the faces."""

    vertices: Points
    faces: tuple[Face, ...]


@dataclass(frozen=True, eq=False)
class Installation:
    """An object on a roof that the building's solids leave out: a block over its outline in plan."""

    kind: str
    """`chimney`, `dormer`, `plant` or `lift_housing`, by its size and the roof it stands on."""
    polygon: Polygon
    """Its outline, in metres about the footprint's origin."""
    base: float
    """Lowest roof under it (m)."""
    top: float
    """Height of its top (m)."""
    height: float
    """Median height of its points over the roof (m)."""
    points: int
    """Points that show it."""

    @property
    def solid(self) -> Solid:
        """The block from the lowest roof under the object to its top."""
        ring = np.asarray(shapely.orient_polygons(self.polygon).exterior.coords)[:-1, :2]
        count = len(ring)
        vertices = np.vstack([np.column_stack([ring, np.full(count, z)]) for z in (self.base, self.top)])
        faces = [Face((tuple(range(count - 1, -1, -1)),), GROUND_SURFACE)]
        faces.append(Face((tuple(range(count, 2 * count)),), ROOF_SURFACE))
        for corner in range(count):
            after = (corner + 1) % count
            faces.append(Face(((corner, after, count + after, count + corner),), WALL_SURFACE))
        return Solid(np.round(vertices, 3), tuple(faces))


@dataclass(frozen=True, eq=False)
class BuildingModel:
    """A building at one or more levels of detail.

    `solids[lod]` holds the parts of the building at that level: one, or several where one solid would touch
    itself. `planes` are the roof planes the finest level stands on, `installations` what stands on
    the roof beside the solids.
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

    def with_(self, **changes: Any) -> BuildingModel:
        """A copy with some fields replaced."""
        return replace(self, **changes)


@dataclass(frozen=True)
class Failure:
    """Why hard data gave no answer. It is false, so `if not result:` reads well."""

    code: str
    """Short and stable, listed in docs/errors.md: `too_few_points`, `no_plane`, `not_a_house`, …"""
    reason: str
    """One sentence with the values that made it fail."""
    stage: str = ""
    footprint: Footprint | None = field(default=None, compare=False, repr=False)

    def __bool__(self) -> bool:
        return False


@dataclass(frozen=True)
class Finding:
    """One defect found by `validate`: val3dity's code number, where, and what."""

    code: int
    name: str
    building: str
    where: str
    detail: str
