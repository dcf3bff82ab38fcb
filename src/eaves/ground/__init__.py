"""Ground: which points are terrain."""

from eaves.ground.base import GroundMethod, classify_ground

__all__ = ["GroundMethod", "classify_ground"]
