"""Blocks of the world, who computes them, and the files that come out."""
