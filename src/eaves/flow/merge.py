"""The files of tiles, merged without holding it in memory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
import shapely

from eaves.figures.rows import BuildingRow
from eaves.flow.doubts import LAYER, describe_doubts, doubt_of, doubt_rows
from eaves.flow.rasters import write_run_mask
from eaves.flow.review import REVIEW, ranked, write_review
from eaves.formats.rasters.vrt import write_vrt
from eaves.formats.vectors.geopackage import Row, plain_value, read_details, write_geopackage
from eaves.model import Bounds, CoordinateSystem
from eaves.model.block import BLOCK_SIDE
from eaves.model.provenance import NOTHING_KNOWN, Provenance
from eaves.raster.surfaces import CELL
from eaves.run.manifest import add_to_manifest
from eaves.run.workers import Workers
from eaves.run.world_squares import squares_of


@dataclass(frozen=True, eq=False)
class TileRows:
    """The rows of one layer of all tiles' GeoPackages, tile by tile, in the units they are in; `number`
    counts on from tile to tile, `tile` names the tile."""

    places: Sequence[Path]
    layer: str
    more: Sequence[Row] = ()
    """Rows that belong to no tile."""

    def __iter__(self) -> Iterator[Row]:
        import pyogrio.raw

        number = 0
        for place in self.places:
            path = place / "footprints.gpkg"
            meta, _, wkb, columns = pyogrio.raw.read(path, layer=self.layer)
            names = [str(name) for name in meta["fields"]]
            kinds = [str(kind) for kind in meta["dtypes"]]
            details = read_details(path) if self.layer == "footprints" else {}
            for k, shape in enumerate(shapely.from_wkb(wkb)):
                number += 1
                row = {
                    name: plain_value(column[k], kind)
                    for name, kind, column in zip(names, kinds, columns, strict=True)
                }
                if "number" in row:
                    row["number"] = number
                yield Row(shape, {**row, **details.get(row.get("id"), {}), "tile": place.name})
        for one in self.more:
            number += 1
            yield Row(one.geometry, {**one.attributes, "number": number})


def merge_footprints(
    path: Path,
    places: Sequence[Path],
    system: CoordinateSystem,
    lost: Sequence[BuildingRow] = (),
    side: float = BLOCK_SIDE,
    provenance: Provenance = NOTHING_KNOWN,
) -> dict[str, Any]:
    """Write the footprints and roof planes of all tiles into one GeoPackage, piece by piece, and behind them
    what no tile holds, and review.csv beside it; what run.json says of the doubts. `side` is that of the
    blocks."""
    unit = system.horizontal_unit_m
    more = [
        Row(
            None if row.polygon.is_empty else shapely.transform(row.polygon, lambda xy: xy / unit),
            row.numbered(0, None),
        )
        for row in lost
    ]
    as_it_is = replace(system, horizontal_unit_m=1.0, vertical_unit_m=1.0)  # the tiles' files are converted
    footprints, roof_planes = TileRows(places, "footprints", more), TileRows(places, "roof_planes")
    doubts = doubt_rows([doubt_of(row, unit) for row in TileRows(having(places, "doubts"), "doubts")], side)
    words = describe_doubts(doubts, unit, LAYER)
    doubts = [Row(shapely.transform(row.geometry, lambda xy: xy / unit), row.attributes) for row in doubts]
    review = ranked(TileRows(having(places, "review"), "review"))
    write_geopackage(path, footprints, roof_planes, as_it_is, review, doubts, provenance)
    write_review(path.with_name(REVIEW), review, as_it_is)
    return words


def having(places: Sequence[Path], layer: str) -> list[Path]:
    """The tiles whose GeoPackage has a layer."""
    import pyogrio

    return [place for place in places if layer in pyogrio.list_layers(place / "footprints.gpkg")[:, 0]]


def merge_masks(
    footprints: Path,
    places: Sequence[Path],
    system: CoordinateSystem,
    workers: Workers,
    provenance: Provenance = NOTHING_KNOWN,
) -> None:
    """Write every tile's mask.tif, with the footprints that reach into it from its neighbours.

    Raises
    ------
    RuntimeError
        With the reason of the first that could not be written.
    """
    work = partial(write_tile_mask, footprints=footprints, system=system, provenance=provenance)
    for outcome in workers.run(work, list(places)):
        if outcome.error:
            raise RuntimeError(outcome.error)


def write_tile_mask(place: Path, footprints: Path, system: CoordinateSystem, provenance: Provenance) -> None:
    """mask.tif of one tile, over the extent of its terrain."""
    import pyogrio.raw

    unit = system.horizontal_unit_m
    with rasterio.open(place / "dtm.tif") as image:
        extent = image.bounds
    polygons = pyogrio.raw.read(footprints, layer="footprints", columns=[], bbox=tuple(extent))[2]
    shapes = shapely.transform(shapely.from_wkb(polygons), lambda xy: xy * unit)
    bounds = Bounds(*(round(side * unit / CELL) * CELL for side in extent))
    blocks, path = squares_of(bounds, BLOCK_SIDE), place / "mask.tif"
    written = write_run_mask(system, blocks, list(np.asarray(shapes, object)), bounds, path, provenance)
    add_to_manifest(place, written)


def merge_rasters(folder: Path, places: Sequence[Path], provenance: Provenance = NOTHING_KNOWN) -> list[Path]:
    """Write dtm.vrt, dsm.vrt, ndsm.vrt and mask.vrt over the tiles' rasters."""
    written = []
    for name in ("dtm", "dsm", "ndsm", "mask"):
        written.append(folder / f"{name}.vrt")
        write_vrt(written[-1], [place / f"{name}.tif" for place in places], provenance.tags)
    return written
