"""Surface rasters of the drawn scene: stored by a scale and an offset, in other kinds of numbers, with values
for "nothing here" that nobody declares, in other units."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.scale.silence import Drawn, Variant
from benchmarks.scale.silence.houses import PLACE, SIDE, SYSTEM, draw_houses, measured_wrong

CELL = 0.5
LEAST_FLOAT = float(np.finfo(np.float32).min)
US_FOOT = 1200 / 3937
NOTHING = r"there is nothing to say here \d"


@dataclass(frozen=True)
class Stored:
    """How a raster stores heights: `value = (height - offset) / scale`.

    Parameters
    ----------
    kind : str
        Of its numbers.
    scale, offset : float
        As the band states them.
    declared : float or None
        The value that the file declares for no data.
    hole : float or None
        The value in a corner of the scene and, with `rim`, in a frame around it.
    rim : int
        Width of the frame (cells).
    unit : str
        Of the band.
    system : str
        Of the file.
    foot : float
        Metres in a unit of heights.
    tags : dict of str to str or None
        Of the file.
    dtm : bool
        The terrain comes in a file of the same kind.
    plain_surface : bool
        Only the terrain is stored so.
    cause : str
        What a message must name.
    """

    kind: str = "float32"
    scale: float = 1.0
    offset: float = 0.0
    declared: float | None = None
    hole: float | None = None
    rim: int = 0
    unit: str = ""
    system: str = "EPSG:28992"
    foot: float = 1.0
    tags: dict[str, str] | None = None
    dtm: bool = False
    plain_surface: bool = False
    bands: int = 1
    cause: str = NOTHING

    def write(self, path: Path, heights: NDArray[np.float64], plain: bool = False) -> None:
        """Write heights (H, W) of the scene."""
        values = heights / self.foot if plain else (heights / self.foot - self.offset) / self.scale
        if self.hole is not None and not plain:
            values[-8:, :8] = self.hole
            if self.rim:
                frame = np.full(np.add(values.shape, 2 * self.rim), self.hole)
                frame[self.rim : -self.rim, self.rim : -self.rim] = values
                values = frame
        kind = "float32" if plain else self.kind
        if np.dtype(kind).kind in "iu":
            values = np.clip(np.round(values), np.iinfo(kind).min, np.iinfo(kind).max)
        rim = 0 if plain else self.rim
        place = rasterio.Affine(CELL, 0, PLACE[0] - rim * CELL, 0, -CELL, PLACE[1] + SIDE + rim * CELL)
        with rasterio.open(
            path, "w", driver="GTiff", height=values.shape[0], width=values.shape[1], count=self.bands,
            dtype=kind, transform=place, crs=self.system, nodata=None if plain else self.declared,
        ) as image:  # fmt: skip
            for band in range(1, self.bands + 1):
                image.write(values.astype(kind), band)
            if not plain:
                image.scales, image.offsets = [self.scale] * self.bands, [self.offset] * self.bands
                if self.unit:
                    image.units = [self.unit] * self.bands
                image.update_tags(**(self.tags or {}))

    def draw(self, folder: Path, rng: np.random.Generator) -> Drawn:
        """The variant in a folder."""
        scene = draw_houses(rng)
        middles = np.arange(CELL / 2, SIDE, CELL)
        x, y = np.meshgrid(middles, middles[::-1])
        places = np.column_stack([x.ravel(), y.ravel()])
        near = cKDTree(scene.xyz[:, :2]).query(places)[1]
        surface = scene.xyz[near, 2].reshape(x.shape)
        self.write(folder / "surface.tif", surface, self.plain_surface)
        words = ["build", str(folder / "surface.tif"), "-o", "OUT", "--jobs", "1"]
        words += ["--outputs", "footprints,models"]
        if self.dtm:
            self.write(folder / "terrain.tif", np.full_like(surface, 10.0))
            words += ["--dtm", str(folder / "terrain.tif")]
        return Drawn(words, measured_wrong(scene), self.cause)


def stored() -> dict[str, Stored]:
    """All of them, by name."""
    assert SYSTEM.to_epsg() == 28992
    cm: dict[str, object] = {"kind": "int16", "scale": 0.01}
    return {
        "int16 in centimetres": Stored(**cm),
        "uint16 in centimetres": Stored("uint16", 0.01),
        "int32 in millimetres": Stored("int32", 0.001),
        "uint16 in decimetres over -100": Stored("uint16", 0.05, -100.0),
        "int16 with an offset of 1000": Stored("int16", 0.1, 1000.0),
        "float32 with an offset": Stored(offset=500.0),
        "float64 with a scale": Stored("float64", 0.5),
        "int16 in centimetres, -32768 declared": Stored(**cm, declared=-32768, hole=-32768),
        "int16 in centimetres, -32768 not declared": Stored(**cm, hole=-32768, cause=r"value -32,?768"),
        "int16, 32767 around it": Stored(**cm, hole=32767, rim=20, cause=r"value 32,?767"),
        "uint16, 65535 around it": Stored("uint16", 0.01, hole=65535, rim=20, cause=r"value 65,?535"),
        "uint16, 0 around it": Stored("uint16", 0.01, hole=0, rim=20, cause=r"value 0\b"),
        "float32, 0 around it": Stored(hole=0.0, rim=20, cause=r"value 0\b"),
        "float32, -9999 in a corner": Stored(hole=-9999.0, cause=r"value -9,?999"),
        "float32, -9999 around it": Stored(hole=-9999.0, rim=20, cause=r"value -9,?999"),
        "float32, -9999 declared as -32767": Stored(hole=-9999.0, declared=-32767.0, cause=r"value -9,?999"),
        "float32, the least float": Stored(hole=LEAST_FLOAT, cause=r"value -3\.4\d*e\+?38"),
        "float32, the largest float": Stored(hole=-LEAST_FLOAT, cause=r"value 3\.4\d*e\+?38"),
        "float32, -99999": Stored(hole=-99999.0, cause=r"value -99,?999"),
        "float32, NaN": Stored(hole=float("nan")),
        "terrain with a scale": Stored(**cm, dtm=True, plain_surface=True),
        "terrain and surface with a scale": Stored(**cm, dtm=True),
        "terrain without a declared value": Stored(
            hole=-9999.0, dtm=True, plain_surface=True, cause=r"value -9,?999"
        ),
        "heights in feet by the unit of the band": Stored(unit="ft", foot=0.3048, cause=r"(?i)\b(ft|feet)\b"),
        "heights in US feet by the unit of the band": Stored(unit="US survey foot", foot=US_FOOT),
        "heights in feet by the system": Stored(system="EPSG:28992+6360", foot=US_FOOT),
        "heights in centimetres by the unit of the band": Stored("int16", foot=0.01, unit="cm"),
        "points at the corners of pixels": Stored(tags={"AREA_OR_POINT": "Point"}),
        "three bands": Stored(bands=3, cause=r"3 bands"),
        "control: float32": Stored(),
        "control: float32, -9999 declared": Stored(declared=-9999.0, hole=-9999.0, cause=r"value -9,?999"),
    }


def variants() -> list[Variant]:
    """The variants of this kind."""
    return [Variant("rasters", name, one.draw) for name, one in stored().items()]
