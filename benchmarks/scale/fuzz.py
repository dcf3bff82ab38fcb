"""Mutated inputs through the commands: no traceback, no hang, no file half-written.

usage: python -m benchmarks.scale.fuzz [--times 10000] [--seed 1] [--jobs 1] [--kind WORD]

Every input is given to the command that users give it to, in a process whose memory and time are bounded; a
process that dies of an input is counted against it. A refusal must be one line and leave nothing behind;
what is written in spite of the damage must open. With TMPDIR in memory it takes a third of the time.
"""

from __future__ import annotations

import argparse
import io
import json
import multiprocessing
import random
import resource
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

import laspy
import pyproj
import typer.main
from tests.formats.copc_writer import write_copc

from benchmarks.scale.map_mutations import hurt_database, hurt_json
from benchmarks.scale.mutations import Mutate, either, hurt_bytes, hurt_words, put_hurt
from benchmarks.scale.point_mutations import hurt_points
from benchmarks.table import keep
from eaves.cli import app as cli
from eaves.formats import iter_cityjson, open_source, read_polygons
from eaves.formats.vectors.geopackage import Row, write_polygons
from eaves.simulate import scan_town, simulate_town, write_simulation

SECONDS = 300
"""An input that takes longer hangs. A whole one takes half a second, one whose points are strewn over
hundreds of blocks a minute."""
SLOW = 30
"""One that takes longer is named."""
ROOM_BYTES = 3 << 30
"""What the address space may grow by over that of a process that has read whole inputs."""
SIDE = 40
"""Of the scene and of a block (m)."""
BATCH = 500
"""Inputs given to one process, so that a leak shows and a death costs little."""

Answer = tuple[int, int, str, float]
"""An input's number, its exit status, what it did wrong, and its seconds."""
# Typer reads the signatures of all commands at every call, half the time of a refusal.
typer.main.get_command = lru_cache(typer.main.get_command)


@dataclass(frozen=True)
class Kind:
    """One kind of input: the whole file, how it is hurt, and the command it is given to."""

    name: str
    whole: Path
    mutate: Mutate
    words: Callable[[Path, Path], list[str]]


def write_whole(place: Path) -> None:
    """Write a whole input of every kind that the commands read, of a village of a few houses."""
    town = write_simulation(scan_town(simulate_town(0.01, seed=5), 2.0, seed=5), place / "town")
    las, points = laspy.read(town["points"]), place / "a.laz"
    las.points = las.points[(las.x < las.x.min() + SIDE) & (las.y < las.y.min() + SIDE)]
    las.write(place / "a.las")
    las.write(points)
    # COPC knows the newer point formats only.
    write_copc(place / "a.copc.laz", laspy.convert(las, point_format_id=6, file_version="1.4"), levels=2)
    rows = (f"{x:.2f} {y:.2f} {z:.2f}" for x, y, z in las.xyz)
    (place / "a.xyz").write_text("\n".join(rows) + "\n")
    out = place / "out"
    call(["build", str(points), "-o", str(out), "-q"])
    footprints = place / "footprints.gpkg"
    shutil.copy(out / "footprints.gpkg", footprints)
    polygons, ids, _, system = read_polygons(footprints)
    rows_of = [Row(polygon, {"id": name}) for polygon, name in zip(polygons, ids, strict=True)]
    for name in ("a.fgb", "a.geojson"):
        write_polygons(place / name, rows_of, system)
    shutil.copy(out / "buildings.city.jsonl", place / "a.city.jsonl")
    shutil.copy(out / "mask.tif", place / "a.tif")
    (place / "a.wkt").write_text(pyproj.CRS.from_epsg(28992).to_wkt())
    (place / "a.toml").write_text('[detect]\nmethod = "planar_patches"\n[outline]\nmethod = "alpha_shape"\n')


