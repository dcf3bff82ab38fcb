"""Pictures of surveys with wide buildings: docs/gallery/halls-*.png, what is called ground and building.

Run `EAVES_DATA=... python -m benchmarks.gallery.halls`; the surveys are computed as `eaves detect` does.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import laspy
import numpy as np
from matplotlib.colors import LightSource
from PIL import Image
from scipy import ndimage

import eaves
from eaves.model import Bounds
from eaves.raster.grid import heights_of, highest_points, mean_heights, whole_cells
from eaves.raster.interpolate import fill_nearest

PAGE = Path(__file__).parents[2] / "docs" / "gallery"
SURVEYS = {"woodford": ("woodford.laz", None), "autzen": ("autzen_full.laz", "srs.wkt")}
FOOT_M = 0.3048
CELL_M = 2.0
SHADES = 40
"""Colours of a picture: few, so that the pages stay small."""
TINTS = {"building": ((0.86, 0.16, 0.12), 0.45), "ground": ((0.24, 0.55, 0.86), 0.2)}


def draw(classified: Path, picture: Path) -> None:
    """The hillshade of the highest points; buildings are red, ground is bluish, the rest is grey."""
    las = laspy.read(classified)
    xyz, classes = np.c_[las.x, las.y, las.z] * FOOT_M, np.asarray(las.classification)
    good = ~np.isin(classes, (7, 18))
    xyz, classes = xyz[good] - [xyz[:, 0].min(), xyz[:, 1].min(), 0.0], classes[good]
    bounds = whole_cells(Bounds.of(xyz), CELL_M)
    top = heights_of(highest_points(xyz, bounds, CELL_M), xyz[:, 2])
    surface = fill_nearest(eaves.Raster(top, bounds.west, bounds.north, CELL_M))
    shade = LightSource(315, 45).hillshade(surface.values, dx=CELL_M, dy=CELL_M)
    colours = np.repeat(shade[..., None], 3, axis=-1)
    building, ground = (mean_heights(xyz[classes == k], bounds, CELL_M)[1] > 0 for k in (6, 2))
    building = ndimage.binary_closing(building, np.ones((3, 3)))
    for name, cells in (("building", building), ("ground", ground & ~building)):
        tint, share = TINTS[name]
        colours[cells] = (1.0 - share) * colours[cells] + share * np.array(tint)
    image = Image.fromarray((255 * colours.clip(0, 1)).astype(np.uint8))
    image.quantize(SHADES).save(picture, optimize=True)


def main() -> None:
    """Draw all surveys."""
    data = Path(os.environ["EAVES_DATA"])
    for name, (file, system) in SURVEYS.items():
        with tempfile.TemporaryDirectory() as folder:
            eaves.build(
                data / name / file,
                folder,
                crs=None if system is None else str(data / name / system),
                lod="0",
                outputs=("classified",),
            )
            draw(Path(folder) / "classified.laz", PAGE / f"halls-{name}.png")


if __name__ == "__main__":
    main()
