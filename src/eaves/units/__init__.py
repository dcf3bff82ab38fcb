"""Blocks divided into the buildings that stand in them wall to wall."""

from eaves.units.stage import Division, UnitMethod, divide_block

__all__ = ["Division", "UnitMethod", "divide_block"]
