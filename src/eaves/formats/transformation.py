"""Systems that are not true to length, and the transformation of coordinates into one that is."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import pyproj
import shapely
from pyproj.exceptions import ProjError
from pyproj.transformer import TransformerGroup
from shapely.geometry.base import BaseGeometry

from eaves.formats.crs import code_of, compound, parse_crs, plane_part
from eaves.formats.errors import InputError
from eaves.model import Bounds, Points, Rectangle

AS_STORED = "none"
"""The word that, in place of a system to transform to, leaves coordinates as the files store them."""
UNTRUE, NOTABLE = 0.01, 0.001
"""A scale that is off by more than the first makes areas wrong by 2 % and is not accepted; by more than the
second it is said. Projections of surveys are off by .0005 in their zones."""
ZONES = {("WGS 84", 1): 32600, ("WGS 84", -1): 32700, ("ETRS89", 1): 25800, ("NAD83", 1): 26900}
"""EPSG code before that of a datum's UTM zone 1, of the north and the south; of other datums WGS 84's."""
BOX_MARGIN, DENSE = 1.0, 21
"""Width (m) added around a box that was transformed, for between the points of its sides it may bulge; and
the number of these points."""


@dataclass(frozen=True)
class Transformation:
    """The way of stored coordinates to world metres in another system.

    Parameters
    ----------
    source, target : str
        WKT of both plane systems.
    unit, height_unit : float
        Metres in a unit of the target's plane, and of the heights, which stay as they are.
    """

    source: str
    target: str
    unit: float
    height_unit: float

    def to_metres(self, xyz: Points) -> Points:
        """Stored coordinates (N, 3) as world metres, in place; what has no place there is not finite."""
        x, y = self.way.transform(xyz[:, 0], xyz[:, 1])
        xyz[:, 0], xyz[:, 1] = x, y
        xyz *= (self.unit, self.unit, self.height_unit)
        return xyz

    @property
    def named(self) -> str:
        """The target by its code, where that says all of it, else as WKT."""
        crs = pyproj.CRS.from_wkt(self.target)
        code = code_of(crs)
        return code if code is not None and pyproj.CRS.from_user_input(code) == crs else self.target

    @property
    def way(self) -> pyproj.Transformer:
        """PROJ's transformer."""
        return _way(self.source, self.target)

    def box(self, low: tuple[float, ...], high: tuple[float, ...]) -> Bounds:
        """A box that holds all that lies in the stored one, world metres."""
        corners = low[0], low[1], high[0], high[1]
        sides = np.array(self.way.transform_bounds(*corners, densify_pts=DENSE)) * self.unit
        if not np.isfinite(sides).all():
            return Bounds(0.0, 0.0, 0.0, 0.0)
        return Bounds(*map(float, sides)).buffered(BOX_MARGIN)

    def stored_box(self, bounds: Bounds) -> Rectangle:
        """West, south, east, north as stored that hold all that lies in bounds (world metres)."""
        wide = bounds.buffered(BOX_MARGIN)
        sides = wide.west / self.unit, wide.south / self.unit, wide.east / self.unit, wide.north / self.unit
        box: Rectangle = _way(self.target, self.source).transform_bounds(*sides, densify_pts=DENSE)
        return box

    def area(self, bounds: Bounds) -> BaseGeometry:
        """The area (world metres) of bounds in stored coordinates, whose sides are not straight there."""
        box = shapely.box(bounds.west, bounds.south, bounds.east, bounds.north)
        dense = shapely.segmentize(box, max(bounds.east - bounds.west, bounds.north - bounds.south) / DENSE)
        moved: BaseGeometry = shapely.transform(
            dense, lambda xy: np.column_stack(self.way.transform(*xy.T)) * self.unit
        )
        return moved


@lru_cache(maxsize=64)
def _way(source: str, target: str) -> pyproj.Transformer:
    return pyproj.Transformer.from_crs(source, target, always_xy=True)


@lru_cache(maxsize=64)
def _projection(wkt: str) -> tuple[pyproj.Proj, pyproj.Transformer]:
    crs = pyproj.CRS.from_wkt(wkt)
    return pyproj.Proj(crs), pyproj.Transformer.from_crs(crs, crs.geodetic_crs, always_xy=True)


def scale_at(crs: pyproj.CRS, x: float, y: float) -> float:
    """The scale of a plane system at a place in its own units that is farthest from 1 in any direction: the
    semi-axes of Tissot's indicatrix; 1 where it has none.
    """
    if not crs.is_projected:
        return 1.0
    try:
        projection, to_degrees = _projection(crs.to_wkt())
        factors = projection.get_factors(*to_degrees.transform(x, y), errcheck=True)
    except ProjError:
        return 1.0
    axes = (factors.tissot_semimajor, factors.tissot_semiminor)
    scale = max(axes, key=lambda axis: abs(axis - 1.0))
    return float(scale) if np.isfinite(scale) else 1.0


