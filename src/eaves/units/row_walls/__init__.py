"""Rows along fronts, divided along the walls their points show."""

from eaves.units.row_walls.method import RowWalls

__all__ = ["RowWalls"]
