"""Layers of polygons: GeoPackage, GeoParquet and what GDAL reads."""
