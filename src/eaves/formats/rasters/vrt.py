"""Many rasters of one grid shown as one: a GDAL virtual raster, which any GIS opens like a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from xml.sax.saxutils import escape, quoteattr

import rasterio

from eaves.formats.whole_files import atomic

NO_TAGS: Mapping[str, str] = MappingProxyType({})


def write_vrt(path: str | Path, pieces: Sequence[Path], tags: Mapping[str, str] = NO_TAGS) -> None:
    """Write a virtual raster over GeoTIFF pieces of one band, one system and one grid of cells.

    Parameters
    ----------
    path
        The file (`.vrt`); it names the pieces relative to its own folder, and appears when it is whole.
    pieces
        At least one file; cells that none covers are no data.
    tags
        Text by name, for the file's metadata.
    """
    path = Path(path)
    shapes = []
    for piece in pieces:
        with rasterio.open(piece) as image:
            shapes.append((image.transform, image.width, image.height))
            kind, crs, missing = image.dtypes[0], image.crs, image.nodata
    cell = shapes[0][0].a
    west, north = min(at.c for at, _, _ in shapes), max(at.f for at, _, _ in shapes)
    places = [(round((at.c - west) / cell), round((north - at.f) / cell)) for at, _, _ in shapes]
    columns = max(left + width for (left, _), (_, width, _) in zip(places, shapes, strict=True))
    rows = max(top + height for (_, top), (_, _, height) in zip(places, shapes, strict=True))
    with atomic(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.write(f'<VRTDataset rasterXSize="{columns}" rasterYSize="{rows}">\n')
        if crs is not None:
            file.write(f'<SRS dataAxisToSRSAxisMapping="1,2">{escape(crs.to_wkt())}</SRS>\n')
        metadata = "".join(f"<MDI key={quoteattr(key)}>{escape(text)}</MDI>" for key, text in tags.items())
        file.write(f"<Metadata>{metadata}</Metadata>\n" if metadata else "")
        file.write(f"<GeoTransform>{west!r}, {cell!r}, 0.0, {north!r}, 0.0, {-cell!r}</GeoTransform>\n")
        file.write(f'<VRTRasterBand dataType="{KINDS[kind]}" band="1">\n')
        if missing is not None:
            file.write(f"<NoDataValue>{missing}</NoDataValue>\n")
        for piece, (left, top), (_, width, height) in zip(pieces, places, shapes, strict=True):
            name = escape(piece.relative_to(path.parent).as_posix())
            file.write(
                f'<SimpleSource><SourceFilename relativeToVRT="1">{name}</SourceFilename>'
                f"<SourceBand>1</SourceBand>"
                f'<SourceProperties RasterXSize="{width}" RasterYSize="{height}" DataType="{KINDS[kind]}" '
                f'BlockXSize="512" BlockYSize="512"/>'
                f'<SrcRect xOff="0" yOff="0" xSize="{width}" ySize="{height}"/>'
                f'<DstRect xOff="{left}" yOff="{top}" xSize="{width}" ySize="{height}"/></SimpleSource>\n'
            )
        file.write("</VRTRasterBand>\n</VRTDataset>\n")


KINDS = {"float32": "Float32", "uint8": "Byte"}
"""GDAL's names of the types we write."""
