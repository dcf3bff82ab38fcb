"""Building models: CityJSON, CityGML, meshes, 3D Tiles, drawings and tables."""
