"""One drawn scene in many systems and units, as files state them, contradict themselves or keep still.

The truth lies in a system in metres that is true to length; the file holds its points in another one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import laspy
import numpy as np
import pyogrio
import rasterio
import shapely
from pyproj import CRS, Transformer
from pyproj.enums import WktVersion

from benchmarks.scale.silence import Drawn, Variant
from benchmarks.scale.silence.houses import SIDE, Scene, World, draw_houses, measured_wrong

FOOT, US_FOOT = 0.3048, 1200 / 3937
OUTPUTS = ["--outputs", "footprints,models", "--jobs", "1"]
DUTCH, ATLANTIC = (CRS.from_epsg(28992), 85200.0, 446400.0), (CRS.from_epsg(26918), 582800.0, 4650200.0)
KINDS = {"us": ("Foot_US", US_FOOT, 9003), "international": ("Foot", FOOT, 9002)}


def utm(longitude: float, latitude: float) -> tuple[CRS, float, float]:
    """A place in the UTM zone of it, by its middle (degrees)."""
    zone = int((longitude + 180) // 6) + 1
    system = CRS.from_epsg((32600 if latitude >= 0 else 32700) + zone)
    east, north = Transformer.from_crs(4326, system, always_xy=True).transform(longitude, latitude)
    return system, float(np.round(east)), float(np.round(north))


OREGON = utm(-123.0, 44.0)


def keys(**values: int) -> list[laspy.VLR]:
    """The record of GeoTIFF keys (number → value, by `k<number>`)."""
    entries = [(int(name[1:]), 0, 1, value) for name, value in sorted(values.items())]
    data = np.array([(1, 1, 0, len(entries)), *entries], "<u2").tobytes()
    return [laspy.VLR("LASF_Projection", 34735, "", data)]


def words(text: str | CRS) -> list[laspy.VLR]:
    """The record of a system as WKT."""
    text = text if isinstance(text, str) else text.to_wkt(WktVersion.WKT2_2019)
    return [laspy.VLR("LASF_Projection", 2112, "", text.encode() + b"\0")]


def esri(plane: int, unit: str, length: float, tag: str = "VERTCS") -> list[laspy.VLR]:
    """A plane system as Esri writes it, with the unit of heights inside its brackets."""
    heights = f'{tag}["NAVD88_height",VDATUM["North_American_Vertical_Datum_1988"],'
    heights += f'PARAMETER["Vertical_Shift",0.0],PARAMETER["Direction",1.0],UNIT["{unit}",{length!r}]]'
    return words(CRS.from_epsg(plane).to_wkt(WktVersion.WKT1_ESRI)[:-1] + f",{heights}]")


def wkt1(plane: int, unit: str, length: float) -> list[laspy.VLR]:
    """A compound system as WKT 1."""
    text = CRS.from_epsg(plane).to_wkt(WktVersion.WKT1_GDAL)
    heights = f'VERT_CS["height",VERT_DATUM["unknown",2005],UNIT["{unit}",{length!r}],AXIS["Up",UP]]'
    return words(f'COMPD_CS["both",{text},{heights}]')


def write_las(
    path: Path, world: World, records: Sequence[laspy.VLR], scale: float | Sequence[float] = 0.001
) -> Path:
    """Points as LAS: 1.4 where a record is WKT, else 1.2."""
    modern = any(record.record_id == 2112 for record in records)
    header = laspy.LasHeader(point_format=6 if modern else 1, version="1.4" if modern else "1.2")
    header.scales, header.offsets = np.broadcast_to(scale, 3).astype(float), np.floor(world.min(axis=0))
    header.vlrs.extend(records)
    header.global_encoding.wkt = modern
    las = laspy.LasData(header)
    las.xyz = world
    las.return_number[:] = las.number_of_returns[:] = 1
    las.classification[:] = 1
    las.write(path)
    return path


@dataclass(frozen=True)
class Situation:
    """How the scene is written, and what a run is asked.

    Parameters
    ----------
    place : (CRS, float, float)
        The truth's system, and the scene's corner in it.
    written : CRS or None
        The system that the points are written in; the truth's.
    height_unit : float
        Metres in a unit of the written heights.
    records : list of laspy.VLR or None
        What the file says of its system; None: `written` as WKT.
    scale : float or sequence
        Steps of the coordinates.
    words : sequence of str
        More words of the command; FOLDER stands for the folder of the input.
    cause : str
        What a message must name.
    beside : callable or None
        Writes more files into the folder, from the scene, and the way to what is written.
    heights : bool
        Heights count.
    suffix : str
        Of the file of points.
    """

    place: tuple[CRS, float, float] = DUTCH
    written: CRS | None = None
    height_unit: float = 1.0
    records: list[laspy.VLR] | None = None
    scale: float | Sequence[float] = 0.001
    words: Sequence[str] = ()
    cause: str = r"there is nothing to say here \d"
    beside: Callable[[Path, Scene, Callable[[World], World]], None] | None = None
    heights: bool = True
    suffix: str = ".laz"
    only: Sequence[int] | None = None

    def draw(self, folder: Path, rng: np.random.Generator) -> Drawn:
        """The variant in a folder."""
        scene = draw_houses(rng)
        system, east, north = self.place

        def moved(xyz: World) -> World:
            return xyz + (east, north, 0.0)

        def as_written(xyz: World) -> World:
            world = moved(xyz) / (1.0, 1.0, self.height_unit)
            if self.written is not None:
                way = Transformer.from_crs(system.to_2d(), self.written.to_2d(), always_xy=True)
                world[:, 0], world[:, 1] = way.transform(*moved(xyz)[:, :2].T)
            return world

        records = words(self.written or system) if self.records is None else self.records
        points = folder / f"points{self.suffix}"
        if self.suffix == ".laz":
            write_las(points, as_written(scene.xyz), records, self.scale)
        else:
            np.savetxt(points, as_written(scene.xyz), "%.3f")
        if self.beside is not None:
            self.beside(folder, scene, as_written)
        more = [word.replace("FOLDER", str(folder)) for word in self.words]
        judge = measured_wrong(scene, self.heights, moved, self.only, system=system)
        return Drawn(["build", str(points), *OUTPUTS, "-o", "OUT", *more], judge, self.cause)


def second_tile(
    system: CRS | None, folder: Path, scene: Scene, as_written: Callable[[World], World], shift: float = 0.0
) -> None:
    """A tile beside the first with a piece of bare ground, in a system of its own where one is given."""
    ground = scene.xyz[scene.house < 0][::3] + (SIDE, 0.0, shift)
    world = as_written(ground)
    if system is None:
        write_las(folder / "second.laz", world, [])
    else:
        way = Transformer.from_crs(DUTCH[0], system, always_xy=True)
        moved = ground + (*DUTCH[1:], 0.0)
        moved[:, 0], moved[:, 1] = way.transform(*moved[:, :2].T)
        write_las(folder / "second.laz", moved, words(system))


def same_tile(folder: Path, scene: Scene, as_written: Callable[[World], World]) -> None:
    """A tile beside the first in the same system."""
    ground = scene.xyz[scene.house < 0][::3] + (SIDE, 0.0, 0.0)
    write_las(folder / "second.laz", as_written(ground), words(CRS.from_epsg(3857)))


def map_of(
    folder: Path, scene: Scene, as_written: Callable[[World], World], system: CRS, name: str = "map.gpkg"
) -> None:
    """The plans of the houses as a map in the truth's system."""
    plans = [shapely.transform(house.plan, lambda xy: xy + DUTCH[1:]) for house in scene.houses]
    pyogrio.write_dataframe(_frame(plans, system), folder / name)


