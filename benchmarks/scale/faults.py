"""Faults at points of a run: what kills, fills, starves or changes it, and what `--resume` makes of that.

The property: whatever happens, the run or the one that resumes it ends with the bytes of an undisturbed run,
or with one line. Compared is every file but run.json and report.html, which state times, of a GeoPackage all
tables but for the time at which its layers were written. The scene lies in four blocks.

usage: python -m benchmarks.scale.faults [--cases N] [--log FILE.jsonl] [--kind WORD]
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import re
import shutil
import signal
import sqlite3
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import laspy
import numpy as np

from benchmarks.scale import hostile
from benchmarks.scale.hostile import GOOD, LONGEST, Bench, Case, start, try_case
from benchmarks.scale.mutations import hurt_bytes
from benchmarks.table import keep
from eaves.run.manifest import MANIFEST
from eaves.simulate import nine_roofs_on_a_slope, write_simulation

BLOCK = 240.0
PORT = 18787
TIMES, TIME = (MANIFEST, "report.html"), r"\d{4}-\d\d-\d\dT[\d:.]+Z"
ROOM, LITTLE = "200m", (0.2, 6.0)
"""Of the disk that is made for a run: enough for one, and the range (MB) of what is too little, or nearly."""


def contents(out: Path) -> dict[str, str]:
    """The hash of every file of a run but those that state times."""
    found = {}
    for path in sorted(one for one in out.rglob("*") if one.is_file() and one.name not in TIMES):
        data = path.read_bytes()
        if path.suffix == ".gpkg":
            with closing(sqlite3.connect(path)) as layer:
                data = re.sub(TIME, "", "\n".join(layer.iterdump())).encode()
        found[path.relative_to(out).as_posix()] = hashlib.sha256(data).hexdigest()
    return found


class ExactBench(Bench):
    """A bench that compares bytes."""

    def judge(self, status: int, said: str, out: Path, same: bool = True) -> str:
        verdict = super().judge(status, said, out, same)
        if status and len([line for line in said.splitlines() if line.startswith("error:")]) > 1:
            return f"status {status} in several lines: {said.strip()[-200:]}"
        if verdict != "right" or not same:
            return verdict
        ours, right = contents(out), contents(self.place / "whole")
        differing = sorted(name for name in ours | right if ours.get(name) != right.get(name))
        return f"status 0, other bytes in {', '.join(differing)}" if differing else verdict


def wait(bench: Bench, chance: random.Random) -> None:
    """Let a run go on to some point of it."""
    time.sleep(chance.uniform(0.3, 1.1) * bench.seconds)


def ended(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Status and what was said of a run that goes on to its end."""
    said = process.communicate(timeout=LONGEST)[1]
    return process.returncode, said


def ended_and_resumed(bench: Bench, process: subprocess.Popen[str], out: Path) -> str:
    """The verdict of a run that a fault met, and of the next, without the fault."""
    status, said = ended(process)
    verdict = bench.judge(status, said, out)
    return verdict if verdict not in GOOD else bench.finish(out)


def process_killed(bench: Bench, chance: random.Random, out: Path) -> str:
    """One of the two processes that compute is killed: the run itself goes on."""
    process = start(bench, out, "--jobs", "2")
    wait(bench, chance)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    with suppress(OSError):
        for child in children.read_text().split():
            if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                os.kill(int(child), signal.SIGKILL)
    status, said = ended(process)
    verdict = bench.judge(status, said, out)
    return verdict if verdict == "right" else f"did not go on: {verdict}"


def asleep(bench: Bench, chance: random.Random, out: Path) -> str:
    """All processes stop for a while and go on, as when a laptop sleeps."""
    words = bench.words(out, "--jobs", "2")
    process = subprocess.Popen(words, stderr=subprocess.PIPE, text=True, start_new_session=True)
    for _ in range(3):
        time.sleep(chance.uniform(0.1, 0.4) * bench.seconds)
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGSTOP)
            time.sleep(chance.uniform(0.1, 1.0))
            os.killpg(process.pid, signal.SIGCONT)
    return bench.judge(*ended(process), out)


