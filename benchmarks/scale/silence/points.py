"""Points that lie twice, far apart, in archives, or a step higher than their neighbours."""

from __future__ import annotations

import gzip
import json
import re
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import laspy
import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray

from benchmarks.scale.silence import Drawn, Variant
from benchmarks.scale.silence.houses import (
    GROUND,
    NOISE,
    PLACE,
    SIDE,
    SYSTEM,
    Scene,
    World,
    draw_houses,
    in_world,
    measured_wrong,
)

Judge = Callable[[Path], str]
Mask = NDArray[np.bool_]
COPIED = (
    r"\d[\d,]* (identical |of \d[\d,]* )?points.{0,80}(identical|twice|copies|again)|identical points: \d"
)
"""What is said of points that lie twice, with how many there are."""
STEP = r"(higher|lower|step|differ).{0,60}\d\.\d+ m|\d\.\d+ m.{0,60}(higher|lower|step)"
"""What is said of tiles at two heights, with the difference."""
LONGEST_S, DENSITY_OFF, LEVEL_OFF = 60.0, 0.25, 0.1
"""Seconds that a run over tiles far apart may take, share by which `eaves info` may miss the density, and m
by which the ground may."""


def write_tile(
    path: Path,
    world: World,
    times: NDArray[np.float64] | None = None,
    strip: int = 1,
    scale: float = 0.001,
    offset: Sequence[float] = (85000.0, 446000.0, 0.0),
    classes: int = 1,
    returns: NDArray[np.int64] | None = None,
) -> Path:
    """Write points with their times (none: a format without) and the number of their strip; the path."""
    if path.suffix == ".xyz":
        np.savetxt(path, world, "%.3f")
        return path
    header = laspy.LasHeader(
        point_format=0 if times is None else 6, version="1.2" if times is None else "1.4"
    )
    header.scales, header.offsets = np.full(3, scale), np.array(offset)
    header.add_crs(SYSTEM)
    las = laspy.LasData(header)
    las.xyz = world
    las.return_number[:] = 1 if returns is None else returns
    las.number_of_returns[:] = 1 if returns is None else int(returns.max())
    las.classification[:] = classes
    las.point_source_id[:] = strip
    if times is not None:
        las.gps_time = times
    las.write(path)
    return path


def times_of(count: int) -> NDArray[np.float64]:
    """Times of so many pulses."""
    return 3e8 + np.arange(count) * 1e-5


def drawn(
    folder: Path,
    rng: np.random.Generator,
    write: Callable[[Path, Scene, World], Sequence[Path]],
    judge: Callable[[Scene], Judge] = measured_wrong,
    cause: str = "never said",
    words: Sequence[str] = ("--outputs", "footprints,models"),
) -> Drawn:
    """Houses, the files that `write` makes of their points, and the command that takes these."""
    scene = draw_houses(rng)
    files = write(folder, scene, in_world(scene.xyz))
    return Drawn(["build", *map(str, files), "-o", "OUT", *words], judge(scene), cause)


def results_of(out: Path) -> list[tuple[object, ...]]:
    """Outline and figures of each building of a run, in order."""
    rows = pyogrio.read_dataframe(out / "footprints.gpkg", layer="footprints")
    figures = rows[["area_m2", "volume_m3", "h_max", "h_ground", "rmse_m", "trust_score"]]
    places = [shapely.to_wkb(shapely.normalize(shape)) for shape in rows.geometry]
    return sorted(zip(places, *(figures[name] for name in figures), strict=True))


def as_plain(scene: Scene, times: bool = True) -> Judge:
    """The judge that builds the points without their copies, too, and holds the results equal to those."""

    def judge(out: Path) -> str:
        world = in_world(scene.xyz)
        tile = write_tile(out.parent / "once.laz", world, times_of(len(world)) if times else None)
        once = out.parent / "once"
        words = ["build", str(tile), "-o", str(once), "--outputs", "footprints,models"]
        subprocess.run([sys.executable, "-m", "eaves", *words], check=True, capture_output=True)
        equal = results_of(out) == results_of(once)
        return measured_wrong(scene)(out) or ("" if equal else "results are others than without copies")

    return judge


