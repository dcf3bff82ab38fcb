"""Runs are killed, crowded, starved, tampered with and given files that lie, by seed.

The property: no run ends with status 0 unless `eaves check` passes and its results are the undisturbed run's;
a run that ends with another status says why in words, and can be resumed where resuming is promised.

usage: python -m benchmarks.scale.hostile [--seconds S] [--log FILE.jsonl]

A log goes on where it ended: each case is made of its number alone.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.scale.identical import digest
from benchmarks.table import keep
from eaves.run.manifest import check_folder
from eaves.simulate import nine_roofs_on_a_slope, write_simulation

LIMITS = (
    "import resource, runpy, sys; kind, size = sys.argv[1], int(sys.argv[2]); sys.argv[1:3] = []; "
    "resource.setrlimit(getattr(resource, kind), (size, size)); "
    "runpy.run_module('eaves', run_name='__main__')"
)
GOOD = ("right", "said so")
NOTE = (
    "Right: status 0, `eaves check` passes, the results are the undisturbed run's (of mutated points: it "
    "passes). Said so: another status, with its reason in a line; a run that was ended was resumed and then "
    "right. Wrong: anything else."
)
LONGEST = 300.0
"""Seconds after which a run counts as hung."""


@dataclass(frozen=True)
class Bench:
    """The undisturbed run and what is needed to disturb others."""

    place: Path
    points: Path
    right: tuple[str, str]
    seconds: float

    def words(self, out: Path, *more: str, points: Path | None = None) -> list[str]:
        """A build of the scene."""
        given = str(points or self.points)
        return [sys.executable, "-m", "eaves", "build", given, "-q", "--block", "60", "-o", str(out), *more]

    def run(self, words: list[str]) -> tuple[int, str]:
        """Status and what was said."""
        done = subprocess.run(words, capture_output=True, text=True, timeout=LONGEST)
        return done.returncode, done.stderr

    def judge(self, status: int, said: str, out: Path, same: bool = True) -> str:
        """`right`, `said so` or what is wrong."""
        if "Traceback" in said or status not in (0, 1, 2, 130, 143):
            return f"status {status}: {said.strip()[-200:]}"
        if status != 0:
            return "said so" if said.strip() else f"status {status} without a word"
        if wrong := check_folder(out):
            return f"status 0, and {wrong[0]}"
        return "right" if not same or digest(out) == self.right else "status 0, other results"

    def finish(self, out: Path, *more: str) -> str:
        """Resume a run to its end."""
        status, said = self.run(self.words(out, "--resume", "--jobs", "1", *more))
        verdict = self.judge(status, said, out)
        return verdict if verdict != "said so" else f"cannot be resumed: {said.strip()[-200:]}"


def killed(bench: Bench, chance: random.Random, out: Path) -> str:
    """A run ended by a signal at a random moment, and resumed."""
    process = start(bench, out, "--jobs", chance.choice("12"))
    time.sleep(chance.uniform(0.3, 1.2) * bench.seconds)
    process.send_signal(chance.choice([signal.SIGKILL, signal.SIGTERM, signal.SIGINT]))
    process.communicate(timeout=LONGEST)
    if out.exists() and not (out / "run.json").exists() and chance.random() < 0.5:
        shift_clocks(out, chance)
    return bench.finish(out)


def shift_clocks(out: Path, chance: random.Random) -> None:
    """Make what is there a day older or younger."""
    for path in [one for one in out.rglob("*") if one.is_file()]:
        moment = path.stat().st_mtime + chance.choice([-86400, 86400])
        os.utime(path, (moment, moment))


def killed_by_tiles(bench: Bench, chance: random.Random, out: Path) -> str:
    """The same tile by tile, the merge included."""
    process = start(bench, out, "--jobs", "1", "--per-tile")
    time.sleep(chance.uniform(0.5, 1.1) * bench.seconds)
    process.kill()
    process.communicate(timeout=LONGEST)
    status, said = bench.run(bench.words(out, "--resume", "--jobs", "1", "--per-tile"))
    verdict = bench.judge(status, said, out, same=False)
    if verdict != "right":
        return verdict
    return "right" if digest(out)[0] == bench.right[0] else "status 0, other results"


def damaged_parts(bench: Bench, chance: random.Random, out: Path) -> str:
    """A run that was killed, one of its parts damaged, and resumed."""
    process = start(bench, out, "--jobs", "1")
    time.sleep(chance.uniform(0.6, 1.1) * bench.seconds)
    process.kill()
    process.communicate(timeout=LONGEST)
    parts = sorted(one for one in out.glob(".eaves-work/**/*") if one.is_file())
    if parts:
        damage(chance.choice(parts), chance)
    return bench.finish(out)


def damage(path: Path, chance: random.Random) -> None:
    """Cut a file, empty it, or change a byte."""
    data = bytearray(path.read_bytes())
    how = chance.randrange(3)
    if how == 0 or not data:
        path.write_bytes(b"")
    elif how == 1:
        path.write_bytes(data[: chance.randrange(len(data))])
    else:
        data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
        path.write_bytes(data)


def crowded(bench: Bench, chance: random.Random, out: Path) -> str:
    """Several runs into one folder at once."""
    started = []
    for _ in range(chance.choice([2, 3])):
        started.append(start(bench, out, "--jobs", "1"))
        time.sleep(chance.uniform(0.0, 0.8) * bench.seconds)
    ends = [(one.communicate(timeout=LONGEST)[1], one.returncode) for one in started]
    verdicts = [bench.judge(status, said, out) for said, status in ends]
    return next((one for one in verdicts if one not in ("right", "said so")), max(verdicts))


def starved(bench: Bench, chance: random.Random, out: Path) -> str:
    """A run with too little memory or too small a disk, and another with enough."""
    kind = chance.choice(["RLIMIT_FSIZE", "RLIMIT_AS"])
    size = int(chance.uniform(2e4, 4e5)) if kind == "RLIMIT_FSIZE" else int(chance.uniform(6e8, 4e9))
    words = bench.words(out, "--jobs", chance.choice("12"))
    status, said = bench.run([sys.executable, "-c", LIMITS, kind, str(size), *words[3:]])
    starving = bench.judge(status, said, out)
    if starving not in ("right", "said so") and not (kind == "RLIMIT_AS" and "import" in said.lower()):
        return f"{kind} {size}: {starving}"
    return bench.finish(out)


def lying_header(bench: Bench, chance: random.Random, out: Path) -> str:
    """A header that counts another number of points, or states another box, system or length."""
    data = bytearray(bench.points.read_bytes())
    count = chance.choice([0, 1, 1000, 2**31 - 1, chance.randrange(1, 20_000)])
    struct.pack_into("<I", data, 107, count if data[25] < 4 else 0)
    if data[25] >= 4:
        struct.pack_into("<Q", data, 247, count)
    path = out.with_suffix(".laz")
    path.write_bytes(data)
    status, said = bench.run(bench.words(out, "--jobs", "1", points=path))
    return bench.judge(status, said, out)


def mutated_points(bench: Bench, chance: random.Random, out: Path) -> str:
    """A point file cut or with some changed bytes, with and without --salvage."""
    path = out.with_suffix(".laz")
    data = bytearray(bench.points.read_bytes())
    for _ in range(chance.randrange(1, 6)):
        data[chance.randrange(375, len(data))] ^= 1 << chance.randrange(8)
    path.write_bytes(data[: chance.randrange(300, len(data))] if chance.random() < 0.5 else data)
    more = ["--salvage"] if chance.random() < 0.5 else []
    status, said = bench.run(bench.words(out, "--jobs", "1", *more, points=path))
    return bench.judge(status, said, out, same=False)


def edited_while_read(bench: Bench, chance: random.Random, out: Path) -> str:
    """An input replaced by another file, or cut, while the run goes on."""
    path = out.with_suffix(".laz")
    shutil.copy(bench.points, path)
    process = subprocess.Popen(
        bench.words(out, "--jobs", "1", points=path), stderr=subprocess.PIPE, text=True
    )
    time.sleep(chance.uniform(0.2, 1.0) * bench.seconds)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2] if chance.random() < 0.5 else data[::-1])
    said = process.communicate(timeout=LONGEST)[1]
    return bench.judge(process.returncode, said, out)


def tampered_results(bench: Bench, chance: random.Random, out: Path) -> str:
    """A result changed after the run: `eaves check` must say which."""
    shutil.copytree(bench.place / "whole", out)
    path = chance.choice(sorted(one for one in out.iterdir() if one.name != "manifest.json"))
    before = path.read_bytes()
    damage(path, chance)
    if path.read_bytes() == before:
        return "right"
    status, _ = bench.run([sys.executable, "-m", "eaves", "check", str(out)])
    return "said so" if status == 1 else f"{path.name} changed, status {status}"


def own_input(bench: Bench, chance: random.Random, out: Path) -> str:
    """The output folder is the input's, by one name or another."""
    out.mkdir()
    shutil.copy(bench.points, out / "x.laz")
    link = out.with_name(f"{out.name}-link")
    link.symlink_to(out)
    folder = chance.choice([out, link, out / ".." / out.name])
    words = chance.choice(["build", "ground"])
    goal = folder / "x.laz" if words == "ground" else folder
    status, said = bench.run([sys.executable, "-m", "eaves", words, str(out / "x.laz"), "-o", str(goal)])
    whole = (out / "x.laz").read_bytes() == bench.points.read_bytes()
    return bench.judge(status, said, out) if whole else "the input was overwritten"


