"""Reading and writing, one file per format; names load on first use, as the libraries they need are slow.

`__all__` is what programs call; the stub lists beside it what packages use that bring formats and commands.
"""

import lazy_loader

__getattr__, __dir__, _ = lazy_loader.attach_stub(__name__, __file__)
__all__ = [
    "Chunk",
    "CityObject",
    "Format",
    "InputError",
    "MosaicWriter",
    "Source",
    "common_system",
    "find_inputs",
    "iter_chunks",
    "iter_cityjson",
    "open_source",
    "read",
    "read_cityjson",
    "read_polygons",
    "read_raster",
    "write_cityjson",
    "write_cityjson_seq",
    "write_classified",
    "write_geopackage",
    "write_geoparquet",
    "write_mask",
    "write_raster",
]