def make_kinds(place: Path) -> list[Kind]:
    """Each kind of input with the command it is given to; the whole ones lie in `place`."""
    points, footprints, out = place / "a.laz", place / "footprints.gpkg", place / "out"

    def build(path: Path, target: Path) -> list[str]:
        return ["build", str(path), "-o", str(target), "-q", "--jobs", "1", "--block", str(SIDE)]

    def with_footprints(path: Path, target: Path) -> list[str]:
        return [*build(points, target), "--footprints", str(path)]

    def detect(path: Path, target: Path) -> list[str]:
        return ["detect", str(path), "-o", str(target), "-q", "--jobs", "1", "--block", str(SIDE)]

    def ground(path: Path, target: Path) -> list[str]:
        return [
            "ground",
            str(path),
            "-o",
            str(target / "ground.laz"),
            "-q",
            "--jobs",
            "1",
            "--block",
            str(SIDE),
        ]

    def validate(path: Path, target: Path) -> list[str]:
        return ["validate", str(path)]

    def judge(what: str) -> Callable[[Path, Path], list[str]]:
        name = {"models": "buildings.city.jsonl"}.get(what, "footprints.gpkg")
        return lambda path, target: ["evaluate", what, str(out / name), str(path), "-o", str(target)]

    def clipped(path: Path, target: Path) -> list[str]:
        return [*detect(points, target), "--clip", str(path)]

    def placed(path: Path, target: Path) -> list[str]:
        return [*ground(points, target), "--crs", str(path)]

    def scanned(path: Path, target: Path) -> list[str]:
        return ["simulate", "-o", str(target), "--model", str(path), "--density", "0.2", "-q"]

    def configured(path: Path, target: Path) -> list[str]:
        return [*build(points, target), "--config", str(path)]

    las, base, document = (either(0.6, mine, other) for mine, other in (
        (hurt_points, hurt_bytes), (hurt_database, hurt_bytes), (hurt_json, hurt_words)
    ))  # fmt: skip
    city = place / "a.city.jsonl"
    return [
        Kind("LAS", place / "a.las", las, build),
        Kind("LAZ", points, las, detect),
        Kind("COPC", place / "a.copc.laz", las, build),
        Kind("text points", place / "a.xyz", hurt_words, ground),
        Kind("GeoPackage footprints", footprints, base, with_footprints),
        Kind("FlatGeobuf footprints", place / "a.fgb", hurt_bytes, with_footprints),
        Kind("GeoJSON footprints", place / "a.geojson", document, with_footprints),
        Kind("CityJSONSeq to validate", city, document, validate),
        Kind("CityJSONSeq to compare with", city, document, judge("models")),
        Kind("CityJSONSeq to scan", city, document, scanned),
        Kind("GeoPackage to compare with", footprints, base, judge("footprints")),
        Kind("GeoTIFF to compare with", place / "a.tif", hurt_bytes, judge("detection")),
        Kind("GeoJSON to clip by", place / "a.geojson", document, clipped),
        Kind("coordinate system", place / "a.wkt", hurt_words, placed),
        Kind("configuration", place / "a.toml", hurt_words, configured),
    ]


def call(words: list[str]) -> tuple[int, str]:
    """The command in this process: its exit status and what it said on standard error."""
    said, before = io.StringIO(), sys.argv
    sys.argv = ["eaves", *words]
    try:
        with redirect_stderr(said), redirect_stdout(io.StringIO()):
            cli.main()
    except SystemExit as end:
        return int(end.code or 0), said.getvalue()
    finally:
        sys.argv = before
    return 0, said.getvalue()


def wrong_with(status: int, said: str, out: Path) -> str:
    """What breaks the promise, or nothing."""
    if status not in (0, 1, 2):
        return f"exit status {status}"
    if status == 2 and len(said.strip().splitlines()) < 1:
        return "a refusal without a word"
    if status == 2 and len([line for line in said.splitlines() if line.startswith("error:")]) != 1:
        return "a refusal that is not one line"
    left = sorted(path for path in out.rglob("*") if path.is_file()) if out.exists() else []
    if any(path.name.startswith(".") or path.parent.name.startswith(".") for path in left if status != 1):
        return f"a half-written file: {left[0].name}"
    try:
        for path in left:
            open_again(path)
    except Exception as error:  # whatever its reader raises, the file is no good
        return f"{path.name} does not open: {error}"
    return ""


def open_again(path: Path) -> None:
    """Open a written file; whatever its reader raises, if it cannot be."""
    if path.name.endswith((".city.jsonl", ".city.json")):
        for _ in iter_cityjson(path):
            pass
    elif path.suffix in (".gpkg", ".fgb", ".geojson"):
        read_polygons(path)
    elif path.suffix in (".las", ".laz"):
        open_source(path)
    elif path.suffix == ".json":
        json.loads(path.read_text())


def try_batch(place: str, numbers: Sequence[int], seed: int, answers: Connection) -> None:
    """Give a batch of inputs to the commands: a number when one begins, its answer when it ends."""
    kinds, wholes = make_kinds(Path(place)), Path(place) / f"whole-{numbers[0]}"
    for kind in kinds:  # loads everything once, so that the room below is for the inputs alone
        call(kind.words(kind.whole, wholes / kind.name))
    shutil.rmtree(wholes)
    others = [kind.whole for kind in kinds]
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + ROOM_BYTES, resource.RLIM_INFINITY))
    for number in numbers:
        answers.send((number,))
        kind, chance = kinds[number % len(kinds)], random.Random(f"{seed} {number}")
        path = input_path(place, kind, number)
        out = path.parent / "out"
        path.parent.mkdir()
        put_hurt(path, kind.whole.read_bytes(), kind.mutate, others, chance)
        started = time.monotonic()
        try:
            status, said = call(kind.words(path, out))
            fault = wrong_with(status, said, out)
        except BaseException as error:
            status, fault = -1, f"{type(error).__name__}: {error}"
        seconds = time.monotonic() - started
        shutil.rmtree(path.parent if not fault else out, ignore_errors=True)
        answers.send((number, status, fault, seconds))


