"""Reconstruction: from roof planes and a footprint to valid solids."""

from eaves.reconstruct.base import Reconstructor, reconstruct

__all__ = ["Reconstructor", "reconstruct"]
