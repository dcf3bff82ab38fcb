"""The rasters of a run, put together from its blocks: terrain, surface, building mask."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import shapely
from shapely import Polygon

from eaves.blocks.block_file import open_block
from eaves.footprints.read import as_box
from eaves.formats import MosaicWriter
from eaves.model import Block, Bounds, CoordinateSystem
from eaves.model.provenance import Provenance
from eaves.raster.rasterize import rasterize
from eaves.raster.surfaces import CELL
from eaves.run.store import Store
from eaves.run.world_squares import within


def write_surfaces(
    store: Store, blocks: Sequence[Block], extent: Bounds, folder: Path, provenance: Provenance
) -> list[Path]:
    """dtm.tif and dsm.tif over `extent`, each block read once for both."""
    written = [folder / "dtm.tif", folder / "dsm.tif"]
    with ExitStack() as stack:
        dtm, dsm = (
            stack.enter_context(MosaicWriter(path, extent, CELL, store.system, provenance=provenance))
            for path in written
        )
        for block in blocks:
            with open_block(store, block) as file:
                dtm.write(file.raster("dtm"), block.bounds, block.origin)
                dsm.write(file.raster("dsm"), block.bounds, block.origin)
    return written


def write_run_mask(
    system: CoordinateSystem,
    blocks: Sequence[Block],
    polygons: Sequence[Polygon],
    extent: Bounds,
    path: Path,
    provenance: Provenance,
) -> list[Path]:
    """mask.tif with its world file: the footprints (world metres) burnt into the raster cells whose centre
    they hold."""
    tree = shapely.STRtree(polygons)
    with MosaicWriter(path, extent, CELL, system, mask=True, provenance=provenance) as mosaic:
        for block in blocks:
            near = [polygons[i] for i in np.sort(tree.query(as_box(block.bounds)))]
            part = within(block.bounds, extent)  # a block may be far wider than its points
            mosaic.write(rasterize(near, part, CELL), block.bounds)
    return [path, path.with_suffix(".tfw")]
