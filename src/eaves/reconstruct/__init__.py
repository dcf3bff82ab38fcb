"""Reconstruction: from roof planes and a footprint to valid solids."""

from eaves.reconstruct.overhangs import add_overhangs
from eaves.reconstruct.stage import Reconstructor, reconstruct_building

__all__ = ["Reconstructor", "add_overhangs", "reconstruct_building"]
