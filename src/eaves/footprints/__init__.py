"""Footprints and party walls that a map gives: read, repaired, moved into place, laid on what is detected."""
