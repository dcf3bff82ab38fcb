"""Reconstruction: from roof planes and a footprint to valid solids."""

from eaves.reconstruct.stage import Reconstructor, reconstruct_building

__all__ = ["Reconstructor", "reconstruct_building"]
