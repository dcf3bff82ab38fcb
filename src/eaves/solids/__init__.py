"""Closed solids: plans cut into cells, tidied, extruded, looked at once more."""
