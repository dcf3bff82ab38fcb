"""eaves: from raw airborne LiDAR to building footprints and valid 3D building models.

>>> import eaves
>>> cloud = eaves.read("tile.laz")                                        # doctest: +SKIP
>>> classified = eaves.classify_ground(cloud)                             # doctest: +SKIP
>>> summary = eaves.build("tile.laz", "out")                              # doctest: +SKIP
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eaves.detect import detect_buildings
    from eaves.formats import read
    from eaves.ground import classify_ground
    from eaves.outline import regularise_outlines, trace_outline
    from eaves.pipeline import make_recipe, make_scene
    from eaves.raster.surfaces import make_dsm, make_dtm
    from eaves.reconstruct import reconstruct_building
    from eaves.roof import segment_roof
    from eaves.validate import validate_file, validate_model
    from eaves.viewer.build import build

__version__ = version("eaves")

HOME = {
    "build": "eaves.viewer.build",
    "classify_ground": "eaves.ground",
    "detect_buildings": "eaves.detect",
    "make_dsm": "eaves.raster.surfaces",
    "make_dtm": "eaves.raster.surfaces",
    "make_recipe": "eaves.pipeline",
    "make_scene": "eaves.pipeline",
    "read": "eaves.formats",
    "reconstruct_building": "eaves.reconstruct",
    "regularise_outlines": "eaves.outline",
    "segment_roof": "eaves.roof",
    "trace_outline": "eaves.outline",
    "validate_file": "eaves.validate",
    "validate_model": "eaves.validate",
}
"""Where each public verb lives; it is imported when first used."""

__all__ = [
    "build",
    "classify_ground",
    "detect_buildings",
    "make_dsm",
    "make_dtm",
    "make_recipe",
    "make_scene",
    "read",
    "reconstruct_building",
    "regularise_outlines",
    "segment_roof",
    "trace_outline",
    "validate_file",
    "validate_model",
]


def __getattr__(name: str) -> Any:
    if name not in HOME:
        raise AttributeError(f"module 'eaves' has no attribute '{name}'")
    return getattr(import_module(HOME[name]), name)