def clip_of(folder: Path, scene: Scene, as_written: Callable[[World], World], side: float = 44.0) -> None:
    """An area around the first house, in the truth's system."""
    area = shapely.box(DUTCH[1], DUTCH[2], DUTCH[1] + side, DUTCH[2] + side)
    pyogrio.write_dataframe(_frame([area], DUTCH[0]), folder / "clip.gpkg")


def _frame(shapes: Sequence[shapely.Geometry], system: CRS) -> object:
    import geopandas

    return geopandas.GeoDataFrame(geometry=list(shapes), crs=system)


def bounds_in(system: CRS, side: float = 44.0) -> str:
    """West, south, east, north around the first house, in a system."""
    way = Transformer.from_crs(DUTCH[0], system, always_xy=True)
    box = way.transform_bounds(DUTCH[1], DUTCH[2], DUTCH[1] + side, DUTCH[2] + side)
    return ",".join(f"{value:.7f}" for value in box)


def surface_in(system: CRS, step: float, folder: Path, scene: Scene, as_written: object) -> None:
    """A surface raster of the scene in a system, by the nearest point."""
    from scipy.spatial import cKDTree

    world = scene.xyz + (*DUTCH[1:], 0.0)
    way = Transformer.from_crs(DUTCH[0], system, always_xy=True)
    x, y = way.transform(*world[:, :2].T)
    rows, columns = int(np.ptp(y) / step), int(np.ptp(x) / step)
    column, row = np.meshgrid(np.arange(columns), np.arange(rows))
    places = np.column_stack([x.min() + (column.ravel() + 0.5) * step, y.max() - (row.ravel() + 0.5) * step])
    near = cKDTree(np.column_stack([x, y])).query(places)[1]
    with rasterio.open(
        folder / "surface.tif", "w", driver="GTiff", width=columns, height=rows, count=1, dtype="float32",
        crs=system.to_wkt(), transform=rasterio.Affine(step, 0, x.min(), 0, -step, y.max()),
    ) as image:  # fmt: skip
        image.write(world[near, 2].reshape(rows, columns).astype(np.float32), 1)