def quiet(scene: Scene, pattern: str = f"{COPIED}|{STEP}", heights: bool = True) -> Judge:
    """The judge of controls: all is right, and nothing of the kind is said."""

    def judge(out: Path) -> str:
        facts = json.loads((out / "run.json").read_text(encoding="utf-8"))
        told = re.search(pattern, json.dumps(facts.get("remarks", []), ensure_ascii=False))
        return measured_wrong(scene, heights)(out) or (f"says {told[0]!r}" if told else "")

    return judge


def level(scene: Scene) -> Judge:
    """The judge of heights above the datum: those of the ground, as well as the houses."""

    def judge(out: Path) -> str:
        ground = pyogrio.read_dataframe(out / "footprints.gpkg", layer="footprints").h_ground
        off = float(np.abs(ground - GROUND).max())
        return f"the ground is off by {off:.2f} m" if off > LEVEL_OFF else measured_wrong(scene)(out)

    return judge


def named_twice(
    names: Sequence[str] = ("a.laz", "b.laz"), timed: bool = True, **second: object
) -> Callable[[Path, Scene, World], Sequence[Path]]:
    """What writes the same points under several names, from the second on with other facts."""

    def write(folder: Path, scene: Scene, world: World) -> Sequence[Path]:
        times = times_of(len(world)) if timed else None
        first = write_tile(folder / names[0], world, times)
        return [first, *(write_tile(folder / name, world, times, **second) for name in names[1:])]  # type: ignore[arg-type]

    return write


def within_one(
    copies: Callable[[World, np.random.Generator], NDArray[np.int64]], timed: bool = True
) -> Callable[[Path, Scene, World], Sequence[Path]]:
    """What writes the points and then those of some numbers again, in one file."""

    def write(folder: Path, scene: Scene, world: World) -> Sequence[Path]:
        order = np.concatenate([np.arange(len(world)), copies(world, np.random.default_rng(1))])
        times = times_of(len(world))[order] if timed else None
        return [write_tile(folder / "tile.laz", world[order], times)]

    return write


def parts_of(world: World, columns: int, rows: int, buffer: float) -> list[Mask]:
    """Masks of the points of tiles that together are the scene, each with a buffer (m)."""
    local = world[:, :2] - PLACE
    masks = []
    for column in range(columns):
        for row in range(rows):
            low = np.array([column * SIDE / columns, row * SIDE / rows]) - buffer
            high = np.array([(column + 1) * SIDE / columns, (row + 1) * SIDE / rows]) + buffer
            masks.append(((local >= low) & (local < high)).all(axis=1))
    return masks


def tiled(
    columns: int = 2,
    rows: int = 1,
    buffer: float = 0.0,
    lifts: Sequence[float] = (),
    slope: float = 0.0,
) -> Callable[[Path, Scene, World], Sequence[Path]]:
    """What writes tiles, each lifted by its number of metres."""

    def write(folder: Path, scene: Scene, world: World) -> Sequence[Path]:
        times, files = times_of(len(world)), []
        sloped = world + np.outer(world[:, 0] - PLACE[0], (0.0, 0.0, slope))
        for number, mask in enumerate(parts_of(world, columns, rows, buffer)):
            moved = sloped[mask] + (0.0, 0.0, lifts[number] if number < len(lifts) else 0.0)
            files.append(write_tile(folder / f"tile_{number}.laz", moved, times[mask], strip=number + 1))
        return files

    return write


def write_overlapping(lift: float = 0.0) -> Callable[[Path, Scene, World], Sequence[Path]]:
    """What writes two tiles that overlap by 30 m, of other pulses each, the second one lifted."""

    def write(folder: Path, scene: Scene, world: World) -> Sequence[Path]:
        rng = np.random.default_rng(2)
        chosen, x = rng.random(len(world)) < 0.5, world[:, 0] - PLACE[0]
        times = times_of(len(world))
        masks = (x < 30) | ((x < 60) & chosen), (x >= 60) | ((x >= 30) & ~chosen)
        lifts = (0.0, lift)
        return [
            write_tile(folder / f"tile_{n}.laz", world[mask] + (0.0, 0.0, lifts[n]), times[mask], strip=n + 1)
            for n, mask in enumerate(masks)
        ]

    return write


