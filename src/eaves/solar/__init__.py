"""Sunlight on the roofs of a run: where the sun stands, what the sky sends, what stands in between."""
