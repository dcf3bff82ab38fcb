"""Every reader of foreign data is given mutated files, in a process of bounded memory, for so many seconds.

The property: a reader answers or raises InputError or ValueError of one line; nothing else, in less than ten
seconds of the processor, and without more memory than its whole file needs a hundred times over.

usage: python -m benchmarks.scale.readers [--seconds S] [--seed N] [--reader WORD]
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import random
import signal
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.queues import Queue
from pathlib import Path
from typing import Any

import shapely

from benchmarks.scale import fuzz
from benchmarks.scale.map_mutations import hurt_database, hurt_json
from benchmarks.scale.mutations import Mutate, either, hurt_bytes, hurt_words
from benchmarks.scale.point_mutations import hurt_points
from benchmarks.table import keep
from eaves.cli.runs import read_recipe
from eaves.flow.edits import FLAT_ROOF, Edit, read_edits, write_edits
from eaves.formats import iter_chunks, iter_cityjson, open_source, read_polygons, read_raster
from eaves.formats.crs import parse_crs, system_of
from eaves.formats.points.remote import Traffic, files_of_list
from eaves.formats.vectors.geopackage import Row, write_polygons
from eaves.model import CoordinateSystem
from eaves.pipeline import build
from eaves.run.manifest import check_folder, read_manifest
from eaves.run.memory import limit_memory
from eaves.run.store import is_whole_part, load_part
from eaves.validate import validate_file

ROOM = 1_500_000_000
"""Bytes of data of the process that reads: libraries and kernels take half."""
LONGEST = 10
Read = Callable[[Path], Any]


@dataclass(frozen=True)
class Reader:
    """A whole file, how it is hurt, and what reads it."""

    whole: Path
    mutate: Mutate
    read: Read


def read_points(path: Path) -> None:
    """All points of a file."""
    source = open_source(path)
    for _ in iter_chunks(source):
        pass


def read_cities(path: Path) -> None:
    """All objects of a CityJSON file."""
    for _ in iter_cityjson(path):
        pass


def read_part(path: Path) -> None:
    """All arrays of a part of a kept run, where its checksums say that it is whole."""
    if not is_whole_part(path):
        raise ValueError("is damaged")
    load_part(path)


def write_files(place: Path) -> None:
    """Write a whole file for each reader."""
    fuzz.write_whole(place)
    build(str(place / "a.laz"), place / "kept", keep=True, outputs=("footprints", "models"))
    (place / "a.csv").write_text("id,verdict\nb1,no building\nb2,flat roof\n")
    square = {"type": "Polygon", "coordinates": [[[0, 0], [9, 0], [9, 9], [0, 0]]]}
    feature = {"type": "Feature", "assets": {"data": {"href": "a.laz"}}, "properties": {}, "geometry": square}
    write_edits(place / "edits.gpkg", [Edit(FLAT_ROOF, shapely.box(0, 0, 9, 9), "b1")], CoordinateSystem())
    write_polygons(place / "b.geojson", [Row(shapely.box(4.36, 52.0, 4.37, 52.01), {"id": "b1"})])
    (place / "a.vpc").write_text(json.dumps({"type": "FeatureCollection", "features": [feature] * 3}))


def make_readers(place: Path) -> Mapping[str, Reader]:
    """The readers of the files that `write_files` wrote."""
    kept = place / "kept"
    parts = sorted(kept.glob(".eaves-work/buildings/*.part")) or sorted(kept.glob(".eaves-work/**/*.part"))
    points, base, document = (
        either(0.6, one, other)
        for one, other in ((hurt_points, hurt_bytes), (hurt_database, hurt_bytes), (hurt_json, hurt_words))
    )
    metres, dutch = CoordinateSystem(), system_of(parse_crs("EPSG:28992"), place, (0.0, 0.0))
    return {
        "LAS": Reader(place / "a.las", points, read_points),
        "LAZ": Reader(place / "a.laz", points, read_points),
        "COPC": Reader(place / "a.copc.laz", points, read_points),
        "text points": Reader(place / "a.xyz", hurt_words, read_points),
        "VPC": Reader(place / "a.vpc", document, lambda path: list(files_of_list(path, None, Traffic()))),
        "GeoPackage": Reader(place / "footprints.gpkg", base, read_polygons),
        "GeoJSON": Reader(place / "b.geojson", document, lambda path: read_polygons(path, target=dutch)),
        "FlatGeobuf": Reader(place / "a.fgb", hurt_bytes, read_polygons),
        "CityJSON": Reader(place / "a.city.jsonl", document, read_cities),
        "CityJSON to validate": Reader(place / "a.city.jsonl", document, validate_file),
        "GeoTIFF": Reader(place / "a.tif", hurt_bytes, read_raster),
        "edits.csv": Reader(place / "a.csv", hurt_words, lambda path: read_edits(path, metres, {})),
        "edits.gpkg": Reader(place / "edits.gpkg", base, lambda path: read_edits(path, metres)),
        "configuration": Reader(place / "a.toml", hurt_words, lambda path: read_recipe({}, (path, ()))),
        "list of files": Reader(
            kept / "run.json", document, lambda path: (read_manifest(path.parent), check_folder(path.parent))
        ),
        "kept part": Reader(parts[0], hurt_bytes, read_part),
    }


def try_reader(place: Path, title: str, seconds: float, seed: int, answers: Queue[Any]) -> None:
    """Give a reader mutated files, and report how many it read and refused, and what else came of them."""
    import logging

    logging.disable(logging.CRITICAL)
    warnings.simplefilter("ignore")
    reader = make_readers(place)[title]
    limit_memory(ROOM)
    signal.signal(signal.SIGPROF, give_up)
    chance, end = random.Random(seed), time.monotonic() + seconds
    counts, faults = Counter[str](), dict[str, str]()
    data, last_place = reader.whole.read_bytes(), Path(save(b"", Path(f"last-{reader.whole.name}")))
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / reader.whole.name
        while time.monotonic() < end:
            hurt = reader.mutate(data, chance)
            path.write_bytes(hurt)
            last_place.write_bytes(hurt)
            signal.setitimer(signal.ITIMER_PROF, LONGEST)
            try:
                reader.read(path)
                counts["read"] += 1
            except ValueError as error:
                counts["refused"] += 1
                if not str(error).strip() or "\n" in str(error):
                    faults.setdefault(f"a refusal that is not one line: {error!r}"[:300], save(hurt, path))
            except BaseException as error:
                counts["faults"] += 1
                last = traceback.extract_tb(error.__traceback__)[-1]
                told = f"{type(error).__name__} in {last.name}: {error}"[:300]
                faults.setdefault(told, save(hurt, path))
            signal.setitimer(signal.ITIMER_PROF, 0)
    answers.put((dict(counts), faults))


def give_up(number: int, frame: object) -> None:
    """End what takes too long."""
    raise TimeoutError("took more than ten seconds of the processor")


def save(data: bytes, path: Path) -> str:
    """Keep an input that a reader failed at; its path."""
    folder = Path(tempfile.gettempdir()) / "readers"
    folder.mkdir(exist_ok=True)
    kept = folder / f"{abs(hash(data)) % 10**8}-{path.name}"
    kept.write_bytes(data)
    return str(kept)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--reader", default="", help="Only readers with this in their name.")
    asked = parser.parse_args()
    context = multiprocessing.get_context("spawn")  # a process with threads of its own cannot be forked
    rows: list[dict[str, object]] = []
    told = list[str]()
    with tempfile.TemporaryDirectory() as name:
        write_files(Path(name))
        for title in [title for title in make_readers(Path(name)) if asked.reader in title]:
            answers: Queue[Any] = context.Queue()
            words = (Path(name), title, asked.seconds, asked.seed, answers)
            process = context.Process(target=try_reader, args=words)
            process.start()
            counts, faults = {}, {"the process was killed, or hung": ""}
            with suppress(Exception):
                counts, faults = answers.get(timeout=asked.seconds + 60.0)
            process.kill()
            process.join()
            names = {one: counts.get(one, 0) for one in ("read", "refused")}
            rows.append({"reader": title, "inputs": sum(counts.values()), **names, "faults": len(faults)})
            told += [f"- {title}: {fault}" for fault in faults]
            print(rows[-1], *faults.items(), flush=True)
    command = f"python -m benchmarks.scale.readers --seconds {asked.seconds:g} --seed {asked.seed}"
    keep("readers", "Mutated files", rows, command, "\n".join(told))


if __name__ == "__main__":
    main()
