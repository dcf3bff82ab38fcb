"""Rasters: GeoTIFF, mosaics written by block, virtual rasters."""
