"""The default detector: all evidence weighed on surfaces, borders settled by a graph cut."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from scipy import ndimage

from eaves.detect.consensus.borders import cut_cells
from eaves.detect.consensus.classifier import judge_cells, judge_segments, score_regions
from eaves.detect.consensus.evidence import Evidence, gather_evidence
from eaves.detect.consensus.hidden_roofs import find_hidden_roofs
from eaves.detect.consensus.members import part_of_points
from eaves.detect.consensus.segments import Segments, find_segments, square_width
from eaves.detect.consensus.vehicles import measure_tops
from eaves.detect.consensus.voids import find_roof_voids, raise_rims
from eaves.detect.consensus.windows import LEAST_POINTS
from eaves.detect.stage import MIN_HEIGHT_M, Detector
from eaves.detect.toolkit.cells import side_near
from eaves.methods import Emit, ignore, parameter
from eaves.model import Labels, Mask, Points, Regions, Scene, Values
from eaves.model.scene import ROOF
from eaves.raster.nearest import near_cells

RIM_ODDS = 3.0
"""Log odds of the rim of a roof that swallows the beam."""
VEHICLE_MOST_M2 = 60.0
"""An articulated lorry, with the cells at its rim, is no larger."""
SMALL_SEGMENT_M2 = 2.0
"""Smaller surfaces say no more than their cells do."""
CORE_SHARE, CORE_SHARE_M = 0.4, 0.18
"""Least share of roof surfaces in a building, and the same times the cells' side (m): windows three cells
wide fit into less of a face the wider the cells are."""


class Consensus(Detector):
    """Building labels from planes, echoes, penetration, height, size and width together.

    Points well above the terrain are gathered in cells about one spacing wide. Each cell is given the
    best plane of the windows, three and two cells wide, that hold it, so ridges and eaves are as flat as
    the faces beside them and crowns never are. Cells of agreeing planes form surfaces, and each surface
    is judged as a whole: area, width, residual, height, the share of pulses with several echoes, the
    share of points that reach the ground through it. Cells in no surface (walls, chimneys, machinery,
    crowns) are judged by their echoes; a hole in the data with a level, raised rim is a roof of glass or
    water. A graph cut then finds the labelling of least energy, in which neighbours whose surfaces
    continue each other want the same label and a jump in height lets them part. Connected cells with a
    core of roof surfaces are buildings; their planes are carried on below crowns; narrow long ones with a
    level top are vehicles.

    Energy: Σ_cells odds(c)·[label(c) is against its odds] + λ Σ_neighbours exp(-(d/s)²)·[labels differ],
    where d is how far the highest points miss each other's surface.

    Fidelity
    --------
    No paper: it takes planarity from [chen_sun_vaihingen], echoes and connected components
    from [xiao2014], the order of splitting vegetation before the size threshold from [ren_fcs], segment
    statistics from [roof_attributes], and the opening by width from [maas_vosselman1999]. The weights of a
    surface's odds come from one logistic regression over about 1,900 surfaces of eight simulated towns (1 to
    25 points/m², with and without returns) and five public scans; they are rounded, and the same for all
    data.

    Fails where
    -----------
    Dense clipped hedges over 2 m high and wide; roofs wholly covered by crowns; glass roofs seen through;
    containers and site huts are buildings when wider than a vehicle; sheds narrower than three cells at 1
    point/m². Without returns crowns that touch a roof at its height may be taken for part of it.

    Complexity
    ----------
    Linear in points and cells but for the cut, which runs over the undecided cells only.

    References
    ----------
    [chen_sun_vaihingen], [xiao2014], [ren_fcs], [roof_attributes], [maas_vosselman1999]
    """

    name: ClassVar[str] = "consensus"
    idea: ClassVar[str] = (
        "planes, echoes, penetration, size and height judged together; borders by a graph cut"
    )
    paper: ClassVar[str] = "chen_sun_vaihingen"

    cell: float | None = parameter(
        None, "Side of a cell; default: 1.2 spacings, at least 0.5.", unit="m", gt=0.0
    )
    min_height: float = parameter(
        1.5, "Points lower than this over the terrain are no roof.", unit="m", ge=0.0
    )
    max_residual: float = parameter(
        0.12, "A window whose plane has a larger RMSE is no surface.", unit="m", gt=0.0
    )
    max_gap: float = parameter(
        0.12, "Planes of neighbouring cells that differ more are two surfaces.", unit="m", gt=0.0
    )
    smoothness: float = parameter(
        2.5, "Price (log odds) of two neighbours called differently.", symbol="λ", ge=0.0
    )
    max_jump: float = parameter(
        0.7, "A jump in height at which neighbours part easily.", unit="m", symbol="s", gt=0.0
    )
    sure: float = parameter(
        6.0, "Cells with larger odds (log) either way are settled before the cut.", gt=0.0
    )
    max_rough: float = parameter(
        6.0, "Cells farther than this from a roof surface are no building.", unit="m", gt=0.0
    )
    min_core: float = parameter(3.0, "Least area of roof surfaces in a building.", unit="m²", ge=0.0)
    min_width: float = parameter(1.5, "Side of a square that fits into every building.", unit="m", ge=0.0)

    @property
    def buffer(self) -> float:
        return 30.0

    def label(self, scene: Scene, emit: Emit = ignore) -> Regions:
        candidate = (scene.height >= self.min_height) & ~scene.cloud.ground & ~scene.cloud.noise
        if int(candidate.sum()) < LEAST_POINTS:
            return Regions(np.zeros(len(scene.cloud), np.int32), np.zeros(0))
        xyz = scene.cloud.xyz - [0.0, 0.0, np.floor(scene.cloud.xyz[candidate, 2].min())]
        side = self.cell or side_near(max(0.5, 1.2 * scene.spacing))
        echoes = scene.cloud.has_returns

        evidence = gather_evidence(scene, xyz, candidate, side)
        emit("residual", evidence.residual)
        smooth = evidence.candidate & (evidence.residual < self.max_residual)
        segments = find_segments(evidence, smooth, self.max_gap, MIN_HEIGHT_M)
        emit("segments", segments.label)
        odds, roof = self.judge(evidence, segments, echoes)
        emit("odds", odds)
        void, rims = find_roof_voids(evidence)
        odds, roof = raise_rims(odds, rims, RIM_ODDS), roof | void
        odds = np.where(near_cells(roof, int((self.max_rough / side) ** 2 + 1e-9)), odds, -self.sure)
        building = void | cut_cells(evidence, odds, self.sure, self.smoothness, self.max_jump)
        emit("cut", building)
        region = self.keep_buildings(building, roof, evidence)
        emit("regions", region)
        surface = roof & (evidence.residual < self.max_residual)
        hidden = find_hidden_roofs(evidence, xyz, ~scene.cloud.noise, region, surface)
        emit("hidden", hidden)
        return self.regions_of(scene, xyz, evidence, region, hidden, odds)

    def judge(self, evidence: Evidence, segments: Segments, echoes: bool) -> tuple[Values, Mask]:
        """Log odds of every cell, and the cells of roof surfaces; (H, W) each."""
        surface = judge_segments(segments, echoes)
        emitted = np.r_[0.0, surface][segments.label]
        large = np.r_[False, segments.area >= SMALL_SEGMENT_M2][segments.label]
        odds = np.where(large, emitted, judge_cells(evidence, self.max_residual, echoes))
        return odds, emitted > 0.0

    def keep_buildings(self, building: Mask, roof: Mask, evidence: Evidence) -> Labels:
        """Numbers (H, W) of the connected groups of building cells that have a core of roof surfaces."""
        found, count = ndimage.label(building, np.ones((3, 3)))
        label: Labels = np.asarray(found, np.int32)
        side = evidence.cells.side
        area = np.bincount(label.ravel(), minlength=count + 1) * side * side
        core = np.bincount(label.ravel(), weights=roof.ravel(), minlength=count + 1) * side * side
        width = np.r_[0.0, square_width(label, count) * side]
        share = min(CORE_SHARE, CORE_SHARE_M / side)
        good = (core >= self.min_core) & (core >= share * area) & (width >= self.min_width)
        good[0] = False
        kept = np.where(good, np.arange(count + 1), 0).astype(np.int32)
        return np.asarray(kept[label], np.int32)

    def regions_of(
        self, scene: Scene, xyz: Points, evidence: Evidence, region: Labels, hidden: Labels, odds: Values
    ) -> Regions:
        """The points of the buildings' cells, without vehicles, their parts, and the buildings' scores."""
        above = ~scene.cloud.ground & ~scene.cloud.noise & (scene.height > 0.5)
        number = np.where(above, region.ravel()[evidence.cells.cell], 0).astype(np.int32)
        part = part_of_points(xyz, number, evidence, region, self.max_residual)
        number = np.where(hidden > 0, hidden, number)
        part[hidden > 0] = ROOF
        size = np.bincount(region.ravel()) * evidence.cells.side**2
        small = np.where(size[number] <= VEHICLE_MOST_M2, number, 0)
        tops = measure_tops(xyz, scene.height, np.where(part == ROOF, small, 0), len(size))
        part[tops.vehicle[number]] = 0
        number[tops.vehicle[number]] = 0
        return Regions(number, score_regions(region, odds, tops.width[1:], tops.low[1:]), part)
