"""Parametric buildings from invariant moments, and their steps."""

from eaves.published.maas_vosselman.moments.method import Moments

__all__ = ["Moments"]