def zone_of(crs: pyproj.CRS, longitude: float, latitude: float) -> str:
    """The code of the UTM zone of a place, of a system's datum where that is one of `ZONES`."""
    name = "" if crs.geodetic_crs is None else crs.geodetic_crs.name
    zone = min(int((longitude + 180) // 6) + 1, 60)
    side = 1 if latitude >= 0 else -1
    return f"EPSG:{ZONES.get((name, side), ZONES['WGS 84', side]) + zone}"


def target_of(crs: pyproj.CRS, path: Path, x: float, y: float, to_crs: str | None) -> pyproj.CRS | None:
    """The plane system to which data in `crs` are transformed; None for data that stay as they are.

    Parameters
    ----------
    crs : CRS
        Plane or geographic.
    path : Path
        The file, for messages.
    x, y : float
        Its middle, as stored.
    to_crs : str or None
        The system asked for, `AS_STORED`, or None: the UTM zone of the middle where `crs` is in degrees or
        not true to length.

    Raises
    ------
    InputError
        When the system asked for, or that of the file, is none on Earth, or numbers are no degrees.
    """
    if to_crs == AS_STORED:
        return None
    if to_crs is not None:
        target = plane_part(parse_crs(to_crs, "--to-crs"))
        if not target.is_projected:
            raise InputError.about("--to-crs", f"{target.name} is no projected system", "give another one")
        if not (crs.is_projected or crs.is_geographic):
            raise InputError.about(
                path, f"{crs.name} has no place on Earth to transform from", "pass its system with --crs"
            )
        return None if target.equals(crs, ignore_axis_order=True) else target
    if not crs.is_geographic and abs(scale_at(crs, x, y) - 1.0) <= UNTRUE:
        return None
    degrees = crs.geodetic_crs or crs
    longitude, latitude = _way(crs.to_wkt(), degrees.to_wkt()).transform(x, y)
    if not (-180 <= longitude <= 180 and -90 <= latitude <= 90):
        if crs.is_projected:
            return None
        raise InputError.about(
            path,
            f"coordinates around {x:.4f}, {y:.4f} do not fit {crs.name}, which is in degrees",
            "pass the right system with crs= or --crs",
        )
    return pyproj.CRS.from_user_input(zone_of(crs, longitude, latitude))


def with_heights_of(target: pyproj.CRS, crs: pyproj.CRS) -> pyproj.CRS:
    """A plane system with the heights of another system, where that has any."""
    if not crs.is_compound:
        return target
    return compound(target, crs.sub_crs_list[1])


def transformed_remark(path: Path, crs: pyproj.CRS, target: pyproj.CRS, x: float, y: float) -> str:
    """The line which says that inputs are transformed, and why."""
    plane = plane_part(crs)
    reason = f"coordinates around {x:.4f}, {y:.4f} are in degrees ({plane.name})"
    if not plane.is_geographic:
        reason = f"the scale of {plane.name} at the data is {scale_at(plane, x, y):.4f}"
    return (
        f"{path.name}: {reason}; points, and all results, are transformed to "
        f"{code_of(target) or target.name} ({target.name}); --to-crs chooses another system"
    )


def scale_remark(path: Path, crs: pyproj.CRS, x: float, y: float) -> str | None:
    """The line on a system that stays as it is and whose scale is off at the data; None where it is not."""
    scale = scale_at(plane_part(crs), x, y)
    if abs(scale - 1.0) <= NOTABLE:
        return None
    off = 100 * (scale - 1.0)
    return (
        f"{path.name}: the scale of {plane_part(crs).name} at the data is {scale:.5f}: lengths are off by "
        f"{off:.2f} %, areas by {2 * off:.2f} %; --to-crs CODE transforms them to a system that is true"
    )


@lru_cache(maxsize=64)
def datum_remark(name: str, source: str, target: str) -> str | None:
    """The line on a change of datum for which PROJ here lacks the best grid, with how far the way that it
    takes may be off; None where it has the best.

    Parameters
    ----------
    name : str
        The file.
    source, target : str
        WKT of its system and of that of the points.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        group = TransformerGroup(source, target, always_xy=True)
    if group.best_available or not group.transformers:
        return None
    lost, taken = group.unavailable_operations, group.transformers[0]
    grids = dict.fromkeys(grid.short_name for way in lost[:1] for grid in way.grids)
    off = f"is good to {taken.accuracy:g} m" if taken.accuracy >= 0 else "may be off by 100 m or more"
    return (
        f"{name}: PROJ lacks the grid {', '.join(grids)}: the way to the system of the points "
        f"({taken.description}) {off}; to install it: pyproj sync --file {next(iter(grids), '')}"
    )
