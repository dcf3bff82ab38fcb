"""The default detector: all evidence weighed on surfaces, borders settled by a graph cut."""

from __future__ import annotations

import math
import sys
from typing import ClassVar, Self

import numpy as np
from scipy import ndimage

from eaves.detect.consensus.classifier import (
    FITTED,
    DoubtRules,
    EvidenceRules,
    Terms,
    Weights,
    cell_odds,
    is_even,
    measured_terms,
    object_doubts,
    read_weights,
    region_doubts,
    score_regions,
    surface_odds,
    unevenness_of,
    void_doubts,
)
from eaves.detect.consensus.evidence import (
    COLOURS,
    WINDOW,
    Counts,
    Evidence,
    Segments,
    Separation,
    WindowRules,
    count_signs,
    find_segments,
    gather_evidence,
    has_colours,
    learned,
    signs_of_leaves,
)
from eaves.detect.consensus.groups import (
    VehicleRules,
    VoidRules,
    attached_share,
    cut_cells,
    find_hidden_roofs,
    find_roof_voids,
    find_vehicles,
    part_of_points,
    without_narrow_parts,
    without_pores,
)
from eaves.detect.stage import MIN_HEIGHT_M, ROOM_M, Detector
from eaves.detect.toolkit.cells import side_near
from eaves.methods import Emit, ignore, parameter
from eaves.model import WATER, Labels, Mask, Points, Regions, Scene, Values
from eaves.model.scene import ROOF
from eaves.raster.blur import height_kept

CELL_SPACINGS, WIDE_CELL_M, LEAST_CELL_M = 1.4, 1.0, 0.5
"""The rule for `cell`: its width in spacings up to a wide cell (m), above it one spacing, and at least so
many metres. A cell of 1.4 spacings holds two points; of cells of one spacing a third is empty by chance,
which cuts roofs to pieces. But wider than a metre they are as large as what stands on roofs and in gardens.
Chosen on `delft` and `ign_urban`, thinned."""
LEAST_TOLERANCE_M, TOLERANCE = 0.12, 0.11
"""The rule for `max_residual`: noise (m) of old scanners on a plane, and the share of the spacing by which
windows that span a ridge miss one plane."""
ROUGH_GAIN = 7.0
"""Largest residual in roughnesses, as the ground filter's `tolerance_gain`."""