def input_lost(bench: Bench, chance: random.Random, out: Path) -> str:
    """The input vanishes, shrinks, or another one takes its place; then it is back."""
    points = out.with_name(f"{out.name}-in") / bench.points.name
    points.parent.mkdir()
    shutil.copy(bench.points, points)
    data, before = points.read_bytes(), points.stat()
    process = subprocess.Popen(
        bench.words(out, "--jobs", "1", points=points), stderr=subprocess.PIPE, text=True
    )
    wait(bench, chance)
    kind = chance.choice(("vanishes", "shrinks", "replaced", "hurt in place"))
    if kind == "vanishes":
        points.unlink()
    elif kind == "shrinks":
        os.truncate(points, len(data) // 2)
    elif kind == "replaced":
        other = points.with_name("other")
        shutil.copy(bench.place / "other.laz", other)
        os.replace(other, points)
    else:
        points.write_bytes(hurt_bytes(data, chance)[: len(data)].ljust(len(data), b"\0"))
        os.utime(points, ns=(before.st_atime_ns, before.st_mtime_ns))
    verdict = bench.judge(*ended(process), out)
    if verdict not in GOOD:
        return f"{kind}: {verdict}"
    points.write_bytes(data)
    status, said = bench.run(bench.words(out, "--resume", "--jobs", "1", points=points))
    verdict = bench.judge(status, said, out)
    return verdict if verdict == "right" else f"{kind}, back again: {verdict} {said[-200:]}"


@contextmanager
def disk(place: Path, size: str) -> Iterator[Path]:
    """A disk of its own, which root alone can make."""
    place.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(place)], check=True)
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


def remount(place: Path, words: str) -> bool:
    """Change a disk; false where files that are being written forbid it."""
    return (
        subprocess.run(["mount", "-o", f"remount,{words}", str(place)], capture_output=True).returncode == 0
    )


def disk_full(bench: Bench, chance: random.Random, out: Path) -> str:
    """The disk has too little room, or just enough; then it has more."""
    size = f"{int(chance.uniform(*LITTLE) * 1000)}k"
    with disk(out.with_name(f"{out.name}-disk"), size) as place:
        process = start(bench, place / "out", "--jobs", chance.choice("12"))
        verdict = bench.judge(*ended(process), place / "out")
        if verdict not in GOOD:
            return f"{size}: {verdict}"
        remount(place, f"size={ROOM}")
        verdict = bench.finish(place / "out")
        return verdict if verdict == "right" else f"{size}: {verdict}"


def turned_read_only(bench: Bench, chance: random.Random, out: Path) -> str:
    """The folder can no longer be written in the middle of a run; then it can."""
    with disk(out.with_name(f"{out.name}-disk"), ROOM) as place:
        process = start(bench, place / "out", "--jobs", "1")
        wait(bench, chance)
        until = time.monotonic() + bench.seconds
        while not remount(place, "ro") and time.monotonic() < until and process.poll() is None:
            time.sleep(0.01)  # a file is just being written
        verdict = bench.judge(*ended(process), place / "out")
        remount(place, "rw")
        return verdict if verdict not in GOOD else bench.finish(place / "out")


