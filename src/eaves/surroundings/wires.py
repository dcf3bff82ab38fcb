"""Wires and the towers that carry them, by ASPRS classes 14 and 15."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from eaves.detect.toolkit.cells import Cells
from eaves.geometry.inside import members
from eaves.geometry.neighbours import nearest
from eaves.geometry.planes import fit_planes, sums_of
from eaves.kernels import kernel
from eaves.methods import Method, parameter
from eaves.model import (
    GROUND,
    HIGH_VEGETATION,
    LOW_VEGETATION,
    MEDIUM_VEGETATION,
    UNCLASSIFIED,
    Integers,
    Labels,
    Mask,
    PointCloud,
    Points,
    Values,
)
from eaves.model.cloud import snap
from eaves.model.scene import TREE
from eaves.raster.blur import grown_by_square


class VegetationRules(Method):
    """The limits of vegetation: cells of which many pulses come back more than once, or that no plane fits.

    The limits of height are those usual with the ASPRS classes; the others were chosen by looking at one tile
    of `ign_urban`. Points a detector calls tree are vegetation in any case.
    """

    low: float = parameter(0.5, "Height up to which vegetation is low, class 3.", unit="m", ge=0.0)
    medium: float = parameter(
        2.0, "Height up to which it is medium, class 4; above, high, class 5.", unit="m", ge=0.0
    )
    cell: float = parameter(
        2.0,
        "Side of the cells, fixed to the world: a tenth of a crown, and several points in most scans.",
        unit="m",
        gt=0.0,
    )
    echoes: float = parameter(
        0.3,
        "Share of a cell's points whose pulses have several returns: facades and cars stay below it.",
        ge=0.0,
    )
    roughness: float = parameter(
        0.3,
        "RMS distance of a cell's points from their plane, upright: ten times the noise of a scan.",
        unit="m",
        ge=0.0,
    )


def vegetation_classes(
    cloud: PointCloud,
    label: Labels,
    part: NDArray[np.uint8] | None,
    height: Values,
    rules: VegetationRules,
) -> NDArray[np.uint8]:
    """Class 3, 4 or 5 of the points (N,) that are vegetation, 0 of all others."""
    classes = np.zeros(len(cloud), np.uint8)
    assert cloud.classification is not None
    free = np.flatnonzero((cloud.classification == UNCLASSIFIED) & (label == 0) & (height >= 0.0))
    if len(free) == 0:
        return classes
    returns = cloud.number_of_returns
    several = np.zeros(len(free), bool) if returns is None else returns[free] > 1
    grown = grown_cells(cloud.xyz.take(free, axis=0), several, cloud.origin, rules)
    if part is not None:
        grown |= part[free] == TREE
    chosen = free[grown]
    steps = np.searchsorted([rules.low, rules.medium], height[chosen], side="left")
    classes[chosen] = np.array([LOW_VEGETATION, MEDIUM_VEGETATION, HIGH_VEGETATION], np.uint8)[steps]
    return classes


def grown_cells(xyz: Points, several: Mask, origin: tuple[float, float], rules: VegetationRules) -> Mask:
    """Mask (N,) of the points (N, 3) about an origin in cells whose points show vegetation; `several` (N,)
    marks those whose pulse had several returns."""
    corner = [*np.mod(origin, rules.cell), -np.floor(xyz[:, 2].min())]
    xyz = snap(xyz + corner)  # cells are fixed to the world
    cells = Cells.of(xyz, rules.cell, margin=0)
    shown = cells.total(several.astype(np.float64)) >= rules.echoes * np.maximum(cells.count, 1)
    sums = sums_of(xyz, cells.cell, cells.size)
    dense = np.flatnonzero((cells.count > 3) & ~shown)
    _, normal, rmse = fit_planes(sums[dense])
    freedom = cells.count[dense] / (cells.count[dense] - 3)  # a plane takes three points
    shown[dense] = rmse * np.sqrt(freedom) >= rules.roughness * np.maximum(normal[:, 2], 0.1)
    return np.asarray(shown[cells.cell], np.bool_)


class WireRules(Method):
    """The limits of wires: points in a row, in long straight lines. The limits follow from how lines are
    built; they were chosen on simulated lines."""

    spacing: float = parameter(
        0.6, "In sparser scans too few points of a span are neighbours.", unit="m", gt=0.0
    )
    cell: float = parameter(
        1.0,
        "Side of the cells; one point is looked at in each cube half as wide: neighbours then show a row, "
        "not the noise.",
        unit="m",
        gt=0.0,
    )
    height: float = parameter(
        4.0, "Lowest height over the terrain: lines along roads hang 5 m high and more.", unit="m", ge=0.0
    )
    neighbours: int = parameter(
        4, "Number of neighbours of a point, no farther than as many cells, that lie in a row with it.", ge=2
    )
    few: int = parameter(
        16,
        "Largest number of points, one in each cube, in three by three cells and one layer as high as "
        "wires hang: a roof has 36, and half of it 18.",
        ge=1,
    )
    across: float = parameter(
        0.15,
        "Largest standard deviation across a row, for noise and sag; and as a share of that along it, too.",
        unit="m",
        gt=0.0,
    )
    length: float = parameter(
        25.0, "Least length of a line: shorter are branches, gutters and handrails.", unit="m", gt=0.0
    )
    upright: float = parameter(
        4.0, "Least ratio of a tower's height to its width halfway up: a tree has less.", gt=0.0
    )
    gap: float = parameter(
        0.25,
        "Largest gap from the terrain to a tower's top, in its height: a tree under a wire does not reach "
        "it.",
        gt=0.0,
    )


RULES = WireRules()


def find_wires(cloud: PointCloud, height: Values, spacing: float, rules: WireRules = RULES) -> Mask:
    """The points (N,) of wires.

    Parameters
    ----------
    cloud : classified, N points about the origin of a block.
    height : of the points over the terrain (N,), m.
    spacing : mean distance (m) of neighbouring points.
    rules : what counts as a wire.
    """
    on_wire = np.zeros(len(cloud), bool)
    assert cloud.classification is not None
    high = np.flatnonzero((height >= rules.height) & (cloud.classification != GROUND) & ~cloud.noise)
    if spacing > rules.spacing or len(high) <= rules.neighbours:
        return on_wire
    xyz = cloud.xyz.take(high, axis=0)
    cells = Cells.of(xyz, rules.cell, margin=0)
    cell, shape = cells.cell, cells.shape
    hanging = np.flatnonzero(top_in_air_kernel(cell, cells.size, xyz[:, 2], 0.5 * rules.height))
    sample = hanging[one_each(xyz.take(hanging, axis=0), 0.5 * rules.cell)]
    sample = sample[
        few_around(cell[sample], (height[high[sample]] / rules.height).astype(np.int64), shape, rules.few)
    ]
    row = sample[wire_rows(xyz[sample], rules)]
    lines = lines_among(cell[row], shape, rules)
    row = row[lines.ravel()[cell[row]]]
    if len(row):  # what hangs beside a point of a line is of the line
        close = hanging[grown_by_square(lines, 3).ravel()[cell[hanging]]]
        _, away = nearest(xyz[close], xyz[row], 1)
        on_wire[high[close[away[:, 0] < rules.cell]]] = True
    return on_wire


def find_towers(
    cloud: PointCloud, wires: Mask, excluded: Mask, height: Values, rules: WireRules = RULES
) -> Mask:
    """The points (N,) of slender groups that stand on the ground and are as high as a wire, within two cells.

    Parameters
    ----------
    cloud : classified, N points about the origin of a block.
    wires : the points of wires (N,).
    taken : points (N,) that are something else.
    height : of the points over the terrain (N,), m.
    rules : what counts as a tower.
    """
    towers = np.zeros(len(cloud), bool)
    if not wires.any():
        return towers
    assert cloud.classification is not None
    cells = Cells.of(cloud.xyz, rules.cell, margin=0)
    lowest = cells.extreme(np.where(wires, height, np.inf), highest=False)
    beside = ndimage.minimum_filter(lowest.reshape(cells.shape), 5)
    free = (
        (cloud.classification == UNCLASSIFIED) & ~wires & ~excluded & np.isfinite(beside.ravel()[cells.cell])
    )
    top = cells.extreme(np.where(free, height, -np.inf)).reshape(cells.shape)
    group, count = ndimage.label(top >= beside - 2.0 * rules.cell, np.ones((3, 3)))
    for points in members(np.where(free, group.ravel()[cells.cell], 0) - 1, count):
        highest = float(height[points].max())
        core = points[np.abs(height[points] - 0.5 * highest) <= 0.25 * highest]
        gap = float(np.diff(np.sort(height[points]), prepend=0.0).max())
        if len(core) and gap <= rules.gap * highest:
            towers[points] = highest >= rules.upright * np.ptp(cloud.xyz[core, :2], axis=0).max()
    return towers


@kernel
def top_in_air_kernel(cell: Integers, size: int, z: Values, air: float) -> Mask:
    """Mask (K,) of the high points that are the topmost of their cell, within `air` (m), with as much beneath
    them empty or in the cell nothing else: crowns reach down."""
    top, low, beneath = np.full(size, -np.inf), np.full(size, np.inf), np.full(size, -np.inf)
    for i in range(len(z)):
        top[cell[i]] = max(top[cell[i]], z[i])
    for i in range(len(z)):
        if top[cell[i]] - z[i] <= air:
            low[cell[i]] = min(low[cell[i]], z[i])
        else:
            beneath[cell[i]] = max(beneath[cell[i]], z[i])
    in_air = np.empty(len(z), np.bool_)
    for i in range(len(z)):
        here = cell[i]
        in_air[i] = top[here] - z[i] <= air and low[here] - beneath[here] > air
    return in_air


def one_each(xyz: Points, side: float) -> Integers:
    """Numbers of the points (K, 3), the first of each cube of a side (m)."""
    place = np.floor(xyz / side).astype(np.int64)
    place -= place.min(axis=0)
    _, first = np.unique(np.ravel_multi_index(tuple(place.T), place.max(axis=0) + 1), return_index=True)
    return np.sort(first)


def few_around(cell: Integers, layer: Integers, shape: tuple[int, int], few: int) -> Mask:
    """Mask (K,) of the points that, by cell and layer, have so few about them that they may be of wires."""
    layers = int(layer.max(initial=0)) + 1
    place = cell * layers + layer
    count = np.bincount(place, minlength=shape[0] * shape[1] * layers).reshape(*shape, layers)
    around, (row, column) = np.pad(count, ((1, 1), (1, 1), (0, 0))), np.divmod(cell, shape[1])
    total = sum(around[row + down, column + right, layer] for down in range(3) for right in range(3))
    return np.asarray(total <= few, np.bool_)


def wire_rows(xyz: Points, rules: WireRules) -> Mask:
    """Mask (K,) of the points (K, 3) that lie in a row with their neighbours, more level than upright."""
    reach = rules.neighbours * rules.cell
    row = np.zeros(len(xyz), bool)
    if len(xyz) <= rules.neighbours:
        return row
    neighbours, away = nearest(xyz, xyz, rules.neighbours + 1)
    crowded = np.flatnonzero(away[:, rules.neighbours] < reach)
    group = xyz[neighbours[crowded]]
    group -= group.mean(axis=1, keepdims=True)
    moments = np.einsum("kma,kmb->kab", group, group) / (rules.neighbours + 1)
    # where the two smaller eigenvalues are small beside the largest, so are the minors beside the trace
    least, size = rules.across**2, np.trace(moments, axis1=1, axis2=2)
    minors = 0.5 * (size**2 - (moments**2).sum(axis=(1, 2)))
    thin = np.flatnonzero(minors <= (2.0 * size + least) * least * np.minimum(size, 1.0) + 1e-9)
    values, vectors = np.linalg.eigh(moments[thin])
    straight = values[:, 1] <= least * np.minimum(values[:, 2], 1.0)
    row[crowded[thin]] = straight & (vectors[:, 2, 2] ** 2 <= 0.5)
    return row


def lines_among(cell: Integers, shape: tuple[int, int], rules: WireRules) -> Mask:
    """The cells (H, W) of long lines among the cells (K,) of points in rows; between two of a line up to two
    may be empty."""
    occupied = np.zeros(shape, bool)
    occupied.ravel()[cell] = True
    group, count = ndimage.label(grown_by_square(occupied, 3), np.ones((3, 3)))
    group = np.where(occupied, group, 0)
    lines = np.zeros(count + 1, bool)
    for k, window in enumerate(ndimage.find_objects(group), 1):
        length = 0.0 if window is None else float(np.hypot(*(side.stop - side.start for side in window)))
        lines[k] = rules.cell * length >= rules.length
    return np.asarray(lines[group], np.bool_)
