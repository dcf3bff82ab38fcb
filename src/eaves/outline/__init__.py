"""Outlines: from a region's points to the footprint."""

from eaves.outline.stage import OutlineMethod, regularise_outlines, trace_outline

__all__ = ["OutlineMethod", "regularise_outlines", "trace_outline"]
