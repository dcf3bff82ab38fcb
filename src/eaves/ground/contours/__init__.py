"""Ground by contours of the surface, and the tracing of contours."""

from eaves.ground.contours.method import ContourGround

__all__ = ["ContourGround"]
