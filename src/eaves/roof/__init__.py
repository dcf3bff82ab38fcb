"""Roofs: the planes of one building."""

from eaves.roof.base import RoofMethod, segment_roof

__all__ = ["RoofMethod", "segment_roof"]
