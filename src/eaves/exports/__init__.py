"""Formats beside those of the core: CityGML, 3D Tiles, GLB, OBJ, DXF, IFC, KML, GeoPackage by level, COPC."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
