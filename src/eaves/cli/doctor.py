"""The checks of `eaves doctor`: versions, drivers, grids, cores, caches; and those of other packages."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from eaves.extensions import CHECKS, COMMANDS, FORMATS, SOURCES, imported, installed
from eaves.kernels import compiled_pieces, library
from eaves.run.memory import physical_memory

LIBRARIES = ("numpy", "scipy", "numba", "laspy", "lazrs", "shapely", "pyproj", "rasterio", "pyogrio")
EXTRAS = {
    "plots": "matplotlib",
    "notebook": "geopandas",
    "parquet": "pyarrow",
    "ifc": "ifcopenshell",
    "cluster": "distributed",
}
"""Extra → the library that it brings."""
DRIVERS = ("GPKG", "FlatGeobuf", "GeoJSON", "ESRI Shapefile")


def describe_installation() -> Iterator[str]:
    """Lines on what is installed and what it runs on."""
    import pyogrio
    import pyproj
    import rasterio
    from pyproj.datadir import get_user_data_dir  # type: ignore[attr-defined]

    yield f"eaves {version('eaves')}, Python {platform.python_version()}, {platform.platform()}"
    yield "libraries: " + ", ".join(f"{name} {library_version(name)}" for name in LIBRARIES)
    extras = [f"{extra} {'yes' if library_version(library) else 'no'}" for extra, library in EXTRAS.items()]
    yield "extras: " + ", ".join(extras)
    known = pyogrio.list_drivers()
    drivers = [f"{name} {'yes' if 'w' in known.get(name, '') else 'NO'}" for name in DRIVERS]
    gdal = ".".join(map(str, pyogrio.__gdal_version__))
    yield f"GDAL {rasterio.__gdal_version__} (rasters), {gdal} (polygons: {', '.join(drivers)})"
    places = [Path(place) for place in pyproj.datadir.get_data_dir().split(os.pathsep)]
    places.append(Path(get_user_data_dir()))
    grids = {file.name for place in places if place.is_dir() for file in place.glob("*.tif")}
    remedy = "" if grids else "; heights above the ellipsoid need them: pyproj sync"
    yield f"PROJ {pyproj.proj_version_str}, {len(grids)} grids{remedy}"
    yield f"{os.cpu_count()} cores, {physical_memory() / 1e9:.1f} GB of memory"
    for what, group in {"commands": COMMANDS, "formats": FORMATS, "published systems": SOURCES}.items():
        yield f"{what} of packages: {', '.join(installed(group)) or 'NONE; install eaves again'}"
    yield f"kernels in C: {len(library()) or 'NO'} calls; numba compiles any other when it is first called"
    yield f"compiled code is kept in {cache_folder()}"


def library_version(name: str) -> str:
    """The version of a library, empty where it is missing."""
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def cache_folder() -> str:
    """Folder of the code that numba has compiled, with the number of files there."""
    import eaves

    said = os.environ.get("NUMBA_CACHE_DIR")
    place = Path(said) if said else Path(eaves.__file__).parent
    writable = os.access(place, os.W_OK)
    return f"{place} ({compiled_pieces()} pieces{'' if writable else '; not writable: set NUMBA_CACHE_DIR'})"


def run_doctor(test: bool = True) -> int:
    """Print all of it, then the checks that installed packages bring; 0 when these are good, else 1."""
    for line in describe_installation():
        sys.stdout.write(line + "\n")
    good = True
    for place in installed(CHECKS).values() if test else ():
        sys.stdout.flush()
        passed, line = imported(place)()
        sys.stdout.write(line + "\n")
        good &= passed
    return 0 if good else 1