class Stalling(BaseHTTPRequestHandler):
    """A server of one file by ranges that answers some requests late, in part, or with an error."""

    def __init__(self, *given: Any, points: Path, chance: random.Random | None) -> None:
        self.points, self.chance = points, chance
        super().__init__(*given)

    def do_GET(self) -> None:
        """Answer a range."""
        data = self.points.read_bytes()
        first, last = (int(n) for n in self.headers["Range"].removeprefix("bytes=").split("-"))
        piece, fate = data[first : last + 1], 1.0 if self.chance is None else self.chance.random()
        if fate < 0.15:
            self.send_error(503)
            return
        self.send_response(206)
        self.send_header("Content-Range", f"bytes {first}-{first + len(piece) - 1}/{len(data)}")
        self.send_header("Content-Length", str(len(piece)))
        self.end_headers()
        with suppress(ConnectionError):
            if fate < 0.3:
                self.wfile.write(piece[: len(piece) // 2])
                return
            self.wfile.write(piece[: len(piece) // 3])
            time.sleep(1.5 * (1.0 - fate))
            self.wfile.write(piece[len(piece) // 3 :])

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""


@contextmanager
def served(bench: Bench, chance: random.Random | None) -> Iterator[list[str]]:
    """The words of a build of the points by http, as far as the output folder."""
    handler = partial(Stalling, points=bench.points, chance=chance)
    with ThreadingHTTPServer(("127.0.0.1", PORT), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        words = bench.words(Path("OUT"), "--jobs", "1")[:-4]
        words[words.index(str(bench.points))] = f"http://127.0.0.1:{PORT}/{bench.points.name}"
        yield words
        server.shutdown()


def network_stalls(bench: Bench, chance: random.Random, out: Path) -> str:
    """Points by http from a server that stalls, breaks off and fails; then one that does not."""
    right = bench.place / "whole-http"
    with served(bench, None) as words:
        if not right.exists():
            bench.run([*words, "-o", str(right), "--jobs", "1"])
    with served(bench, chance) as words:
        status, said = bench.run([*words, "-o", str(out), "--jobs", "1"])
    verdict = bench.judge(status, said, out, same=False)
    if verdict not in GOOD:
        return verdict
    with served(bench, None) as words:
        status, said = bench.run([*words, "-o", str(out), "--jobs", "1", "--resume"])
    verdict = bench.judge(status, said, out, same=False)
    return verdict if contents(out) == contents(right) else f"other bytes: {verdict}"


CASES: dict[str, Case] = {
    case.__name__.replace("_", " "): case
    for case in (
        *(hostile.killed, hostile.killed_at_a_write, process_killed, hostile.worker_lost, disk_full),
        *(input_lost, turned_read_only, hostile.clock_jumps, hostile.crowded, asleep, network_stalls),
    )
}


def prepare(place: Path) -> ExactBench:
    """The scene about a corner of four blocks, another one, and its undisturbed run."""
    points = write_simulation(nine_roofs_on_a_slope(density=4.0, seed=3), place / "nine")["points"]
    las = laspy.read(points)
    for axis in "xy":
        values = np.asarray(las[axis])
        las[axis] = values - np.round(values.mean()) + BLOCK * 400
    las.write(points)
    las.z = np.asarray(las.z)[::-1]
    las.write(place / "other.laz")
    return ExactBench(place, points, ("", ""), 0.0).undisturbed()


def keep_table(tried: list[dict[str, Any]]) -> None:
    """Write the table."""
    rows: list[dict[str, object]] = []
    for kind in CASES:
        verdicts = [one["verdict"] for one in tried if one["kind"] == kind]
        good = sum(verdict in GOOD for verdict in verdicts)
        rows.append(
            {"fault": kind, "points": len(verdicts), "as promised": good, "wrong": len(verdicts) - good}
        )
    good = sum(one["verdict"] in GOOD for one in tried)
    rows.append({"fault": "together", "points": len(tried), "as promised": good, "wrong": len(tried) - good})
    note = (
        f"{sum(one['seconds'] for one in tried) / 60:.0f} minutes. As promised: after the fault, or after "
        "the run that resumes it, every file but run.json and report.html has the bytes of the undisturbed "
        "run, and `eaves validate` finds nothing; a run that does not end so says why in one line.\n"
    )
    wrong = [one for one in tried if one["verdict"] not in GOOD]
    note += "".join(f"\n- case {one['case']}, {one['kind']}: {one['verdict']}" for one in wrong)
    keep(
        "faults",
        "Faults at points of a run",
        rows,
        f"python -m benchmarks.scale.faults --cases {len(tried)}",
        note,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--log", type=Path, default=Path(tempfile.gettempdir()) / "faults.jsonl")
    parser.add_argument("--kind", default="", help="Only faults with this in their name.")
    asked = parser.parse_args()
    known = asked.log.read_text(encoding="utf-8").splitlines() if asked.log.exists() else []
    tried = [json.loads(line) for line in known]
    kinds = [kind for kind in CASES if asked.kind in kind]
    with tempfile.TemporaryDirectory() as name, asked.log.open("a", encoding="utf-8") as log:
        bench = prepare(Path(name))
        for number in range(len(tried), asked.cases):
            kind = kinds[number % len(kinds)]
            tried.append(try_case(bench, number, kind, CASES[kind]))
            log.write(json.dumps(tried[-1]) + "\n")
            log.flush()
    keep_table(tried)


if __name__ == "__main__":
    main()
