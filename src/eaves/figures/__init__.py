"""Figures of a building, from its model and its points."""
