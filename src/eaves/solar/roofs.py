"""Sunlight on every roof face, by month, and the part of it that panels can use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from shapely import Polygon

from eaves.geometry.face_table import FaceTable
from eaves.model import Integers, Mask, Raster, Values
from eaves.solar.horizon import horizons, lit_light, sky_shares
from eaves.solar.sun import MONTHS, Hours, light_on_plane


@dataclass(frozen=True)
class SolarRules:
    """The parameters of sunlight on roofs."""

    turbidity: float = 3.0
    """Linke's turbidity of the clear sky: 2 is mountain air, 3 the countryside of the middle latitudes, 5 a
    city's haze [rigollier2000]. Unused with a weather file."""
    albedo: float = 0.2
    """Share of the light that the ground throws back: the usual value without snow. What comes back from
    walls and trees is left out."""
    directions: int = 72
    """Directions of a horizon: 5° apart, from one to the next the sun moves in twenty minutes."""
    reach: float = 300.0
    """Distance (m) up to which things stand in the way: 25 m of height are 5° there. Mountains are not."""
    clearance: float = 0.3
    """Points that rise higher (m) over their face are no noise but objects: dormers, chimneys, crowns."""
    edge: float = 0.3
    """Distance (m) that panels keep from the rim of a face."""
    smallest: float = 3.4
    """Pieces of a face smaller than this (m² along the slope) hold no two modules of 1.7 m²."""
    suitable: float = 0.65
    """Places that get this share of what the best tilted plane in the open gets, and more, are used: level
    roofs do, and those to the east and west; steep ones to the north and dark courts do not."""
    efficiency: float = 0.2
    """Share of the light that a module turns into current …"""
    performance: float = 0.8
    """… and of that the share which reaches the meter: heat, wires, inverter, dirt."""


@dataclass(frozen=True, eq=False)
class FaceLight:
    """The light on one roof face in a year."""

    month: Values
    """kWh/m² (12,), mean over the face."""
    open_month: Values
    """The same with nothing in the way."""
    sky: float
    """Share of an even sky's light that is left, mean over the face."""
    usable_m2: float
    """Along the slope."""
    usable: float
    """kWh/m² on what is usable, 0 where nothing is."""
    covered: float
    """Share of the face on which something stands that is no roof face, or hangs over it."""


def best_in_the_open(hours: Hours, rules: SolarRules) -> float:
    """kWh/m² a year on the best tilted plane with nothing in the way."""
    best = 0.0
    for azimuth in range(0, 360, 15):
        for tilt in range(0, 75, 5):
            turn, lean = np.radians(azimuth), np.radians(tilt)
            normal = np.array([np.sin(lean) * np.sin(turn), np.sin(lean) * np.cos(turn), np.cos(lean)])
            best = max(best, float(light_in_the_open(hours, normal, rules).sum()))
    return best


def light_in_the_open(hours: Hours, normal: Values, rules: SolarRules) -> Values:
    """kWh/m² (12,) by month on a plane of a normal (3,; east, true north, up) with nothing in the way."""
    beam, sky, back = light_on_plane(hours, normal, rules.albedo)
    seen = 0.5 * (1.0 + normal[2])
    whole = beam + sky * seen + back * (1.0 - seen)
    return np.bincount(hours.month, whole, MONTHS) / 1000.0


def light_on_faces(
    faces: Sequence[Polygon],
    dsm: Raster,
    hours: Hours,
    convergence: float,
    rules: SolarRules,
    best: float,
    wanted: Sequence[int],
) -> list[FaceLight]:
    """The light on each of the wanted faces; all faces stand in the way.

    Parameters
    ----------
    faces : sequence of Polygon
        All roof faces over the raster, with heights, in metres about its corner.
    dsm : Raster
        The surface, in the faces' coordinates.
    hours : Hours
        Sun and sky of a year.
    convergence : float
        Degrees by which grid north lies clockwise of true north.
    rules : SolarRules
        Constants.
    best : float
        `best_in_the_open`.
    wanted : sequence of int
        Numbers of the faces that are asked for.
    """
    table = FaceTable.of([face_rings(face) for face in faces])
    upright = np.column_stack([np.zeros((len(table), 2)), table.heights[1]])
    planes, areas = np.where(np.isnan(table.planes), upright, table.planes), table.areas
    face_at = number_cells(faces, planes, dsm)
    slices = ndimage.find_objects(face_at, len(faces))
    answers = []
    for number in wanted:
        face, plane, area = faces[number], planes[number], float(areas[number])
        cells = face_cells(face, face_at, slices[number], number + 1, dsm)
        answers.append(
            light_on_face(
                number + 1,
                face,
                plane,
                area,
                cells,
                face_at,
                dsm,
                hours,
                convergence,
                rules,
                best,
            )
        )
    return answers


