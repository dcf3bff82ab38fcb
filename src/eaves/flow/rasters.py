"""The rasters of a run, put together from its blocks: terrain, surface, heights over it, building mask."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path

import numpy as np
import shapely
from shapely import Polygon

from eaves.blocks.block_file import BlockFile
from eaves.flow.formats import TILES
from eaves.flow.run import Run
from eaves.flow.tiles import tile_of
from eaves.footprints.read import as_box
from eaves.formats import MosaicWriter
from eaves.formats.rasters.geotiff import write_world_file
from eaves.formats.rasters.vrt import write_vrt
from eaves.model import Block, Bounds
from eaves.raster.grid import rasterize
from eaves.raster.surfaces import CELL, is_large
from eaves.run.world_squares import within


@dataclass(frozen=True)
class RasterPiece:
    """A file of a raster: its folder, the blocks it shows, and its extent (world metres)."""

    folder: Path
    blocks: Sequence[Block]
    extent: Bounds


def raster_pieces(run: Run, blocks: Sequence[Block], extent: Bounds) -> list[RasterPiece]:
    """The files of a raster of some blocks: one, or those of tiles, of which none is empty."""
    if not (run.by_tiles or is_large(extent)):
        return [RasterPiece(run.folder, blocks, extent)]
    tiles: dict[Block, list[Block]] = {}
    for block in blocks:
        tiles.setdefault(tile_of(block, run.tile_side), []).append(block)
    return [
        RasterPiece(
            run.folder / TILES / tile.name,
            tiles[tile],
            within(reduce(Bounds.union, (block.bounds for block in tiles[tile])), extent),
        )
        for tile in sorted(tiles)
    ]


def with_lists(run: Run, names: Sequence[str], pieces: Sequence[RasterPiece]) -> list[Path]:
    """The files of rasters of some names, and behind those that lie in several a virtual raster over them."""
    written = [piece.folder / f"{name}.tif" for piece in pieces for name in names]
    if not pieces or pieces[0].folder == run.folder:
        return written
    lists = [run.folder / f"{name}.vrt" for name in names]
    for path in lists:
        write_vrt(path, [piece.folder / f"{path.stem}.tif" for piece in pieces], run.provenance.tags)
    return written + lists


def write_surfaces(run: Run, regions: Mapping[Block, BlockFile], extent: Bounds) -> list[Path]:
    """dtm.tif, dsm.tif and their difference ndsm.tif over `extent`, each block read once for all."""
    names, pieces = ("dtm", "dsm", "ndsm"), raster_pieces(run, list(regions), extent)
    system, tags = run.index.system, run.provenance.tags
    for piece in pieces:
        with ExitStack() as stack:
            paths = [piece.folder / f"{name}.tif" for name in names]
            writers = [
                stack.enter_context(MosaicWriter(path, piece.extent, CELL, system, tags=tags))
                for path in paths
            ]
            for block in piece.blocks:
                file = regions[block]
                dtm, dsm = file.raster("dtm"), file.raster("dsm")
                over = replace(dsm, values=dsm.values - dtm.values)
                for writer, raster in zip(writers, (dtm, dsm, over), strict=True):
                    writer.write(raster, block.bounds, block.origin)
    return with_lists(run, names, pieces)


def write_run_mask(
    run: Run, blocks: Sequence[Block], polygons: Sequence[Polygon], extent: Bounds
) -> list[Path]:
    """mask.tif: the footprints (world metres) burnt into the raster cells whose centre they hold; of a
    published system with its world file."""
    tree, pieces = shapely.STRtree(polygons), raster_pieces(run, blocks, extent)
    system, tags = run.index.system, run.provenance.tags
    beside = []
    for piece in pieces:
        path = piece.folder / "mask.tif"
        with MosaicWriter(path, piece.extent, CELL, system, mask=True, tags=tags) as mosaic:
            for block in piece.blocks:
                outlines = [polygons[i] for i in np.sort(tree.query(as_box(block.bounds)))]
                part = within(block.bounds, piece.extent)  # a block may be far wider than its points
                mosaic.write(rasterize(outlines, part, CELL), block.bounds)
        if run.options["source"] is not None:  # the Vaihingen entry delivers one
            beside.append(path.with_suffix(".tfw"))
            write_world_file(beside[-1], mosaic.transform)
    return with_lists(run, ["mask"], pieces) + beside
