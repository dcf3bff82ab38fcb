"""The default outline method and its steps."""

from eaves.outline.global_fit.method import GlobalFit

__all__ = ["GlobalFit"]
