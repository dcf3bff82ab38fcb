"""Ground: which points are terrain."""

from eaves.ground.stage import GroundMethod, classify_ground

__all__ = ["GroundMethod", "classify_ground"]