def number_cells(faces: Sequence[Polygon], planes: Values, dsm: Raster) -> NDArray[np.int32]:
    """Number (H, W) from 1 of the highest roof face at the middle of each cell, 0 for none."""
    face_at = np.zeros(dsm.shape, np.int32)
    height = np.full(dsm.shape, -np.inf)
    rows, columns = dsm.shape
    for number, face in enumerate(faces, 1):
        west, south, east, north = face.bounds
        left, right = int((west - dsm.west) / dsm.cell), int((east - dsm.west) / dsm.cell) + 1
        top, low = int((dsm.north - north) / dsm.cell), int((dsm.north - south) / dsm.cell) + 1
        left, top, right, low = max(left, 0), max(top, 0), min(right, columns), min(low, rows)
        if right <= left or low <= top:
            continue
        x = dsm.west + (np.arange(left, right) + 0.5) * dsm.cell
        y = dsm.north - (np.arange(top, low) + 0.5) * dsm.cell
        grid_x, grid_y = np.meshgrid(x, y)
        inside = shapely.contains_xy(face, grid_x, grid_y)
        a, b, c = planes[number - 1]
        z = a * grid_x + b * grid_y + c
        here = (slice(top, low), slice(left, right))
        on_top = inside & (z > height[here])
        face_at[here] = np.where(on_top, number, face_at[here])
        height[here] = np.where(on_top, z, height[here])
    return face_at


Cells = tuple[Integers, Integers]


def face_cells(
    face: Polygon, face_at: NDArray[np.int32], box: tuple[slice, ...] | None, number: int, dsm: Raster
) -> Cells:
    """Rows and columns of a face's cells; of one without, that of a point in it."""
    if box is not None:
        row, column = np.nonzero(face_at[box] == number)
        return row + box[0].start, column + box[1].start
    inner = face.representative_point()
    row, column = dsm.cell_of(np.array([[inner.x, inner.y]]))
    rows, columns = dsm.shape
    return np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)


def light_on_face(
    number: int,
    face: Polygon,
    plane: Values,
    area: float,
    cells: Cells,
    face_at: NDArray[np.int32],
    dsm: Raster,
    hours: Hours,
    convergence: float,
    rules: SolarRules,
    best: float,
) -> FaceLight:
    """The light on one face: that of every hour at its cells, as far as sun and sky are seen there."""
    a, b, c = plane
    row, column = cells
    x: Values = np.asarray(dsm.west + (column + 0.5) * dsm.cell, np.float64)
    y: Values = np.asarray(dsm.north - (row + 0.5) * dsm.cell, np.float64)
    xyz = np.column_stack([x, y, a * x + b * y + c])
    horizon = horizons(dsm, face_at, xyz, number, plane, rules.directions, rules.reach, rules.clearance)
    grid_normal = np.array([-a, -b, 1.0]) / np.sqrt(a * a + b * b + 1.0)
    turn = np.radians(convergence)
    normal = np.array(
        [
            grid_normal[0] * np.cos(turn) + grid_normal[1] * np.sin(turn),
            grid_normal[1] * np.cos(turn) - grid_normal[0] * np.sin(turn),
            grid_normal[2],
        ]
    )
    beam, sky, back = light_on_plane(hours, normal, rules.albedo)
    seen = sky_shares(horizon, grid_normal)
    lit = lit_light(horizon, hours.azimuth - convergence, hours.elevation, beam, hours.month)
    from_sky, from_ground = (np.bincount(hours.month, part, MONTHS) for part in (sky, back))
    light = (lit + np.outer(seen, from_sky) + 0.5 * (1.0 - normal[2]) * from_ground) / 1000.0
    surface = dsm.values[row, column]
    over = surface > xyz[:, 2] + rules.clearance + 0.5 * dsm.cell * (abs(a) + abs(b))
    good = ~over & np.isfinite(surface) & (light.sum(axis=1) >= rules.suitable * best)
    good &= shapely.contains_xy(face.buffer(-rules.edge), x, y)
    cell_m2 = np.sqrt(a * a + b * b + 1.0) * dsm.cell**2
    usable = in_large_pieces(good, cells, cell_m2, rules.smallest)
    return FaceLight(
        month=np.asarray(light.mean(axis=0)),
        open_month=light_in_the_open(hours, normal, rules),
        sky=float(seen.mean()),
        usable_m2=area * float(usable.mean()),
        usable=float(light[usable].sum(axis=1).mean()) if usable.any() else 0.0,
        covered=float(over.mean()),
    )


def face_rings(polygon: Polygon) -> list[Values]:
    """The rings of a polygon with heights, without repeated point, the outer one first."""
    return [
        shapely.get_coordinates(ring, include_z=True)[:-1] for ring in (polygon.exterior, *polygon.interiors)
    ]


def in_large_pieces(good: Mask, cells: Cells, cell_m2: float, smallest: float) -> Mask:
    """Mask (N,) of the good cells of a face, each of so many m², in pieces of `smallest` m² and more."""
    row, column = cells[0] - cells[0].min(), cells[1] - cells[1].min()
    grid = np.zeros((row.max() + 1, column.max() + 1), bool)
    grid[row, column] = good
    pieces, count = ndimage.label(grid)
    large = np.bincount(pieces.ravel(), minlength=count + 1) * cell_m2 >= smallest
    large[0] = False
    return np.asarray(large[pieces[row, column]])