class Consensus(DoubtRules, VehicleRules, VoidRules, EvidenceRules, WindowRules, Detector):
    """Building labels from planes, echoes, penetration, height, size and width together.

    Points well above the terrain are gathered in cells of about two points. Each cell is given the best
    plane of the windows, three and two cells wide, that hold it, so ridges and eaves are as flat as the
    faces beside them and crowns never are. Cells of agreeing planes form surfaces, and each surface is
    judged as a whole: area, width, residual, height, smooth company, roofs on all sides, the share of
    pulses with several echoes, the share of points that reach the ground through it. Cells in no surface
    (walls, chimneys, machinery, crowns) are judged by what applies to them, and by how far they lie from
    the nearest roof and how high over its plane carried on: crowns lean on houses and stand above them.
    How much echoes and penetration count is measured in the scan itself, by how far they lie apart on its
    own roofs and crowns: a scan that does not split pulses is judged by shape, and nothing jumps in
    between. No crown is large and even: there echoes do not speak against a roof of glass or slats. A
    hole in the data with a level, raised rim is a roof of glass or water. A graph cut then finds the
    labelling of least energy, in which neighbours whose surfaces continue each other want the same label
    and a jump in height lets them part.
    Connected cells with a core of roof surfaces are buildings, unless most of their rim goes on in the
    terrain; their planes are carried on below crowns; narrow long ones with a level top are vehicles.

    Formula
    -------
    Energy: Σ_cells odds(c)·[label(c) is against its odds] + λ Σ_neighbours exp(-(d/s)²)·[labels differ],
    where d is how far the highest points miss each other's surface. Log likelihood ratio of a share v of
    several returns: trust · (μ_roof - μ_crown) / σ² · (v - (μ_roof + μ_crown) / 2), the means and σ over the
    cells of the scene, found with the odds by expectation maximisation; likewise penetration.

    Fidelity
    --------
    No paper: it takes planarity from [chen_sun_vaihingen], echoes and connected components
    from [xiao2014], the order of splitting vegetation before the size threshold from [ren_fcs], segment
    statistics from [roof_attributes], and the opening by width from [maas_vosselman1999]. The weights of the
    odds come from one logistic regression over surfaces and cells of 24 simulated towns (0.3 to 30 points/m²,
    all, few or no echoes) and ten public scans with thinned variants; they are rounded, and the same for all
    data. `benchmarks.accuracy.unseen` shows what they are worth on scans left out of it.

    Fails where
    -----------
    Dense clipped hedges over 2 m high and wide; roofs wholly covered by crowns; glass roofs seen through;
    containers and site huts are buildings when wider than a vehicle; so are ships, with a doubt where water
    is all round; sheds narrower than three cells at 1 point/m² are lost. Without returns crowns that touch a
    roof at its height, or stand in a court, may be taken for part of it. A scene that is all forest has no
    roofs to compare its crowns with: shape alone judges it. The means are those of a block of 240 m with 30 m
    around it, of colours 600 m: what stands farther away changes nothing.

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
    wants: ClassVar[tuple[str, ...]] = COLOURS

    cell: float | None = parameter(
        None,
        "Side of a cell; default: 1.4 spacings up to 1, beyond it one spacing, at least 0.5.",
        unit="m",
        gt=0.0,
    )
    roughness: float = parameter(
        0.0,
        "Roughness of the scan beyond that of laser scans; seven times as much is added to `max_residual`. "
        "A run measures it.",
        unit="m",
        ge=0.0,
    )
    kept: float = parameter(
        1.0,
        "Share of its height that a narrow house keeps where walls are smoothed; heights of roofs are "
        "lower by as much. A run measures it.",
        gt=0.0,
        le=1.0,
    )
    min_height: float = parameter(
        1.5, "Points lower than this over the terrain are no roof.", unit="m", ge=0.0
    )
    max_residual: float | None = parameter(
        None,
        "A window whose plane has a larger RMSE is no surface, and planes of neighbouring cells that differ "
        "more are two; default: 0.11 spacings, at least 0.12.",
        unit="m",
        gt=0.0,
    )
    smoothness: float = parameter(
        2.5, "Price (log odds) of two neighbours called differently.", symbol="λ", ge=0.0
    )
    max_jump: float = parameter(
        0.7, "A jump in height at which neighbours part easily.", unit="m", symbol="s", gt=0.0
    )
    max_attached: float = parameter(
        0.5, "A region that goes on in the terrain along a larger share of its rim is rock.", ge=0.0, le=1.0
    )
    weights: str | None = parameter(
        None,
        "Weights of the evidence, a file (JSON) or the JSON itself; default: those fitted to all labelled "
        "surveys.",
    )
    room: float = parameter(
        ROOM_M,
        "Parts of a building that no square so wide fits into are fences and hedges: a room is wider.",
        unit="m",
        ge=0.0,
    )
    continues: float = parameter(
        0.3,
        "Terrain that misses a region's carried-on surface by less goes on from it: two steps of a stair.",
        unit="m",
        gt=0.0,
    )
    wall_below_plane: float = parameter(
        0.5, "At a building's rim a point this far under its cell's plane is on the wall.", unit="m", gt=0.0
    )

    @property
    def buffer(self) -> float:
        return 30.0

    @property
    def signs_buffer(self) -> float:
        return 600.0

    def label(self, scene: Scene, emit: Emit = ignore) -> Regions:
        candidate = self.candidates(scene)
        if int(candidate.sum()) < self.window_points:
            return Regions(np.zeros(len(scene.cloud), np.int32), np.zeros(0))
        xyz, evidence, segments = self.find_surfaces(scene, candidate)
        emit("residual", evidence.residual)
        emit("segments", segments.label)
        voids = find_roof_voids(evidence, self)
        most = self.tolerance(scene.spacing)
        colours, weights = self.colours_of(scene, evidence, segments), self.judged_by
        if colours is not None:
            weights = weights.of_colours()
        judged = evidence.candidate | voids[0]
        terms = measured_terms(evidence, segments, judged, most, weights, self, colours)
        # sharpened relief looks like roofs: where colours tell nothing, shape is no evidence
        told = 1.0 if colours is None or self.kept == 1.0 else colours.trust
        unsure = max(math.log(told or sys.float_info.min), -2.0 * self.most_log_ratio)
        building, roof, odds = self.settle(evidence, segments, terms, weights, voids, unsure, emit)
        even = np.r_[False, is_even(segments, most, self)][segments.label]  # in a crown a pore is no roof
        building = without_pores(building, even * segments.label, evidence.cells.side, self.room)
        region, attached, rocks = self.keep_buildings(building, roof, evidence)
        emit("regions", region)
        surface = roof & (segments.label > 0)
        hidden = find_hidden_roofs(evidence, xyz, ~scene.cloud.noise, region, surface, most, self.enclosed)
        emit("hidden", hidden)
        regions = self.regions_of(scene, xyz, evidence, region, hidden, odds)
        water = wet_cells(scene, evidence)
        crowns_pass = terms.told.echoes.power < 0.5  # the means are less than one spread apart
        roofs = surface if crowns_pass else np.zeros_like(surface)
        doubts = void_doubts(evidence, voids[0] & (region > 0))
        for groups, score, uneven in (
            (region, regions.score, unevenness_of(evidence, roofs)),
            (rocks, np.zeros(rocks.max(initial=0)), np.full(evidence.shape, np.nan)),
        ):
            doubts += region_doubts(evidence, groups, score, attached, water, self.max_attached, uneven, self)
        if not scene.cloud.has_returns:
            doubts += object_doubts(evidence, region > 0, odds, most, MIN_HEIGHT_M * self.kept)
        return regions.with_doubts(doubts)

    def find_surfaces(self, scene: Scene, candidate: Mask) -> tuple[Points, Evidence, Segments]:
        """Points (N, 3) with heights counted from near them, the evidence of cells, the smooth surfaces."""
        xyz, evidence, smooth = self.gather(scene, candidate)
        most, tall = self.tolerance(scene.spacing), MIN_HEIGHT_M * self.kept
        return xyz, evidence, find_segments(evidence, smooth, most, tall)

    def gather(self, scene: Scene, candidate: Mask) -> tuple[Points, Evidence, Mask]:
        """Points (N, 3) with heights counted from near them, evidence of cells, the smooth cells (H, W)."""
        xyz = scene.cloud.xyz.copy()
        z = xyz[:, 2]
        z -= np.floor(z.min(where=candidate, initial=z.max()))
        wide = min(CELL_SPACINGS * scene.spacing, WIDE_CELL_M)
        side = self.cell or side_near(max(LEAST_CELL_M, scene.spacing, wide))
        evidence = gather_evidence(scene, xyz, candidate, side, self)
        return xyz, evidence, evidence.candidate & (evidence.residual < self.tolerance(scene.spacing))

    def count_signs(self, scene: Scene) -> Counts | None:
        candidate = self.candidates(scene)
        if not has_colours(scene.cloud) or int(candidate.sum()) < self.window_points:
            return None
        return self.signs_of(scene, *self.gather(scene, candidate)[1:])

    def signs_of(self, scene: Scene, evidence: Evidence, smooth: Mask) -> Counts:
        """Signs of leaves, counted on the terrain, on rough places over it and on smooth ones (H, W)."""
        share, terrain = evidence.multi_return_share, signs_of_leaves(scene.cloud)[scene.cloud.ground]
        return count_signs(terrain, share[evidence.candidate & ~smooth], share[smooth])

    def colours_of(self, scene: Scene, evidence: Evidence, segments: Segments) -> Separation | None:
        """What colours tell where they stand for echoes; None where they do not."""
        if not has_colours(scene.cloud):
            return None
        counts = self.signs_of(scene, evidence, segments.label > 0) if scene.signs is None else scene.signs
        return learned(counts, WINDOW**2)

    def tolerance(self, spacing: float) -> float:
        """The largest residual (m) of a surface in a scan of that spacing (m)."""
        least = self.max_residual or max(LEAST_TOLERANCE_M, TOLERANCE * spacing)
        return least + ROUGH_GAIN * self.roughness

    def for_scan(self, blur: float, roughness: float) -> Self:
        return self.unless_set(roughness=roughness, kept=height_kept(blur))

    def candidates(self, scene: Scene) -> Mask:
        """The points (N,) that could be roofs."""
        return (scene.height >= self.min_height * self.kept) & ~scene.cloud.ground & ~scene.cloud.noise

    def settle(
        self,
        evidence: Evidence,
        segments: Segments,
        terms: Terms,
        weights: Weights,
        voids: tuple[Mask, Mask],
        unsure: float,
        emit: Emit = ignore,
    ) -> tuple[Mask, Mask, Values]:
        """The building cells, those of roof surfaces, the log odds of the cells that were judged; (H, W)
        each. `voids` are the roofs without points and their rims, as `find_roof_voids` says; `unsure` is
        added to all log odds."""
        emitted = surface_odds(segments, terms.surface, weights, self.most_log_ratio) + unsure
        odds = np.r_[0.0, emitted][segments.label]
        roof = (odds > 0.0) | voids[0]
        of_cells = cell_odds(terms.shape, terms.told, weights) + unsure
        odds[terms.cells] = np.where(terms.large[terms.cells], odds[terms.cells], of_cells)
        emit("odds", odds)
        sure = 2.0 * self.most_log_ratio  # both measures, at their most
        building = voids[0] | voids[1] | cut_cells(evidence, odds, sure, self.smoothness, self.max_jump)
        emit("cut", building)
        return building, roof, odds

    @property
    def judged_by(self) -> Weights:
        """The weights of the evidence."""
        return FITTED if self.weights is None else read_weights(self.weights)

    def keep_buildings(self, building: Mask, roof: Mask, evidence: Evidence) -> tuple[Labels, Values, Labels]:
        """Numbers (H, W) of the connected groups of building cells that have a core of roof surfaces; the
        share of each group's rim that continues the terrain; the groups (H, W) dropped for that alone, and
        not without doubt."""
        building = without_narrow_parts(building, evidence, self.room)
        found, count = ndimage.label(building, np.ones((3, 3)))
        label: Labels = np.asarray(found, np.int32)
        core = np.bincount(label.ravel(), weights=roof.ravel(), minlength=count + 1)
        good = core > 0
        good[0] = False
        attached = attached_share(evidence, label, count, self.continues)
        loose = attached <= self.max_attached
        rock = good & ~loose & (attached <= 1.0 - self.max_attached / 2)

        def chosen(which: Mask) -> Labels:
            return np.asarray(np.where(which, np.arange(count + 1), 0).astype(np.int32)[label], np.int32)

        return chosen(good & loose), attached, chosen(rock)

    def regions_of(
        self, scene: Scene, xyz: Points, evidence: Evidence, region: Labels, hidden: Labels, odds: Values
    ) -> Regions:
        """The points of the buildings' cells, without vehicles, their parts, and the buildings' scores."""
        above = ~scene.cloud.ground & ~scene.cloud.noise & (scene.height > 0.5)
        number = np.where(above, region.ravel()[evidence.cells.cell], 0).astype(np.int32)
        part = part_of_points(
            xyz,
            number,
            evidence,
            region,
            self.tolerance(scene.spacing),
            self.wall_below_plane,
        )
        number = np.where(hidden > 0, hidden, number)
        part[hidden > 0] = ROOF
        on_top = np.where(part == ROOF, number, 0)
        vehicle = find_vehicles(xyz, scene.height, on_top, int(region.max(initial=0)) + 1, self)[number]
        part[vehicle] = 0
        number[vehicle] = 0
        score = score_regions(region, odds, self.judged_by.score)
        return Regions(number, score, part)


def wet_cells(scene: Scene, evidence: Evidence) -> Mask:
    """The cells (H, W) with a point that the scene calls water."""
    water = np.zeros(evidence.cells.size, bool)
    classes = scene.cloud.classification
    if classes is not None:
        water[evidence.cells.cell[classes == WATER]] = True
    return water.reshape(evidence.shape)
