"""Sunlight on every roof face past what stands before the sky, by month, and the part that panels can use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from shapely import Polygon

from eaves.geometry import FaceTable
from eaves.kernels import kernel
from eaves.model import Integers, Mask, Raster, Values
from eaves.solar.sun import MONTHS, Hours, light_on_plane


@dataclass(frozen=True)
class SolarRules:
    """The parameters of sunlight on roofs."""

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
    """Share of the light that a module turns into electricity …"""
    performance: float = 0.8
    """… and of that the share which reaches the meter: heat, wires, inverter, dirt."""


Cells = tuple[Integers, Integers]


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
    cells: Cells
    """Rows and columns (N,) of the cells in which it is the highest face …"""
    year: Values
    """… and kWh/m² (N,) on each."""


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
    sky_share = 0.5 * (1.0 + normal[2])
    total = beam + sky * sky_share + back * (1.0 - sky_share)
    return np.bincount(hours.month, total, MONTHS) / 1000.0


def light_on_faces(
    faces: Sequence[Polygon],
    dsm: Raster,
    hours: Hours,
    convergence: float,
    rules: SolarRules,
    best: float,
    numbers: Sequence[int],
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
    lights = []
    for number in numbers:
        face, plane, area = faces[number], planes[number], float(areas[number])
        cells = face_cells(face, face_at, slices[number], number + 1, dsm)
        lights.append(
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
    return lights


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
    sky_share = sky_shares(horizon, grid_normal)
    lit = lit_light(horizon, hours.azimuth - convergence, hours.elevation, beam, hours.month)
    from_sky, from_ground = (np.bincount(hours.month, part, MONTHS) for part in (sky, back))
    light = (lit + np.outer(sky_share, from_sky) + 0.5 * (1.0 - normal[2]) * from_ground) / 1000.0
    surface = dsm.values[row, column]
    over = surface > xyz[:, 2] + rules.clearance + 0.5 * dsm.cell * (abs(a) + abs(b))
    good = ~over & np.isfinite(surface) & (light.sum(axis=1) >= rules.suitable * best)
    good &= shapely.contains_xy(face.buffer(-rules.edge), x, y)
    cell_m2 = np.sqrt(a * a + b * b + 1.0) * dsm.cell**2
    usable = in_large_pieces(good, cells, cell_m2, rules.smallest)
    seen = face_at[row, column] == number
    return FaceLight(
        month=np.asarray(light.mean(axis=0)),
        open_month=light_in_the_open(hours, normal, rules),
        sky=float(sky_share.mean()),
        usable_m2=area * float(usable.mean()),
        usable=float(light[usable].sum(axis=1).mean()) if usable.any() else 0.0,
        covered=float(over.mean()),
        cells=(row[seen], column[seen]),
        year=light[seen].sum(axis=1),
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


PATCH = 8
"""Cells a side of the patches whose highest cell is known, so that rays pass over low ground in strides."""


def horizons(
    dsm: Raster,
    face_at: NDArray[np.int32],
    xyz: Values,
    own_face: int,
    plane: Values,
    directions: int,
    reach: float,
    clearance: float,
) -> NDArray[np.float32]:
    """Tangent of the horizon's elevation (N, K) at every place in K directions, clockwise from grid north.

    A cell stands in the way at the distance of the middle of the ray's way through it. Cells of the places'
    own face do only where they rise more than `clearance` over its plane: the rest is the scan's noise.

    Parameters
    ----------
    dsm : Raster
        Surface (H, W) with all that stands, roofs and crowns; NaN is nothing.
    face_at : ndarray (H, W)
        Number of the roof face at each cell, 0 for none.
    xyz : ndarray (N, 3)
        Where to look from, in the raster's coordinates.
    own : int
        Number of the roof face on which the places are.
    plane : ndarray (3,)
        Its plane z = a·x + b·y + c.
    directions : int
        K.
    reach : float
        Distance (m) up to which is looked.
    clearance : float
        Height (m).
    """
    values = np.ascontiguousarray(dsm.values, np.float32)
    return np.asarray(
        horizons_kernel(
            values,
            highest_of_patches(values),
            np.ascontiguousarray(face_at, np.int32),
            dsm.west,
            dsm.north,
            dsm.cell,
            np.ascontiguousarray(xyz, np.float64),
            own_face,
            np.ascontiguousarray(plane, np.float64),
            directions,
            reach,
            clearance,
        )
    )


def highest_of_patches(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """The highest value in each patch of `PATCH` × `PATCH` cells; −inf where there is none."""
    rows, columns = values.shape
    padded = np.full((-(-rows // PATCH) * PATCH, -(-columns // PATCH) * PATCH), -np.inf, np.float32)
    padded[:rows, :columns] = np.where(np.isnan(values), -np.inf, values)
    shape = (padded.shape[0] // PATCH, PATCH, padded.shape[1] // PATCH, PATCH)
    return np.asarray(padded.reshape(shape).max(axis=(1, 3)))


@kernel
def way_out(x: float, y: float, dx: float, dy: float, west: float, south: float, side: float) -> float:
    """Distance from a place in a square to its rim along a direction."""
    along_x, along_y = np.inf, np.inf
    if dx > 0.0:
        along_x = (west + side - x) / dx
    elif dx < 0.0:
        along_x = (west - x) / dx
    if dy > 0.0:
        along_y = (south + side - y) / dy
    elif dy < 0.0:
        along_y = (south - y) / dy
    return max(min(along_x, along_y), 0.0)


@kernel
def horizons_kernel(
    values: NDArray[np.float32],
    highest: NDArray[np.float32],
    face_at: NDArray[np.int32],
    west: float,
    north: float,
    cell: float,
    xyz: Values,
    own_face: int,
    plane: Values,
    directions: int,
    reach: float,
    clearance: float,
) -> NDArray[np.float32]:
    """`horizons`, place by place."""
    rows, columns = values.shape
    a, b, c = plane[0], plane[1], plane[2]
    rise = clearance + 0.5 * cell * (abs(a) + abs(b))
    tangents = np.zeros((len(xyz), directions), np.float32)
    nudge = 1e-6 * cell
    for i in range(len(xyz)):
        x0, y0, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        for k in range(directions):
            turn = 2.0 * np.pi * k / directions
            dx, dy = np.sin(turn), np.cos(turn)
            best, far, first = 0.0, 0.0, True
            while far < reach:
                x, y = x0 + dx * (far + nudge), y0 + dy * (far + nudge)
                column, row = int(np.floor((x - west) / cell)), int(np.floor((north - y) / cell))
                if column < 0 or row < 0 or column >= columns or row >= rows:
                    break
                if not first:
                    low, left = row // PATCH, column // PATCH
                    if highest[low, left] - z <= best * far:
                        side = PATCH * cell
                        corner = north - (low + 1) * side
                        far += nudge + way_out(x, y, dx, dy, west + left * side, corner, side)
                        continue
                out = (
                    far + nudge + way_out(x, y, dx, dy, west + column * cell, north - (row + 1) * cell, cell)
                )
                h = values[row, column]
                if not first and not np.isnan(h):
                    counts = True
                    if face_at[row, column] == own_face:
                        middle_x, middle_y = west + (column + 0.5) * cell, north - (row + 0.5) * cell
                        counts = h > a * middle_x + b * middle_y + c + rise
                    slope = (h - z) / (0.5 * (far + out))
                    if counts and slope > best:
                        best = slope
                far, first = out, False
            tangents[i, k] = best
    return tangents


def sky_shares(horizon: NDArray[np.float32], normal: Values) -> Values:
    """Share (N,) of an even sky's light that reaches planes of one normal (3,), above horizons (N, K).

    The integral of the cosine of incidence over the sky that is seen, in closed form along each direction,
    over that of the whole sky; of a tilted plane in the open it is (1 + cos tilt) / 2.
    """
    count = horizon.shape[1]
    turn = 2.0 * np.pi * np.arange(count) / count
    across = normal[0] * np.sin(turn) + normal[1] * np.cos(turn)
    plane_horizon = np.arctan2(-across, max(float(normal[2]), 1e-9))  # where the plane itself ends the sky
    low = np.maximum(np.arctan(horizon), np.maximum(plane_horizon, 0.0))
    upper = 0.5 * normal[2] * np.cos(low) ** 2
    side = across * (0.5 * (0.5 * np.pi - low) - 0.25 * np.sin(2.0 * low))
    return np.asarray(2.0 * (upper + side).mean(axis=1))


def lit_light(
    horizon: NDArray[np.float32], azimuth: Values, elevation: Values, light: Values, month: Integers
) -> Values:
    """The sum (N, 12) by month of the light (H,) of those hours in which the sun stands above the horizon.

    `azimuth` (H,) is clockwise from grid north, as the horizon's directions are.
    """
    return np.asarray(
        lit_light_kernel(
            np.ascontiguousarray(horizon.T, np.float32),
            np.ascontiguousarray(azimuth % 360.0),
            np.tan(np.radians(np.minimum(elevation, 89.9))),
            np.ascontiguousarray(light),
            np.ascontiguousarray(month),
        ).T
    )


@kernel
def lit_light_kernel(
    horizon: NDArray[np.float32],
    azimuth: Values,
    tangent: Values,
    light: Values,
    month: Integers,
) -> Values:
    """`lit_light` of horizons (K, N); between two directions their tangent is linear."""
    directions, places = horizon.shape
    total = np.zeros((12, places))
    for j in range(len(light)):
        if light[j] <= 0.0:
            continue
        turn = azimuth[j] / 360.0 * directions
        sector = int(turn) % directions
        share = turn - np.floor(turn)
        next_sector = (sector + 1) % directions
        for i in range(places):
            if tangent[j] > horizon[sector, i] * (1.0 - share) + horizon[next_sector, i] * share:
                total[month[j], i] += light[j]
    return total
