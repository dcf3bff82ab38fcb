"""Terrain that an opening took for an object: wide, and joined to the ground without a step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.ground.toolkit.plateaus import LOOK_CELLS, PlateauRules
from eaves.kernels import kernel
from eaves.methods import Method, parameter
from eaves.model import Labels, Mask, Raster
from eaves.raster.groups import BESIDE, group_cells, neighbour_pairs
from eaves.raster.nearest import ADJOINING, near_cells


class Tolerance(Method):
    """Tolerance for points off a surface that is rough by itself."""

    tolerance_gain: float = parameter(7.0, "Tolerance of a surface, in roughnesses.", symbol="t/ρ", ge=0)
    tolerance_least: float = parameter(0.1, "The same, at least.", unit="m", symbol="t", ge=0)
    tolerance_most: float = parameter(0.4, "The same, at most.", unit="m", symbol="t", ge=0)

    def tolerance(self, roughness: float) -> float:
        """Largest distance, along z, m, from a level surface of what belongs to it."""
        return min(self.tolerance_most, max(self.tolerance_least, self.tolerance_gain * roughness))


class TerraceRules(PlateauRules, Tolerance):
    """When an object cell is terrain."""

    level_share: float = parameter(
        0.3,
        "A piece of `wide_area` that meets the ground level on more of its rim is terrain; one of sixteen "
        "times the area, on half as much.",
        ge=0,
        le=1,
    )
    terrace_steep: float = parameter(
        0.2,
        "Share of the height difference that counts as residual where the slope goes on: walls go on too.",
        ge=0,
        le=1,
    )


def find_terraces(surface: Raster, objects: Mask, occupied: Mask, rules: TerraceRules) -> Mask:
    """The object cells (H, W) that are terrain.

    Object cells that continue each other within the tolerance of the ground's roughness make a piece. Its rim
    is counted where it meets the ground: level, or as a step down; both cells must hold a point, for one
    interpolated between them makes a slope of a low wall. A roof meets the ground by steps on nearly all
    sides, also when it is flush with the ground uphill; a spur, a terrace, or a high field at the rim of the
    data does not. So a piece is terrain when more than `level_share` of its counted rim is level; so is a
    wide and broad one that nearly nowhere falls by a `wall`, such as a strip of a terrace cut by the rim of
    the data. The smaller a piece, the shorter its rim and the more of it must be level: the share goes with
    the fourth root of `wide_area` over its area.
    """
    z = surface.values.astype(np.float64)
    residual = residual_kernel(z, rules.terrace_steep)
    ground = occupied & ~objects
    beside = [ground[:, :-1] & ground[:, 1:], ground[:-1] & ground[1:]]
    even = np.concatenate([residual[0][:, :-1][beside[0]], residual[1][:-1][beside[1]]])
    step = rules.tolerance(float(np.median(even)) if len(even) else 0.0)
    piece, count = terrace_pieces(objects, residual, step)
    # cells without a point of their own kind beside them were interpolated, and have no area
    held = objects & near_cells(occupied & objects, ADJOINING)
    size = np.bincount(piece[held], minlength=count + 1) * surface.cell**2
    level, down, high = rim_kernel(objects, piece, count, residual, z, step, occupied, rules.wall)
    broad = np.bincount(piece[~near_cells(~objects, (2 * LOOK_CELLS) ** 2)], minlength=count + 1) > 0
    share = rules.level_share * (rules.wide_area / np.maximum(size, surface.cell**2)) ** 0.25
    terrain = level > share * (level + down)
    terrain |= broad & (size >= rules.wide_area) & (high <= (1.0 - rules.wall_share) * (level + down))
    terrain[0] = False
    return np.asarray(terrain[piece])


def terrace_pieces(objects: Mask, residual: NDArray[np.float64], step: float) -> tuple[Labels, int]:
    """Numbers (H, W) of object cells joined by residuals under `step`, 0 elsewhere; how many there are."""
    one, two = neighbour_pairs(objects, steps=BESIDE)
    columns = objects.shape[1]
    joined = residual[np.where(two - one == columns, 1, 0), *np.divmod(one, columns)] < step
    return group_cells(objects, one[joined], two[joined])


@kernel
def residual_kernel(z: NDArray[np.float64], steep_share: float) -> NDArray[np.float64]:
    """Misfit (2, H, W), m, of each cell continued into its neighbour east (0) and south (1).

    The height difference, or its deviation from the difference just before or just after, whichever is least:
    a steep but even slope goes on, a wall between two levels does not.
    """
    rows, columns = z.shape
    residual = np.full((2, rows, columns), np.inf)
    for row in range(rows):
        for column in range(columns):
            for k in range(2):
                r, c = row + k, column + 1 - k
                if r >= rows or c >= columns:
                    continue
                here = z[r, c] - z[row, column]
                before, after = 0.0, 0.0
                if row - k >= 0 and column - 1 + k >= 0:
                    before = z[row, column] - z[row - k, column - 1 + k]
                if r + k < rows and c + 1 - k < columns:
                    after = z[r + k, c + 1 - k] - z[r, c]
                bend = min(abs(here - before), abs(here - after)) + steep_share * abs(here)
                residual[k, row, column] = min(abs(here), bend)
    return residual


@kernel
def rim_kernel(
    objects: Mask,
    piece: Labels,
    count: int,
    residual: NDArray[np.float64],
    z: NDArray[np.float64],
    step: float,
    known: Mask,
    wall: float,
) -> NDArray[np.float64]:
    """Cell sides (3, count + 1) where each piece meets ground without a step, where it steps down, and where
    it does by more than `wall` (m).
    """
    rims = np.zeros((3, count + 1))
    rows, columns = objects.shape
    for row in range(rows):
        for column in range(columns):
            for k in range(2):
                r, c = row + k, column + 1 - k
                if r >= rows or c >= columns or piece[r, c] == piece[row, column]:
                    continue
                if not known[r, c] or not known[row, column]:
                    continue
                if residual[k, row, column] < step:
                    if objects[row, column] != objects[r, c]:
                        rims[0, piece[row, column]] += 1
                        rims[0, piece[r, c]] += 1
                    continue
                upper = piece[row, column] if z[r, c] < z[row, column] else piece[r, c]
                rims[1, upper] += 1
                rims[2, upper] += abs(z[r, c] - z[row, column]) > wall
    return rims