def draw_surface(system: CRS, step: float, folder: Path, rng: np.random.Generator) -> Drawn:
    """The scene as a surface raster in a system."""
    scene = draw_houses(rng)
    surface_in(system, step, folder, scene, None)
    judge = measured_wrong(scene, moved=lambda xyz: xyz + (*DUTCH[1:], 0.0))
    return Drawn(
        ["build", str(folder / "surface.tif"), *OUTPUTS, "-o", "OUT"], judge, r"Mercator.*(1\.6|6\d(\.\d)? %)"
    )


MERCATOR = r"Mercator.*\d"
DEGREES = r"degrees.*\d"
SCALE = r"scale.*\d"
CONTRADICTION = r"(?i)(says?|states?) .*(says?|states?) |contradict"
FEET = r"(?i)feet.*\d|\d.*feet"
E4 = CRS.from_epsg


def situations() -> dict[str, Situation]:
    """All of them, by name."""
    web = E4(3857)
    degrees = (1e-7, 1e-7, 0.001)
    not_true = {
        "web mercator, 52 degrees north": Situation(written=web, cause=MERCATOR),
        "web mercator, 60 degrees north": Situation(utm(25, 60.2), web, cause=MERCATOR),
        "web mercator, 38 degrees north": Situation(utm(-122.4, 37.8), web, cause=MERCATOR),
        "web mercator, 34 degrees south": Situation(utm(18.5, -33.9), web, cause=MERCATOR),
        "web mercator, 12 degrees north": Situation(utm(77.6, 12.9), web, cause=MERCATOR),
        "web mercator, 1 degree north (control)": Situation(utm(103.8, 1.3), web),
        "web mercator as Esri names it": Situation(
            written=web, records=words(CRS.from_authority("ESRI", 102100)), cause=MERCATOR
        ),
        "web mercator by keys": Situation(written=web, records=keys(k1024=1, k3072=3857), cause=MERCATOR),
        "web mercator, heights in feet": Situation(
            ATLANTIC, CRS("EPSG:3857+6360"), US_FOOT, cause=MERCATOR
        ),
        "web mercator, two tiles": Situation(
            written=web, beside=same_tile, words=["FOLDER/second.laz"], cause=MERCATOR
        ),
        "web mercator, a map": Situation(
            written=web, beside=partial(map_of, system=DUTCH[0]), words=["--footprints", "FOLDER/map.gpkg"],
            cause=MERCATOR,
        ),
        "web mercator, a clip area": Situation(
            written=web, beside=clip_of, words=["--clip", "FOLDER/clip.gpkg"], only=[0], cause=MERCATOR
        ),
        "web mercator, bounds": Situation(
            written=web, words=["--bounds", bounds_in(web)], only=[0], cause=MERCATOR
        ),
        "web mercator, bounds and a wider clip area": Situation(
            written=web, beside=partial(clip_of, side=90.0),
            words=["--bounds", bounds_in(web), "--clip", "FOLDER/clip.gpkg"], only=[0], cause=MERCATOR,
        ),
        "web mercator to a system asked for": Situation(
            written=web, words=["--to-crs", "EPSG:28992"], cause=MERCATOR
        ),
        "web mercator as text": Situation(
            written=web, suffix=".xyz", words=["--crs", "EPSG:3857"], cause=MERCATOR
        ),
        "world mercator": Situation(written=E4(3395), cause=MERCATOR),
        "plate carree": Situation(written=E4(4087), cause=r"Equidistant.*\d"),
        "equal-area cylinder": Situation(written=E4(6933), cause=r"EASE.*\d"),
        "UTM 31 at 25 degrees east": Situation(utm(25, 52), E4(32631), cause=r"(UTM zone 31N|32631).*\d"),
        "UTM 33 at 9 degrees west": Situation(utm(-9, 40), E4(25833), cause=r"UTM zone 33N.*\d"),
        "conic of Europe at 48 degrees north": Situation(utm(8, 48), E4(3034), cause=r"LCC.*\d"),
        "conic of France at 60 degrees north": Situation(utm(5, 60), E4(2154), cause=r"Lambert-93.*\d"),
        "polar stereographic at 55 degrees north": Situation(utm(-45, 55), E4(3413), cause=r"3413.*\d"),
        "Albers in Florida": Situation(utm(-81, 25.5), E4(5070), cause=r"Albers.*\d"),
        "UTM 31 at 9 degrees east (.2 %)": Situation(utm(9.5, 52), E4(32631), cause=r"32631.*\d|scale.*\d"),
        "Lambert-93 in Corsica (.2 %)": Situation(utm(8.7, 41.9), E4(2154), cause=SCALE),
        "degrees": Situation(written=E4(4326), scale=degrees, cause=DEGREES),
        "degrees, ETRS89": Situation(written=E4(4258), scale=degrees, cause=DEGREES),
        "degrees, NAD83": Situation(ATLANTIC, E4(4269), scale=degrees, cause=DEGREES),
        "degrees, three dimensions": Situation(written=E4(4979), scale=degrees, cause=DEGREES),
        "degrees, south and west": Situation(utm(-70.6, -33.4), E4(4326), scale=degrees, cause=DEGREES),
        "degrees with heights of a geoid": Situation(
            written=CRS("EPSG:4326+5773"), scale=degrees, cause=DEGREES
        ),
        "degrees, heights in feet": Situation(
            ATLANTIC, CRS("EPSG:4269+6360"), US_FOOT, scale=degrees, cause=DEGREES
        ),
        "degrees that nobody states": Situation(
            written=E4(4326), records=[], scale=degrees, cause=DEGREES
        ),
        "degrees by keys": Situation(
            written=E4(4326), records=keys(k1024=2, k2048=4326), scale=degrees, cause=DEGREES
        ),
        "degrees to a system asked for": Situation(
            written=E4(4326), scale=degrees, words=["--to-crs", "28992"], cause=DEGREES
        ),
        "a true system to another one": Situation(words=["--to-crs", "EPSG:25831"], cause=r"25831"),
        "two systems": Situation(
            beside=partial(second_tile, E4(25831)), words=["FOLDER/second.laz"], cause=r"25831"
        ),
        "two systems to one": Situation(
            beside=partial(second_tile, E4(25831)), cause=r"25831",
            words=["FOLDER/second.laz", "--to-crs", "EPSG:28992"],
        ),
        "one file without a system": Situation(
            beside=partial(second_tile, None), words=["FOLDER/second.laz"], cause=r"none.*28992|28992.*none"
        ),
        "one file without a system, given": Situation(
            beside=partial(second_tile, None), words=["FOLDER/second.laz", "--crs", "EPSG:28992"]
        ),
    }  # fmt: skip
    feet: dict[str, Situation] = {}
    for name, (unit, length, code) in KINDS.items():
        plain = {"place": ATLANTIC, "height_unit": length, "cause": FEET}
        feet |= {
            f"heights in {name} feet, VERTCS inside": Situation(**plain, records=esri(26918, unit, length)),
            f"heights in {name} feet, VERT_CS inside": Situation(
                **plain, records=esri(26918, unit, length, "VERT_CS")
            ),
            f"heights in {name} feet, WKT 1": Situation(**plain, records=wkt1(26918, unit, length)),
            f"heights in {name} feet, keys": Situation(
                **plain, records=keys(k1024=1, k3072=26918, k3076=9001, k4099=code)
            ),
            f"heights in {name} feet, keys beside WKT": Situation(
                **plain, records=[*words(E4(26918)), *keys(k1024=1, k3072=26918, k4099=code)]
            ),
            f"heights in {name} feet, nobody says": Situation(**plain, records=words(E4(26918))),
        }
    us = {"place": ATLANTIC, "height_unit": US_FOOT, "cause": FEET}
    metre = {"place": ATLANTIC, "cause": CONTRADICTION}
    feet |= {
        "heights in feet, WKT 2": Situation(**us, records=words(CRS("EPSG:26918+6360"))),
        "heights in feet, nobody says, by keys": Situation(**us, records=keys(k1024=1, k3072=26918)),
        "heights in feet, the system of heights by keys": Situation(
            **us, records=keys(k1024=1, k3072=26918, k4096=6360)
        ),
        "heights in feet, WKT beside keys": Situation(
            **us, records=[*words(CRS("EPSG:26918+6360")), *keys(k1024=1, k3072=26918)]
        ),
        "heights in feet, VERTCS inside, the plane given": Situation(
            **us, records=esri(26918, "Foot_US", US_FOOT), words=["--crs", "EPSG:26918"]
        ),
        "heights in feet, keys, the plane given": Situation(
            **us, records=keys(k1024=1, k3072=26918, k4099=9003), words=["--crs", "EPSG:26918"]
        ),
        "heights in feet, metres given": Situation(
            **us, records=words(CRS("EPSG:26918+6360")), words=["--crs", "EPSG:26918+5703"]
        ),
        "plane in feet, heights in metres, VERTCS inside": Situation(
            OREGON, E4(2994), records=esri(2994, "Meter", 1.0)
        ),
        "plane in feet, heights in metres, keys": Situation(
            OREGON, E4(2994),
            records=keys(k1024=1, k3072=2994, k4099=9001),
        ),
        "unit of heights: WKT metres, keys feet": Situation(
            **metre, records=[*words(CRS("EPSG:26918+5703")), *keys(k1024=1, k3072=26918, k4099=9003)]
        ),
        "unit of the plane: WKT metres, keys feet": Situation(
            **metre, records=[*words(E4(26918)), *keys(k1024=1, k3072=26918, k3076=9003)]
        ),
        "zone: WKT 18, keys 17": Situation(
            **metre, records=[*words(E4(26918)), *keys(k1024=1, k3072=26917)]
        ),
        "contradiction, the system given": Situation(
            **metre, records=[*words(E4(26918)), *keys(k1024=1, k3072=26917)], words=["--crs", "26918+5703"]
        ),
        "feet given for metres": Situation(**metre, records=words(E4(26918)), words=["--crs", "feet"]),
        "metres given for feet": Situation(
            OREGON, E4(2994), FOOT,
            records=words(E4(2994)), words=["--crs", "metres"], cause=r"(?i)metre.*f(oo|ee)t|feet.*metre",
        ),
        "feet said for metres, forced": Situation(
            ATLANTIC, records=words(CRS("EPSG:26918+6360")), words=["--crs", "26918+5703", "--crs-force"]
        ),
    }  # fmt: skip
    controls = {
        "control: metres, nobody says of heights": Situation(ATLANTIC, cause=FEET),
        "control: 7415": Situation(records=words(E4(7415))),
        "control: 25832+7837": Situation(utm(9, 52), records=words(CRS("EPSG:25832+7837"))),
        "control: 2056": Situation((E4(2056), 2600000.0, 1200000.0)),
        "control: keys of one mind with WKT": Situation(
            ATLANTIC, records=[*words(E4(26918)), *keys(k1024=1, k3072=26918, k3076=9001, k4099=9001)]
        ),
        "control: feet throughout": Situation(OREGON, E4(2994), FOOT),
        "control: US feet throughout": Situation(utm(-85, 38), E4(3089), US_FOOT),
    }
    return not_true | feet | controls


def variants() -> list[Variant]:
    """The variants of this kind."""
    surfaces = {
        "a surface raster in web mercator": partial(draw_surface, E4(3857), 0.5),
        "a surface raster in degrees": partial(draw_surface, E4(4326), 4e-6),
    }
    drawn = {name: situation.draw for name, situation in situations().items()} | surfaces
    return [Variant("systems", name, draw) for name, draw in drawn.items()]
