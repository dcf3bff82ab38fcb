"""Roofs: the planes of one building."""

from eaves.roof.stage import RoofMethod, segment_roof

__all__ = ["RoofMethod", "segment_roof"]