def input_path(place: str | Path, kind: Kind, number: int) -> Path:
    """Where an input lies until it has done no harm."""
    return Path(place) / f"input-{number}" / kind.whole.name


def try_all(place: Path, numbers: Sequence[int], seed: int, jobs: int) -> Iterator[Answer]:
    """Every input's answer; one whose process dies or is still at work after SECONDS has that for a fault."""
    # Not by fork: threads of the libraries do not come along.
    spawn = multiprocessing.get_context("spawn")
    waiting = [numbers[start : start + BATCH] for start in range(0, len(numbers), BATCH)][::-1]
    running: list[Running] = []
    while waiting or running:
        while waiting and len(running) < jobs:
            batch = waiting.pop()
            ours, theirs = spawn.Pipe(duplex=False)
            process = spawn.Process(target=try_batch, args=(str(place), batch, seed, theirs))
            process.start()
            theirs.close()
            running.append(Running(process, ours, batch))
        for one in list(running):
            yield from one.heard()
            if not one.over():
                continue
            running.remove(one)
            if one.at_work is not None:
                yield one.at_work, -1, one.end(), time.monotonic() - one.since
                if rest := one.numbers[one.numbers.index(one.at_work) + 1 :]:
                    waiting.append(rest)
        time.sleep(0.02)


@dataclass
class Running:
    """A process with a batch of inputs, and the input it is at work on."""

    process: BaseProcess
    answers: Connection
    numbers: Sequence[int]
    at_work: int | None = None
    since: float = 0.0
    ended: bool = False

    def heard(self) -> Iterator[Answer]:
        """The answers that have arrived."""
        try:
            while self.answers.poll():
                message = self.answers.recv()
                if len(message) == 1:
                    self.at_work, self.since = message[0], time.monotonic()
                else:
                    self.at_work = None
                    yield message
        except (EOFError, OSError):
            self.ended = True
            self.process.join()

    def over(self) -> bool:
        """Whether the process has ended, or must be."""
        late = self.at_work is not None and time.monotonic() - self.since > SECONDS
        return late or self.ended

    def end(self) -> str:
        """End the process; why."""
        if self.process.is_alive():
            self.process.kill()
            return f"still at work after {SECONDS} s"
        return f"the process died ({self.process.exitcode})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument(
        "--kind", default="", help="Of the inputs only those of kinds with this in their name."
    )
    parser.add_argument("--faults", type=Path, help="A folder to keep the inputs in that did harm.")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(temporary)
        write_whole(place)
        kinds = make_kinds(place)
        for kind in kinds:
            status, said = call(kind.words(kind.whole, place / "whole" / kind.name))
            if status:
                raise RuntimeError(f"the whole input is refused: {kind.name}: {said}")
        commands = {kind.name: kind.words(kind.whole, place)[0] for kind in kinds}
        counts: dict[str, Counter[str]] = {kind.name: Counter() for kind in kinds if asked.kind in kind.name}
        slowest: dict[str, float] = dict.fromkeys(counts, 0.0)
        numbers = [k for k in range(asked.times) if kinds[k % len(kinds)].name in counts]
        with suppress(KeyboardInterrupt):  # the table then holds those tried so far
            for number, status, fault, seconds in try_all(place, numbers, asked.seed, asked.jobs):
                kind = kinds[number % len(kinds)]
                name = kind.name
                counts[name]["inputs"] += 1
                counts[name][{0: "complete", 1: "incomplete", 2: "refused"}.get(status, "other")] += 1
                counts[name]["faults"] += bool(fault)
                slowest[name] = max(slowest[name], seconds)
                if fault or seconds > SLOW:
                    print(f"input {number} ({name}), {seconds:.1f} s: {fault or 'slow'}", flush=True)
                if fault and asked.faults:
                    shutil.copytree(
                        input_path(place, kind, number).parent,
                        asked.faults / str(number),
                        symlinks=True,
                        dirs_exist_ok=True,
                    )
    rows = [
        {"input": name, "command": commands[name]}
        | {word: count[word] for word in ("inputs", "complete", "incomplete", "refused", "faults")}
        | {"slowest s": round(slowest[name], 1)}
        for name, count in counts.items()
    ]
    words = f"--times {asked.times} --seed {asked.seed}" + (f" --kind '{asked.kind}'" if asked.kind else "")
    keep("fuzz", "Mutated inputs", rows, f"python -m benchmarks.scale.fuzz {words}")


if __name__ == "__main__":
    main()
