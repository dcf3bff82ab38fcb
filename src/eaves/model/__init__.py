"""The nouns that flow."""

from eaves.model.arrays import Grid, Integers, Labels, Mask, Points, Rectangle, Values
from eaves.model.block import BLOCK_SIDE, Block, Bounds
from eaves.model.building import (
    Boundary,
    BuildingModel,
    Face,
    Failure,
    Finding,
    Footprint,
    Installation,
    RoofPlane,
    Solid,
)
from eaves.model.cloud import PointCloud
from eaves.model.coordinates import LOCAL_METRES, CoordinateSystem
from eaves.model.provenance import NOTHING_KNOWN, Provenance
from eaves.model.scene import Raster, Regions, Scene

__all__ = [
    "BLOCK_SIDE",
    "LOCAL_METRES",
    "NOTHING_KNOWN",
    "Block",
    "Boundary",
    "Bounds",
    "BuildingModel",
    "CoordinateSystem",
    "Face",
    "Failure",
    "Finding",
    "Footprint",
    "Grid",
    "Installation",
    "Integers",
    "Labels",
    "Mask",
    "PointCloud",
    "Points",
    "Provenance",
    "Raster",
    "Rectangle",
    "Regions",
    "RoofPlane",
    "Scene",
    "Solid",
    "Values",
]
