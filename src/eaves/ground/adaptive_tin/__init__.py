"""The default ground filter and its steps."""

from eaves.ground.adaptive_tin.method import AdaptiveTin

__all__ = ["AdaptiveTin"]
