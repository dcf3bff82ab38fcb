"""The tolerances that several modules share. A number used by one method only is that method's parameter."""

COORDINATE_STEP = 0.001
"""Resolution of written coordinates (m); the CityJSON transform uses it."""

PLANARITY = 0.01
"""Largest distance of a face's vertex from its plane (m); val3dity's default `planarity_d2p_tol`."""

SNAP = 0.001
"""Vertices nearer than this (m) are one; val3dity's default `snap_tol`."""

FLAT_SLOPE_DEG = 2.0
"""Slope under which a face has no azimuth (degrees)."""
