"""The nouns of simulated data: buildings and clouds of which everything is known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon
from shapely.affinity import translate

from eaves.model import BuildingModel, Footprint, Labels, PointCloud, RoofPlane, Solid
from eaves.simulate.objects.masses import Plane, extrude_partition


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
        from eaves.formats.crs import parse_crs, system_of

        system = system_of(parse_crs(crs), "--crs", self.cloud.origin)
        return replace(self, cloud=self.cloud.with_(system=system))

    def classified(self) -> PointCloud:
        """The cloud with its true classes."""
        return self.cloud.with_(classification=self.truth_class)