def read_only(bench: Bench, chance: random.Random, out: Path) -> str:
    """A folder that may not be written, or a file where the folder should be."""
    if chance.random() < 0.5:
        out.write_text("a file")
    else:
        out.mkdir(mode=0o500)
    status, said = bench.run(bench.words(out, "--jobs", "1"))
    return bench.judge(status, said, out)


CASES: dict[str, Callable[[Bench, random.Random, Path], str]] = {
    case.__name__.replace("_", " "): case
    for case in (
        *(killed, killed_by_tiles, damaged_parts, crowded, starved, lying_header, mutated_points),
        *(edited_while_read, tampered_results, own_input, read_only),
    )
}


def start(bench: Bench, out: Path, *more: str) -> subprocess.Popen[str]:
    """A build that goes on by itself."""
    return subprocess.Popen(bench.words(out, *more), stderr=subprocess.PIPE, text=True)


def prepare(place: Path) -> Bench:
    """The scene and its undisturbed run."""
    points = write_simulation(nine_roofs_on_a_slope(density=4.0, seed=3), place / "nine")["points"]
    bench = Bench(place, points, ("", ""), 0.0)
    started = time.perf_counter()
    status, said = bench.run(bench.words(place / "whole", "--jobs", "1"))
    assert status == 0, said
    return Bench(place, points, digest(place / "whole"), time.perf_counter() - started)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=7200.0)
    parser.add_argument("--log", type=Path, default=Path(tempfile.gettempdir()) / "hostile.jsonl")
    asked = parser.parse_args()
    known = asked.log.read_text(encoding="utf-8").splitlines() if asked.log.exists() else []
    verdicts = [json.loads(line) for line in known]
    with tempfile.TemporaryDirectory() as name, asked.log.open("a", encoding="utf-8") as log:
        bench, end = prepare(Path(name)), time.monotonic() + asked.seconds
        while time.monotonic() < end:
            number = len(verdicts)
            kind = list(CASES)[number % len(CASES)]
            out = bench.place / f"case{number}"
            started = time.perf_counter()
            try:
                verdict = CASES[kind](bench, random.Random(number), out)
            except subprocess.TimeoutExpired:
                verdict = "hung"
            verdicts.append({"case": number, "kind": kind, "verdict": verdict})
            verdicts[-1]["seconds"] = round(time.perf_counter() - started, 1)
            log.write(json.dumps(verdicts[-1]) + "\n")
            log.flush()
            for left in bench.place.glob(f"case{number}*"):
                if left.is_dir() and not left.is_symlink():
                    shutil.rmtree(left, ignore_errors=True)
                else:
                    left.unlink()
    rows: list[dict[str, object]] = []
    for kind in CASES:
        mine = [one for one in verdicts if one["kind"] == kind]
        counts = Counter(one["verdict"] if one["verdict"] in GOOD else "wrong" for one in mine)
        figures = {name: counts[name] for name in (*GOOD, "wrong")}
        rows.append({"disturbance": kind, "cases": len(mine), **figures})
    wrong = [one for one in verdicts if one["verdict"] not in GOOD]
    note = f"{sum(one['seconds'] for one in verdicts) / 60:.0f} minutes. " + NOTE
    note += "".join(f"\n- case {one['case']}, {one['kind']}: {one['verdict']}" for one in wrong)
    keep("hostile", "Hostile surroundings", rows, "python -m benchmarks.scale.hostile", note)


if __name__ == "__main__":
    main()