def write_strips(folder: Path, scene: Scene, world: World) -> Sequence[Path]:
    """Two strips over the whole scene, of other pulses, in a file each, in steps of a centimetre."""
    again = world + np.random.default_rng(3).normal(0.0, NOISE, world.shape) * (10.0, 10.0, 0.0)
    flat = scene.house < 0
    again = again[flat]
    times = times_of(len(world))
    first = write_tile(folder / "strip_1.laz", world, times, strip=1, scale=0.01)
    return [first, write_tile(folder / "strip_2.laz", again, times[flat] + 500.0, strip=2, scale=0.01)]


def write_coarse(folder: Path, scene: Scene, world: World) -> Sequence[Path]:
    """Points of a scanner with steps of 10 cm, where pulses of other times fall on the same place."""
    return [write_tile(folder / "tile.laz", world, times_of(len(world)), scale=0.02)]


def write_far(
    *ways: tuple[float, float], single: bool = False
) -> Callable[[Path, Scene, World], Sequence[Path]]:
    """What writes the tile, and bare ground (or a point) so many metres away from it."""

    def write(folder: Path, scene: Scene, world: World) -> Sequence[Path]:
        times, files = times_of(len(world)), [folder / "tile.laz"]
        write_tile(files[0], world, times)
        for number, way in enumerate(ways):
            bare = world[scene.house < 0][: 1 if single else None] + (*way, 0.0)
            files.append(write_tile(folder / f"far_{number}.laz", bare, times[: len(bare)] + 1e4))
        return files

    return write


def soon(scene: Scene) -> Judge:
    """The judge of tiles far apart: in time, and `eaves info` states the true density."""

    def judge(out: Path) -> str:
        facts = json.loads((out / "run.json").read_text(encoding="utf-8"))
        words = [sys.executable, "-m", "eaves", "info", *(entry["path"] for entry in facts["inputs"])]
        told = subprocess.run(words, capture_output=True, text=True, timeout=LONGEST_S).stdout
        density = re.search(r"density\s+([\d.]+)", told)
        true = len(scene.xyz) / SIDE**2
        if density is None or abs(float(density[1]) / true - 1) > DENSITY_OFF:
            return f"info states {density and density[1]} points/m² for {true:.1f}"
        if float(facts["elapsed_seconds"]) > LONGEST_S:
            return f"took {facts['elapsed_seconds']} s"
        return measured_wrong(scene)(out)

    return judge


def archived(*names: str, archive: str = "tile.zip") -> Callable[[Path, Scene, World], Sequence[Path]]:
    """What writes tiles into an archive."""

    def write(folder: Path, scene: Scene, world: World) -> Sequence[Path]:
        times, path = times_of(len(world)), folder / archive
        masks = parts_of(world, max(len(names), 1), 1, 0.0)
        inner = folder / "inner"
        inner.mkdir()
        files = [
            write_tile(inner / name, world[mask], times[mask])
            for name, mask in zip(names, masks, strict=False)
        ]
        if not names:
            files = [inner / "readme.txt"]
            files[0].write_text("no points here", encoding="utf-8")
        if archive.endswith(".zip"):
            with zipfile.ZipFile(path, "w") as packed:
                for file in files:
                    packed.write(file, f"delivery/{file.name}")
        elif archive.endswith(".tar.gz"):
            with tarfile.open(path, "w:gz") as packed_tar:
                for file in files:
                    packed_tar.add(file, file.name)
        else:
            path.write_bytes(gzip.compress(files[0].read_bytes()))
        for file in files:
            file.unlink()
        return [path]

    return write


def a_strip(world: World, rng: np.random.Generator) -> NDArray[np.int64]:
    """The numbers of the points of a strip through the scene."""
    return np.flatnonzero(np.abs(world[:, 0] - PLACE[0] - 45) < 30)


def all_points(world: World, rng: np.random.Generator, times: int = 1) -> NDArray[np.int64]:
    """The numbers of all points, some times over, in any order."""
    return rng.permutation(np.tile(np.arange(len(world)), times))


