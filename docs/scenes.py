"""The simulated scene that the documentation draws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eaves.model import Footprint, PointCloud, Points, RoofPlane, Scene
from eaves.model.cloud import BUILDING
from eaves.raster.surfaces import make_scene
from eaves.roof import segment_roof
from eaves.simulate import scan_town, simulate_town

AREA_KM2, DENSITY, SEED = 0.01, 6.0, 7


@dataclass(frozen=True, eq=False)
class Scenery:
    """A town with its scan, and one house of it with everything before its model."""

    cloud: PointCloud
    scene: Scene
    house: Points
    footprint: Footprint
    planes: tuple[RoofPlane, ...]
    ground: float


def make_scenery() -> Scenery:
    """A hectare at 6 points/m² with trees, and its building with the most roof faces."""
    simulated = scan_town(simulate_town(AREA_KM2, seed=SEED), DENSITY, seed=SEED)
    cloud = simulated.classified()
    cloud = cloud.take(cloud.canonical_order())
    scene = make_scene(cloud, cloud.bounds)
    building = max(simulated.buildings, key=lambda found: (len(found.faces), found.id))
    footprint = building.model().footprint
    near = building_points(cloud, footprint)
    house = cloud.xyz[near]
    planes = tuple(segment_roof(house, scene.spacing))
    ground = float(np.nanmin(scene.dtm.at(house)))
    return Scenery(cloud, scene, house, footprint, planes, ground)


def building_points(cloud: PointCloud, footprint: Footprint) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Numbers of the building points over a footprint."""
    import shapely

    inside = shapely.contains_xy(footprint.polygon.buffer(0.3), *cloud.xyz[:, :2].T)
    return np.flatnonzero(inside & (cloud.classification == BUILDING))
