"""Roofs as wireframes, drawn and judged as Building3D [wang2023] does it."""
