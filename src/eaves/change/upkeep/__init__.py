"""Kept runs: updated with new points, rebuilt after edits, learned from."""
