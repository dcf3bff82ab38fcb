"""One epoch of a comparison: the buildings and the classified points of a run's folder, block by block."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from eaves.flow import Region, open_region, open_run, read_points
from eaves.formats import InputError, horizontal_crs, is_classified, read_polygons
from eaves.model import Block, Bounds, CoordinateSystem, PointCloud
from eaves.model.block import squares_of
from eaves.run import MANIFEST, Workers, read_facts, read_manifest

log = logging.getLogger("eaves")

TURNED = 0.05
"""Largest rotation and stretch between two plane systems: blocks are looked up with this margin."""


@dataclass(frozen=True, eq=False)
class Building:
    """A building of one epoch: its id, its outline (world metres of the comparison), its attributes."""

    id: str
    polygon: Polygon | MultiPolygon
    row: dict[str, Any]


@dataclass(frozen=True, eq=False)
class Epoch:
    """One epoch: where its results are, its buildings, and its points by block."""

    folder: Path
    system: CoordinateSystem
    """Of the comparison, which the outlines are in."""
    buildings: tuple[Building, ...]
    region: Region
    """Its points, as a run brings them to their blocks."""

    @property
    def side(self) -> float:
        """Side of a block (m)."""
        return self.region.run.side

    @property
    def name(self) -> str:
        """The folder's name, for messages."""
        return str(self.folder)

    @cached_property
    def _move(self) -> tuple[Callable[..., Any], Callable[..., Any]] | None:
        """From the files' plane coordinates (metres) to the comparison's, and back; None where they agree."""
        inner, wanted = horizontal_crs(self.region.system), horizontal_crs(self.system)
        if inner is None or wanted is None or inner.equals(wanted, ignore_axis_order=True):
            return None
        from pyproj import Transformer

        return (
            Transformer.from_crs(inner, wanted, always_xy=True).transform,
            Transformer.from_crs(wanted, inner, always_xy=True).transform,
        )

    def blocks(self) -> list[Block]:
        """The blocks of the comparison's system that may have points."""
        own = self.region.blocks_read
        if self._move is None:
            return own
        found: set[Block] = set()
        for block in own:
            found |= set(squares_of(self.moved(block.bounds, 0), self.side))
        return sorted(found)

    def points(self, block: Block, reach: float) -> PointCloud:
        """The points of a block of the comparison's system, and of its surroundings up to `reach` (m), about
        its corner, in canonical order."""
        if self._move is None:
            return self.region.window(block, reach)
        wanted = block.bounds.buffered(reach)
        pieces = []
        for own in squares_of(self.moved(wanted, 1), self.side):
            cloud = self.region.window(own, 0.0)
            if len(cloud):
                world = cloud.xyz + np.array([*own.origin, 0.0])
                world[:, :2] = self.plane(world[:, :2], 0)
                inside = np.flatnonzero(wanted.contains(world))
                pieces.append((cloud, world, inside))
        if not pieces:
            nowhere = Block(block.column, block.row, self.side)
            return self.region.window(nowhere, 0.0).take(np.zeros(0, np.int64))
        arrays = {
            name: np.concatenate([getattr(cloud, name)[inside] for cloud, _, inside in pieces])
            for name in ("return_number", "number_of_returns", "classification", "point_id")
            if getattr(pieces[0][0], name) is not None
        }
        xyz = np.concatenate([world[inside] for _, world, inside in pieces])
        return PointCloud.from_world(xyz, block.origin, **arrays).in_canonical_order()

    def plane(self, xy: NDArray[np.float64], way: int) -> NDArray[np.float64]:
        """Plane coordinates (N, 2) in metres taken to the comparison's system (0), or back (1)."""
        if self._move is None:
            return xy
        units = self.region.system.horizontal_unit_m, self.system.horizontal_unit_m
        x, y = self._move[way](*(xy / units[way]).T)
        return np.column_stack([x, y]) * units[1 - way]

    def moved(self, bounds: Bounds, way: int) -> Bounds:
        """A rectangle that holds another in the other system."""
        if self._move is None:
            return bounds
        west, south, east, north = bounds
        corners = np.array([[west, south], [west, north], [east, south], [east, north]])
        return Bounds.of(self.plane(corners, way)).buffered(TURNED * max(bounds.width, bounds.height))


def open_epoch(
    folder: Path, work: Path, target: CoordinateSystem | None, progress: Callable[[int, int], None]
) -> Epoch:
    """The epoch in a run's folder, its classified points read as those of a run are.

    Parameters
    ----------
    folder
        Folder of `eaves build`.
    work
        Folder for the points by block; the caller removes it.
    target
        The system of the comparison; None for the folder's own.
    progress
        Called with the number of points read, and of all.

    Raises
    ------
    InputError
        When the folder holds no complete run, or not what a comparison needs.
    """
    points, facts = run_points(folder), read_facts(folder)
    if facts.get("clip"):
        log.warning("%s: built with --clip; what lies outside counts as seen, without buildings", folder)
    # of its classified points a run used those in its bounds
    bounds = facts.get("bounds")
    run = open_run(points, work, bounds=bounds, crs_force=True, allow_empty=True, outputs=("models",), jobs=1)
    polygons, _, rows, _ = read_polygons(folder / "footprints.gpkg", "footprints", target=target)
    target = run.index.system if target is None else target
    if (run.index.system.wkt is None) != (target.wkt is None):
        raise InputError.about(
            folder,
            "has no reference system and the other epoch has one, or the other way round",
            "build it again with --crs",
        )
    buildings = tuple(
        Building(str(row["id"]), shapely.make_valid(polygon), row)
        for polygon, row in zip(polygons, rows, strict=True)
    )
    region = open_region(run, Workers(), lambda step, done, total: progress(done, total))
    read_points(region)
    if region.failed:
        raise InputError(region.failed[0])
    return Epoch(folder, target, buildings, region)


def run_points(folder: Path) -> list[Path]:
    """The classified points of a run's folder.

    Raises
    ------
    InputError
        When it is no run's, the run did not end, or it wrote no points.
    """
    if not folder.is_dir() or not (folder / MANIFEST).exists():
        raise InputError.about(folder, "is no folder of a run", "give what `eaves build` wrote, or a scan")
    words = read_manifest(folder)
    if words.get("complete") is not True:
        raise InputError.about(folder, "holds a run that did not end", "run it again with --resume")
    names = sorted(name for name in words["written"] if is_classified(name))
    if not names or "footprints.gpkg" not in words["written"]:
        parts = "build parts of it with --bounds and compare these"
        remedy = parts if "tiles" in words else "build it again with both"
        raise InputError.about(folder, "lacks footprints.gpkg or classified points", remedy)
    missing = [name for name in (*names, "footprints.gpkg") if not (folder / name).exists()]
    if missing:
        raise InputError.about(folder / missing[0], "is missing", "run again")
    return [folder / name for name in names]
