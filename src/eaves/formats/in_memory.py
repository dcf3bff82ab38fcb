"""Points and polygons in memory as the files that readers and runs take: there is one way in."""

from __future__ import annotations

import hashlib
import shutil
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import laspy
import numpy as np
import shapely

from eaves.formats.crs import pyproj_crs
from eaves.formats.vectors.geopackage import gdal_options
from eaves.model import PointCloud
from eaves.model.checks import as_points, describe
from eaves.model.cloud import GRID_STEP

POINTS = "points.las"
GIVEN = "given"
"""Folder, in that of a run that is kept, of the points and polygons that it was given in memory."""
STANDARD = ("intensity", "gps_time", "point_source_id", "red", "green", "blue", "nir")
"""Fields of a cloud that a file of points holds."""
GEOPACKAGE_DATE = "2000-01-01T00:00:00.000Z"
MOST_STEPS = 2**31 - 1
"""Steps that a coordinate of a LAS file may count."""


def is_path(given: Any) -> bool:
    """True if a value is a path, or a list of paths."""
    if isinstance(given, list | tuple):
        return all(isinstance(one, str | Path) for one in given)
    return isinstance(given, str | Path)


@contextmanager
def staying(path: Path, folder: Path | None) -> Iterator[Path]:
    """A file as it is; or a copy of it that stays in `folder`, named by its content, so that none that a run
    there refers to is written over. It goes where the block refuses what it is given."""
    if folder is None:
        yield path
        return
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()[:12]
    copy = folder / GIVEN / f"{path.stem}-{digest}{path.suffix}"
    fresh = not copy.exists()
    copy.parent.mkdir(parents=True, exist_ok=True)
    if fresh:
        shutil.copyfile(path, copy)
    try:
        yield copy
    except (TypeError, ValueError):
        if fresh:
            copy.unlink(missing_ok=True)
            for emptied in (copy.parent, folder):
                with suppress(OSError):
                    emptied.rmdir()
        raise


@contextmanager
def as_point_files(points: Any, crs: Any = None, keep: Path | None = None) -> Iterator[Any]:
    """Paths as they are; else the path of a file, until the block ends, with the points of a laspy.LasData, a
    PointCloud or an array (N, 3) in the units of the system `crs`; one that stays in the folder `keep`.

    Raises
    ------
    TypeError, ValueError
        When the value holds no points, or an array comes without a system.
    """
    if is_path(points):
        yield points
        return
    with TemporaryDirectory(prefix="eaves-") as folder:
        path = Path(folder) / POINTS
        if isinstance(points, laspy.LasData):
            points.write(path)
        elif isinstance(points, PointCloud):
            write_cloud(path, points)
        else:
            xyz = as_points(points, "points")
            if crs is None:
                raise ValueError(
                    "points: an array names no reference system; pass crs= (an EPSG code), or crs='metres' "
                    "for a local plane"
                )
            write_cloud(path, PointCloud(xyz=xyz[np.isfinite(xyz).all(axis=1)], origin=(0.0, 0.0)))
        with staying(path, keep) as path:
            yield path


@contextmanager
def as_polygon_file(polygons: Any, name: str, keep: Path | None = None) -> Iterator[Any]:
    """A path, or None, as it is; else the path of a file, until the block ends, with the polygons of a
    GeoDataFrame, a GeoSeries, a shapely geometry or a sequence of those; one that stays in the folder `keep`.

    Raises
    ------
    TypeError
        When the value, that of the argument `name`, holds no polygons.
    """
    if polygons is None or is_path(polygons):
        yield polygons
        return
    import pyogrio.raw  # late: most runs get paths

    with TemporaryDirectory(prefix="eaves-") as folder:
        path = Path(folder) / f"{name}.gpkg"
        if hasattr(polygons, "to_frame"):
            polygons = polygons.to_frame("geometry")
        with undated():
            if hasattr(polygons, "to_file"):
                polygons.to_file(path, driver="GPKG", layer=name)
            else:
                shapes = np.atleast_1d(np.asarray(polygons, object))
                if not shapely.is_geometry(shapes).all():
                    raise TypeError(
                        f"{name} must be a path, a GeoDataFrame or polygons, not {describe(polygons)}; "
                        "give one of these"
                    )
                wkb = shapely.to_wkb(shapes)
                pyogrio.raw.write(path, wkb, [], [], layer=name, driver="GPKG", geometry_type="Unknown")
        with staying(path, keep) as path:
            yield path


@contextmanager
def undated() -> Iterator[None]:
    """Write GeoPackages with the date of `GEOPACKAGE_DATE`: the same content is the same bytes."""
    with gdal_options({"OGR_CURRENT_DATE": GEOPACKAGE_DATE}), warnings.catch_warnings():
        # without a system they are in that of the points
        warnings.filterwarnings("ignore", message="'crs' was not provided")
        yield


def write_cloud(path: Path, cloud: PointCloud) -> None:
    """Write the points of a cloud that have coordinates, and what a LAS file holds of them."""
    header = laspy.LasHeader(point_format=8, version="1.4")
    unit, crs = np.array(cloud.system.unit_m), pyproj_crs(cloud.system)
    if crs is not None:
        header.add_crs(crs)
    good = np.flatnonzero(np.isfinite(cloud.xyz).all(axis=1))
    if not len(good):
        raise ValueError(f"points: none of {len(cloud)} has coordinates; give at least one")
    world = cloud.world[good] / unit
    header.offsets = np.floor(world.min(axis=0))
    extent = (world - header.offsets).max(axis=0)
    coarsest = 10.0 ** np.ceil(np.log10(np.maximum(extent, 1.0) / MOST_STEPS))
    header.scales = np.maximum(GRID_STEP / unit, coarsest)
    las = laspy.LasData(header)
    las.xyz = world
    names = ("return_number", "number_of_returns", "classification")
    columns = {name: getattr(cloud, name) for name in names} | {
        name: cloud.fields[name] for name in STANDARD if name in cloud.fields
    }
    for name, values in columns.items():
        if values is not None:
            las[name] = values[good]
    las.write(path)
