"""Reading and writing, one file per format; names load on first use, as the libraries they need are slow."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOMES = {
    "InputError": "errors",
    "Chunk": "chunk",
    "Source": "source",
    "common_system": "source",
    "find_inputs": "inputs",
    "iter_chunks": "source",
    "open_source": "source",
    "read": "source",
    "write_classified": "classified",
    "CityObject": "cityjson_read",
    "iter_cityjson": "cityjson_read",
    "read_cityjson": "cityjson_read",
    "write_cityjson": "cityjson",
    "write_cityjson_seq": "cityjson",
    "read_polygons": "geopackage",
    "write_3dtiles": "tiles3d",
    "write_geopackage": "geopackage",
    "write_geoparquet": "parquet",
    "write_glb": "glb",
    "write_obj": "obj",
    "MosaicWriter": "mosaic",
    "read_raster": "geotiff",
    "write_mask": "geotiff",
    "write_raster": "geotiff",
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
