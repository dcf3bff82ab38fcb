"""Maps of what the ground filter gets wrong: docs/gallery/ground-*.png, the worst samples and Delft.

Run `EAVES_DATA=... python -m benchmarks.gallery.ground`. Clusters of errors are numbered, the largest first;
the numbers are printed with their sizes, places and heights, and docs/gallery/ground.md gives their reasons.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LightSource, to_rgb
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from benchmarks.accuracy.ground import CROPS, ISPRS, Sample, read_isprs, read_las, total_error
from benchmarks.gallery.solids import FOLDER, save_small
from eaves.geometry.neighbours import measure_spacing
from eaves.ground import classify_ground
from eaves.model import Bounds, Mask, Raster
from eaves.raster.grid import heights_of, highest_points, whole_cells
from eaves.raster.interpolate import fill_nearest
from eaves.raster.surfaces import make_dtm

WORST = 5
"""So many samples are drawn, and Delft."""
NUMBERED = 12
"""So many clusters of a sample get a number."""
LINK_LEAST_M, LINK_SPACINGS = 1.0, 1.6
"""Errors of one type nearer than this in plan are of one cluster."""
CELL_LEAST_M, GAP_CELLS = 0.4, 3.0
"""Cells of the pictures are one spacing wide; smaller gaps than three are closed."""
SHADES = 32
"""Colours of a picture: few, so that the pages stay small."""
COLOURS = {"I": "tab:blue", "II": "tab:red"}


@dataclass(frozen=True, eq=False)
class Case:
    """A sample, its answer (N,), and its total error in per cent."""

    name: str
    sample: Sample
    ground: Mask
    error: float

    @property
    def errors(self) -> dict[str, Mask]:
        """The points (N,) of type I (ground rejected) and of type II (objects accepted)."""
        counted = np.ones(len(self.ground), bool)
        if self.sample.classes is not None:
            counted = self.sample.classes != 9
        truth = self.sample.truth
        return {"I": truth & ~self.ground, "II": counted & ~truth & self.ground}


@dataclass(frozen=True, eq=False)
class Cluster:
    """Numbers (K,) of the points of one type that lie together, and their heights over the terrain.

    For type I that is the terrain as it was found, for type II as it is.
    """

    kind: str
    points: NDArray[np.int64]
    heights: NDArray[np.float64]


def cases_of(data: Path) -> list[Case]:
    """The worst of the samples, and Delft."""
    samples = {name: read_isprs(data, name) for name in ISPRS}
    samples |= {name: read_las(data / "ahn3_ground" / f"{name}_manually_classified.las") for name in CROPS}
    cases = [judge(name, sample) for name, sample in samples.items()]
    worst = sorted(cases, key=lambda case: -case.error)[:WORST]
    return [*worst, judge("Delft", read_las(data / "delft" / "ahn3.laz"))]


def judge(name: str, sample: Sample) -> Case:
    ground = classify_ground(sample.cloud).ground
    return Case(name, sample, ground, total_error(sample, ground, (9,)))


def clusters_of(case: Case) -> list[Cluster]:
    """The largest clusters of errors, of both types."""
    cloud = case.sample.cloud
    xyz, spacing = cloud.xyz, measure_spacing(cloud.xyz)
    link, bounds = max(LINK_LEAST_M, LINK_SPACINGS * spacing), Bounds.of(xyz).buffered(spacing)
    terrain = {
        kind: make_dtm(cloud.with_(classification=np.where(mask, 2, 1).astype(np.uint8)), bounds, spacing)
        for kind, mask in (("I", case.ground), ("II", case.sample.truth))
    }
    clusters = []
    for kind, wrong in case.errors.items():
        numbers = np.flatnonzero(wrong)
        tree = cKDTree(xyz[numbers, :2])
        labels = connected_components(tree.sparse_distance_matrix(tree, link))[1]
        heights = xyz[numbers, 2] - terrain[kind].values[terrain[kind].cell_of(xyz[numbers])]
        for label in np.argsort(-np.bincount(labels), kind="stable")[:NUMBERED]:
            members = labels == label
            clusters.append(Cluster(kind, numbers[members], heights[members]))
    return sorted(clusters, key=lambda cluster: -len(cluster.points))[:NUMBERED]


def draw_case(case: Case) -> Path:
    """The shaded surface and the map of errors of one sample, its clusters numbered."""
    xyz = case.sample.cloud.xyz
    cell = max(CELL_LEAST_M, measure_spacing(xyz))
    bounds = whole_cells(Bounds.of(xyz), cell)
    top = heights_of(highest_points(xyz, bounds, cell), xyz[:, 2])
    surface = fill_nearest(Raster(top, bounds.west, bounds.north, cell), GAP_CELLS * cell)
    wide = bounds.width > bounds.height
    share = min(bounds.width, bounds.height) / max(bounds.width, bounds.height)
    long, across = 8.5, 2 * 8.0 * share + 0.8
    figure, (left, right) = plt.subplots(
        *((2, 1) if wide else (1, 2)), figsize=(long, across) if wide else (across, long)
    )
    extent = (0.0, bounds.width, 0.0, bounds.height)
    shade = LightSource(315, 45).hillshade(surface.values, dx=cell, dy=cell)
    left.imshow(shade, cmap="gray", vmin=0.0, vmax=1.0, extent=extent, interpolation="nearest")
    errors = case.errors
    picture = np.ones((*surface.shape, 3))
    for colour, which in (
        ("0.85", case.sample.truth & case.ground),
        ("#c3dbaa", ~case.sample.truth & ~case.ground),
        *((COLOURS[kind], wrong) for kind, wrong in errors.items()),
    ):
        row, column = surface.cell_of(xyz[which])
        picture[row, column] = to_rgb(colour)
    right.imshow(picture, extent=extent, interpolation="nearest")
    write_numbers(right, case, bounds)
    left.set_title(f"{case.name}: the surface, lit from the north-west", fontsize=9)
    right.set_title(
        f"{case.error:.2f} %: {errors['I'].sum()} of type I (blue), {errors['II'].sum()} of type II (red)",
        fontsize=9,
    )
    for axes in (left, right):
        axes.tick_params(labelsize=7)
    figure.tight_layout()
    path = FOLDER / f"ground-{case.name.lower()}.png"
    save_small(figure, path, 115, SHADES)
    return path


def write_numbers(axes: Axes, case: Case, bounds: Bounds) -> None:
    """The numbers of the clusters beside them, in metres from the south-west corner."""
    corner = np.array([bounds.west, bounds.south])
    for number, cluster in enumerate(clusters_of(case), 1):
        east, north = np.median(case.sample.cloud.xyz[cluster.points, :2], axis=0) - corner
        axes.annotate(
            str(number),
            (float(east), float(north)),
            (9, 9),
            textcoords="offset points",
            fontsize=10,
            weight="bold",
            arrowprops={"arrowstyle": "-", "lw": 0.7},
        )


def describe(case: Case) -> None:
    """Print the clusters of a sample: type, points, place in it, heights over the terrain."""
    corner = case.sample.cloud.xyz[:, :2].min(axis=0)
    print(f"{case.name}: {case.error:.2f} %")
    for number, cluster in enumerate(clusters_of(case), 1):
        east, north = np.median(case.sample.cloud.xyz[cluster.points, :2], axis=0) - corner
        low, middle, high = np.quantile(cluster.heights, (0.1, 0.5, 0.9))
        print(
            f"  {number:2d} type {cluster.kind:2s} {len(cluster.points):4d} points "
            f"at {east:4.0f} {north:4.0f}, {low:.2f} {middle:.2f} {high:.2f} m over the terrain"
        )


def main() -> None:
    """Draw the maps and print their clusters."""
    for case in cases_of(Path(os.environ["EAVES_DATA"])):
        describe(case)
        print(draw_case(case))


if __name__ == "__main__":
    main()
