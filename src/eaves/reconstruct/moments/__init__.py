"""Parametric buildings from invariant moments, and their steps."""

from eaves.reconstruct.moments.method import Moments

__all__ = ["Moments"]