twice = partial(drawn, judge=as_plain, cause=COPIED)
unpack = r"tile\.\S*(zip|gz).*(unzip|gunzip|tar -x|unpack)"
SITUATIONS: dict[str, Callable[[Path, np.random.Generator], Drawn]] = {
    "a file under two names": partial(twice, write=named_twice()),
    "a file under three names": partial(twice, write=named_twice(("a.laz", "b.laz", "c.las"))),
    "a file twice, one with classes": partial(twice, write=named_twice(classes=5)),
    "a file twice, without times": partial(
        twice, write=named_twice(timed=False), judge=partial(as_plain, times=False)
    ),
    "text twice": partial(
        twice,
        write=named_twice(("a.xyz", "b.xyz")),
        judge=measured_wrong,
        words=("--crs", "28992", "--outputs", "footprints,models"),
    ),
    "tiles with a buffer of 10 m": partial(twice, write=tiled(buffer=10.0)),
    "four tiles with a buffer of 5 m": partial(twice, write=tiled(2, 2, buffer=5.0)),
    "a strip copied in its file": partial(twice, write=within_one(a_strip)),
    "every point twice in a file": partial(twice, write=within_one(all_points)),
    "every point five times": partial(twice, write=within_one(partial(all_points, times=4))),
    "a strip copied, without times": partial(
        twice, write=within_one(a_strip, timed=False), judge=partial(as_plain, times=False)
    ),
    "one point doubled": partial(twice, write=within_one(lambda world, rng: np.array([4321]))),
    "one point a thousand times": partial(twice, write=within_one(lambda world, rng: np.full(1000, 4321))),
    "control: two strips of other points": partial(drawn, write=write_strips, judge=quiet),
    "control: pulses that meet by chance": partial(drawn, write=write_coarse, judge=quiet),
    "control: tiles that touch": partial(drawn, write=tiled(), judge=quiet),
    "control: tiles that overlap, other pulses": partial(drawn, write=write_overlapping(), judge=quiet),
    "control: tiles on a slope": partial(drawn, write=tiled(slope=0.05), judge=partial(quiet, heights=False)),
    "two tiles 192 km apart": partial(drawn, write=write_far((120e3, 150e3)), judge=soon, words=()),
    "three tiles on a diagonal": partial(
        drawn, write=write_far((40e3, 40e3), (80e3, 90e3)), judge=soon, words=()
    ),
    "a file of one point 60 km away": partial(
        drawn, write=write_far((60e3, 0.0), single=True), judge=soon, words=()
    ),
    "a tile in an archive": partial(drawn, write=archived("a.laz"), cause=unpack),
    "two tiles in an archive": partial(drawn, write=archived("a.las", "b.laz"), cause=unpack),
    "an archive without points": partial(drawn, write=archived(), cause=r"tile\.zip"),
    "a tile in gzip": partial(drawn, write=archived("a.las", archive="tile.las.gz"), cause=unpack),
    "tiles in tar": partial(drawn, write=archived("a.las", archive="tile.tar.gz"), cause=unpack),
    "a step of .3 m": partial(
        drawn, write=tiled(lifts=(0.0, 0.3)), judge=level, cause=rf"(?={STEP}).*0\.(2[89]|3[0-2])\d* m"
    ),
    "a step of .5 m": partial(
        drawn, write=tiled(lifts=(0.5,)), judge=level, cause=rf"(?={STEP}).*0\.(4[89]|5[0-2])\d* m"
    ),
    "a step of 1 m, one of four": partial(
        drawn, write=tiled(2, 2, lifts=(0.0, 0.0, 1.0)), judge=level, cause=r"1\.0[0-2]?\d* m|0\.9[89]\d* m"
    ),
    "a step of .5 m where tiles overlap": partial(
        drawn, write=write_overlapping(0.5), judge=level, cause=rf"(?={STEP}).*0\.(4[89]|5[0-2])\d* m"
    ),
}


def variants() -> list[Variant]:
    """The variants of this kind."""
    return [Variant("points", name, draw) for name, draw in SITUATIONS.items()]
