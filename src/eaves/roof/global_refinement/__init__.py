"""The default roof segmentation and its steps."""

from eaves.roof.global_refinement.method import GlobalRefinement

__all__ = ["GlobalRefinement"]
