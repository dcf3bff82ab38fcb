"""The rasters of a run, put together from its blocks: terrain, surface, heights over it, building mask."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely
from shapely import Polygon

from eaves.blocks.block_file import BlockFile
from eaves.footprints.read import as_box
from eaves.formats import MosaicWriter
from eaves.formats.rasters.geotiff import write_world_file
from eaves.model import Block, Bounds, CoordinateSystem
from eaves.model.provenance import Provenance
from eaves.raster.rasterize import rasterize
from eaves.raster.surfaces import CELL
from eaves.run.world_squares import within


def write_surfaces(
    regions: Mapping[Block, BlockFile],
    system: CoordinateSystem,
    extent: Bounds,
    folder: Path,
    provenance: Provenance,
) -> list[Path]:
    """dtm.tif, dsm.tif and their difference ndsm.tif over `extent`, each block read once for all."""
    written = [folder / f"{name}.tif" for name in ("dtm", "dsm", "ndsm")]
    with ExitStack() as stack:
        writers = [
            stack.enter_context(MosaicWriter(path, extent, CELL, system, tags=provenance.tags))
            for path in written
        ]
        for block, result in regions.items():
            with result as file:
                dtm, dsm = file.raster("dtm"), file.raster("dsm")
            over = replace(dsm, values=dsm.values - dtm.values)
            for writer, raster in zip(writers, (dtm, dsm, over), strict=True):
                writer.write(raster, block.bounds, block.origin)
    return written


def write_run_mask(
    system: CoordinateSystem,
    blocks: Sequence[Block],
    polygons: Sequence[Polygon],
    extent: Bounds,
    path: Path,
    provenance: Provenance,
    world_file: bool = False,
) -> list[Path]:
    """mask.tif: the footprints (world metres) burnt into the raster cells whose centre they hold; its world
    file where it is wanted."""
    tree = shapely.STRtree(polygons)
    with MosaicWriter(path, extent, CELL, system, mask=True, tags=provenance.tags) as mosaic:
        for block in blocks:
            near = [polygons[i] for i in np.sort(tree.query(as_box(block.bounds)))]
            part = within(block.bounds, extent)  # a block may be far wider than its points
            mosaic.write(rasterize(near, part, CELL), block.bounds)
    if world_file:
        write_world_file(path.with_suffix(".tfw"), mosaic.transform)
    return [path, path.with_suffix(".tfw")] if world_file else [path]
