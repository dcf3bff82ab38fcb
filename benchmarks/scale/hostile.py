"""Runs are killed, crowded, starved, tampered with and given files that lie, by seed.

The property: no run ends with status 0 unless `eaves validate` passes and its results are the undisturbed
run's; a run that ends with another status says why in words, and can be resumed where resuming is promised.

usage: python -m benchmarks.scale.hostile [--seconds S] [--log FILE.jsonl] [--kind WORD] [--table]

A log goes on where it ended: each case is made of its number alone. Of a commit only the cases of its own
code are new: every line of the log names the commit that it was tried on.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import laspy
from tests.formats.copc_writer import write_copc

from benchmarks.scale import fuzz
from benchmarks.scale.identical import cluster, digest
from benchmarks.scale.mutations import hurt_bytes, put_hurt
from benchmarks.scale.point_mutations import hurt_points
from benchmarks.table import commit_now, keep
from eaves.run.manifest import MANIFEST, check_folder, read_facts
from eaves.simulate import nine_roofs_on_a_slope, write_simulation

LIMITS = (
    "import resource, runpy, sys; kind, size = sys.argv[1], int(sys.argv[2]); sys.argv[1:3] = []; "
    "resource.setrlimit(getattr(resource, kind), (size, size)); "
    "runpy.run_module('eaves', run_name='__main__')"
)
DYING = (
    "import os, runpy, signal, sys\n"
    "left, after, move = int(sys.argv[1]), sys.argv[2] == 'after', os.replace\n"
    "sys.argv[1:3] = []\n"
    "def counted(*paths):\n"
    "    global left\n"
    "    left -= 1\n"
    "    if left == 0 and not after: os.kill(os.getpid(), signal.SIGKILL)\n"
    "    move(*paths)\n"
    "    if left == 0: os.kill(os.getpid(), signal.SIGKILL)\n"
    "os.replace = counted\n"
    "runpy.run_module('eaves', run_name='__main__')\n"
    "sys.stderr.write(str(left))"
)
"""Ends itself with the n-th file that it shows, before or after: every phase ends in one."""
JUMPING = (
    "import random, runpy, sys, time; chance, own = random.Random(int(sys.argv[1])), time.time; "
    "sys.argv[1:2] = []; "
    "time.time = lambda: own() + chance.choice([-1e9, -86400, 0, 3600, 1e8]); "
    "runpy.run_module('eaves', run_name='__main__')"
)
"""A clock that is set again whenever it is looked at."""
MOST_WRITES = 40
"""More than the files that the scene's run shows, in all phases."""
GOOD = ("right", "said so")
NOTE = (
    "Right: status 0, `eaves validate` passes, the results are the undisturbed run's (of mutated inputs: it "
    "passes). Said so: another status, with its reason in a line; a run that was ended was resumed and then "
    "right. Wrong: anything else."
)
INPUTS_AT_ONCE = 5
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
        return [sys.executable, "-m", "eaves", "build", given, "-q", "-o", str(out), *more]

    def run(self, words: list[str]) -> tuple[int, str]:
        """Status and what was said."""
        done = subprocess.run(words, capture_output=True, text=True, timeout=LONGEST)
        return done.returncode, done.stderr

    def undisturbed(self) -> Self:
        """The bench with what an undisturbed run gives, which stays in `whole`, and its time."""
        whole = self.place / "whole"
        for _ in range(2):  # the first compiles what is not compiled yet
            shutil.rmtree(whole, ignore_errors=True)
            started = time.perf_counter()
            status, said = self.run(self.words(whole, "--jobs", "1"))
            assert status == 0, said
        return replace(self, right=digest(whole), seconds=time.perf_counter() - started)

    def judge(self, status: int, said: str, out: Path, same: bool = True) -> str:
        """`right`, `said so` or what is wrong."""
        if "Traceback" in said or status not in (0, 1, 2, 130, 143):
            return f"status {status}: {said.strip()[-200:]}"
        if status != 0:
            return "said so" if said.strip() else f"status {status} without a word"
        if wrong := check_folder(out):
            return f"status 0, and {wrong[0]}"
        return "right" if not same or digest(out) == self.right else "status 0, other results"

    def finish(self, out: Path, by_tiles: bool = False) -> str:
        """Resume a run to its end; one by tiles writes no points."""
        more = ["--per-tile"] if by_tiles else []
        status, said = self.run(self.words(out, "--resume", "--jobs", "1", *more))
        verdict = self.judge(status, said, out, same=not by_tiles)
        if verdict == "said so":
            return f"cannot be resumed: {said.strip()[-200:]}"
        same = verdict != "right" or digest(out)[0] == self.right[0]
        return verdict if same else "status 0, other results"


def killed(bench: Bench, chance: random.Random, out: Path) -> str:
    """A run ended by a signal at a random moment, and resumed."""
    process = start(bench, out, "--jobs", chance.choice("12"))
    time.sleep(chance.uniform(0.3, 1.2) * bench.seconds)
    process.send_signal(chance.choice([signal.SIGKILL, signal.SIGTERM, signal.SIGINT]))
    process.communicate(timeout=LONGEST)
    if out.exists() and not read_facts(out) and chance.random() < 0.5:
        shift_clocks(out, chance)
    return bench.finish(out)


def killed_at_a_write(bench: Bench, chance: random.Random, out: Path) -> str:
    """A run that dies as it shows a file, in whatever phase that is, the merge of tiles included; resumed,
    perhaps to die again."""
    more = ["--per-tile"] if chance.random() < 0.5 else []
    for _ in range(chance.choice((1, 1, 2, 3))):
        words = [str(chance.randrange(1, MOST_WRITES)), chance.choice(("before", "after"))]
        given = bench.words(out, "--resume", "--jobs", "1", *more)[3:]
        status, said = bench.run([sys.executable, "-c", DYING, *words, *given])
        if status not in (0, -signal.SIGKILL):
            return f"status {status}: {said.strip()[-200:]}"
    return bench.finish(out, bool(more))


def clock_jumps(bench: Bench, chance: random.Random, out: Path) -> str:
    """A clock that goes back and forth during a run, perhaps one that is killed and resumed."""
    seed = str(chance.randrange(2**32))
    words = [sys.executable, "-c", JUMPING, seed, *bench.words(out, "--jobs", "1")[3:]]
    if chance.random() < 0.5:
        return bench.judge(*bench.run(words), out)
    process = subprocess.Popen(words, stderr=subprocess.PIPE, text=True)
    time.sleep(chance.uniform(0.5, 1.1) * bench.seconds)
    process.kill()
    process.communicate(timeout=LONGEST)
    return bench.finish(out)


def shift_clocks(out: Path, chance: random.Random) -> None:
    """Make what is there a day older or younger."""
    for path in [one for one in out.rglob("*") if one.is_file()]:
        moment = path.stat().st_mtime + chance.choice([-86400, 86400])
        os.utime(path, (moment, moment))


def damaged_parts(bench: Bench, chance: random.Random, out: Path) -> str:
    """A run that was killed, one of its parts damaged, and resumed."""
    process = start(bench, out, "--jobs", "1")
    time.sleep(chance.uniform(0.6, 1.1) * bench.seconds)
    process.kill()
    process.communicate(timeout=LONGEST)
    parts = sorted(one for one in out.glob(".eaves-work/**/*") if one.is_file())
    if parts:
        part = chance.choice(parts)
        part.write_bytes(hurt_bytes(part.read_bytes(), chance))
    return bench.finish(out)


def crowded(bench: Bench, chance: random.Random, out: Path) -> str:
    """Several runs into one folder at once."""
    started = []
    for _ in range(chance.choice([2, 3])):
        started.append(start(bench, out, "--jobs", "1"))
        time.sleep(chance.uniform(0.0, 0.8) * bench.seconds)
    ends = [(one.communicate(timeout=LONGEST)[1], one.returncode) for one in started]
    verdicts = [bench.judge(status, said, out) for said, status in ends]
    wrong = [one for one in verdicts if one not in GOOD]
    return wrong[0] if wrong else "right" if "right" in verdicts else "none of them came through"


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


def edited_by_stealth(bench: Bench, chance: random.Random, out: Path) -> str:
    """A run that was killed, its input edited to the same length with the same time, and resumed: the results
    are the edited file's, or it says so."""
    path = out.with_suffix(".laz")
    shutil.copy(bench.points, path)
    before = path.stat()
    process = subprocess.Popen(
        bench.words(out, "--jobs", "1", points=path), stderr=subprocess.PIPE, text=True
    )
    time.sleep(chance.uniform(0.4, 1.1) * bench.seconds)
    ended = chance.random() < 0.7
    if ended:
        process.kill()
        process.communicate(timeout=LONGEST)
    las = laspy.read(bench.points)
    las.z = las.z[chance.choice((slice(None, None, -1), [len(las.z) // 2] * len(las.z)))]  # other heights
    edited = path.with_name(f"{out.name}-edited.laz")
    las.write(edited)
    data = edited.read_bytes()
    if chance.random() < 0.5:  # a byte in the middle, and nothing else
        data = bytearray(bench.points.read_bytes())
        data[chance.randrange(len(data) // 4, len(data) * 3 // 4)] ^= 1 << chance.randrange(8)
    with path.open("rb+") as file:
        file.write(data[: before.st_size].ljust(before.st_size, b"\0"))
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    if not ended:
        said = process.communicate(timeout=LONGEST)[1]
        return bench.judge(process.returncode, said, out)  # it read the whole file before, or says so
    status, said = bench.run(bench.words(out, "--resume", "--jobs", "1", points=path))
    verdict = bench.judge(status, said, out, same=False)
    if verdict != "right":
        return verdict
    anew = out.with_name(f"{out.name}-anew")
    status, said = bench.run(bench.words(anew, "--jobs", "1", points=path))
    return "right" if status == 0 and digest(anew) == digest(out) else "status 0, results of the file before"


def copc(bench: Bench, chance: random.Random, out: Path) -> str:
    """The points as COPC, whole: the same models; or with fields of its header and its pages that lie."""
    path = out.with_name(f"{out.name}.copc.laz")
    write_copc(path, laspy.convert(laspy.read(bench.points), point_format_id=6, file_version="1.4"), levels=2)
    whole = chance.random() < 0.25
    if not whole:
        path.write_bytes(hurt_points(path.read_bytes(), chance))
    status, said = bench.run(bench.words(out, "--jobs", "1", points=path))
    return bench.judge(status, said, out, same=whole)


def worker_lost(bench: Bench, chance: random.Random, out: Path) -> str:
    """A run on a Dask cluster of which one worker, or all, or the scheduler, is killed."""
    with cluster() as (address, scheduler, *workers):
        process = start(bench, out, "--scheduler", address)
        time.sleep(chance.uniform(0.2, 1.5) * bench.seconds)
        lost = chance.choice((workers[:1], workers[:1], workers, [scheduler]))
        for one in lost:
            one.kill()
        try:
            said = process.communicate(timeout=LONGEST / 3)[1]
        except subprocess.TimeoutExpired:
            if lost == workers[:1]:
                process.kill()
                process.communicate()
                return "hung"
            process.send_signal(signal.SIGINT)  # nobody is left to compute: it waits for others to come
            said = process.communicate(timeout=LONGEST)[1]
    verdict = bench.judge(process.returncode, said, out)
    return verdict if verdict not in GOOD else bench.finish(out)


def mutated_inputs(bench: Bench, chance: random.Random, out: Path) -> str:
    """One mutated input of every kind that the commands read (`benchmarks.scale.fuzz`)."""
    place = bench.place / "fuzz"
    if not place.exists():
        place.mkdir()
        fuzz.write_whole(place)
    kinds = fuzz.make_kinds(place)
    others, wrong = [kind.whole for kind in kinds], []
    for kind in chance.sample(kinds, INPUTS_AT_ONCE):
        folder = out / kind.name
        folder.mkdir(parents=True)
        path, target = folder / kind.whole.name, folder / "out"
        put_hurt(path, kind.whole.read_bytes(), kind.mutate, others, chance)
        status, said = bench.run([sys.executable, "-m", "eaves", *kind.words(path, target)])
        fault = fuzz.wrong_with(status, said, target)
        if "Traceback" in said:
            fault = f"status {status}: {said.strip()[-200:]}"
        if not fault and status == 0 and (target / MANIFEST).exists():
            fault = next(iter(check_folder(target)), "")
        if fault:
            wrong.append(f"{kind.name}: {fault}")
    return "; ".join(wrong) or "said so"


def tampered_results(bench: Bench, chance: random.Random, out: Path) -> str:
    """A result changed after the run: `eaves validate` must say which."""
    shutil.copytree(bench.place / "whole", out)
    path = chance.choice(sorted(one for one in out.iterdir() if one.name != MANIFEST))
    before = path.read_bytes()
    path.write_bytes(hurt_bytes(before, chance))
    if path.read_bytes() == before:
        return "right"
    status, _ = bench.run([sys.executable, "-m", "eaves", "validate", str(out)])
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


Case = Callable[[Bench, random.Random, Path], str]

CASES: dict[str, Case] = {
    case.__name__.replace("_", " "): case
    for case in (
        *(killed, killed_at_a_write, damaged_parts, crowded, starved, clock_jumps, worker_lost),
        *(edited_while_read, edited_by_stealth, tampered_results, own_input, read_only, copc, mutated_inputs),
    )
}


def start(bench: Bench, out: Path, *more: str) -> subprocess.Popen[str]:
    """A build that goes on by itself."""
    return subprocess.Popen(bench.words(out, *more), stderr=subprocess.PIPE, text=True)


def prepare(place: Path) -> Bench:
    """The scene and its undisturbed run."""
    points = write_simulation(nine_roofs_on_a_slope(density=4.0, seed=3), place / "nine")["points"]
    return Bench(place, points, ("", ""), 0.0).undisturbed()


def try_case(bench: Bench, number: int, kind: str, case: Case) -> dict[str, Any]:
    """One case of a kind, with its verdict, its seconds and the commit it was tried on."""
    out, started = bench.place / f"case{number}", time.perf_counter()
    try:
        verdict = case(bench, random.Random(number), out)
    except subprocess.TimeoutExpired:
        verdict = "hung"
    for left in bench.place.glob(f"case{number}*"):
        if left.is_dir() and not left.is_symlink():
            shutil.rmtree(left, ignore_errors=True)
        else:
            left.unlink()
    seconds = round(time.perf_counter() - started, 1)
    return {"case": number, "kind": kind, "verdict": verdict, "seconds": seconds, "commit": commit_now()}


def keep_table(tried: list[dict[str, Any]]) -> None:
    """Write the table: of cases tried again the last verdict counts, what was found before is named."""
    last = {(one["case"], one["kind"]): one for one in tried}
    rows: list[dict[str, object]] = []
    for kind in CASES:
        mine = [one["verdict"] for one in last.values() if one["kind"] == kind]
        counts = Counter(verdict if verdict in GOOD else "wrong" for verdict in mine)
        rows.append(
            {"disturbance": kind, "cases": len(mine), **{name: counts[name] for name in (*GOOD, "wrong")}}
        )
    note = f"{sum(one['seconds'] for one in tried) / 60:.0f} minutes, {len(last)} cases. {NOTE}\n"
    for one in tried:
        if one["verdict"] not in GOOD:
            end = last[one["case"], one["kind"]]
            told = "" if end is one else f"; since then {end['verdict']} ({end['commit']})"
            note += f"\n- case {one['case']}, {one['kind']} ({one['commit']}): {one['verdict']}{told}"
    keep("hostile", "Hostile surroundings", rows, "python -m benchmarks.scale.hostile", note)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=7200.0)
    parser.add_argument("--log", type=Path, default=Path(tempfile.gettempdir()) / "hostile.jsonl")
    parser.add_argument("--kind", default="", help="Only disturbances with this in their name.")
    parser.add_argument("--first", type=int, default=0, help="Number of the first new case, at least.")
    parser.add_argument("--again", action="store_true", help="Try the cases again that went wrong.")
    asked = parser.parse_args()
    known = asked.log.read_text(encoding="utf-8").splitlines() if asked.log.exists() else []
    tried = [json.loads(line) for line in known]
    with tempfile.TemporaryDirectory() as name, asked.log.open("a", encoding="utf-8") as log:
        bench, end = prepare(Path(name)), time.monotonic() + asked.seconds
        last = {(one["case"], one["kind"]): one for one in tried}
        wrong = [one for one in last.values() if one["verdict"] not in GOOD]
        first = max(asked.first, *(number + 1 for number, _ in last), 0)
        # A run that goes on has as many cases of every kind as one in one piece: the rarest comes next.
        counts = Counter({kind: 0 for kind in CASES if asked.kind in kind})
        counts.update(one["kind"] for one in last.values() if one["kind"] in counts)
        again = iter([(one["case"], one["kind"]) for one in wrong] if asked.again else ())
        while time.monotonic() < end:
            number, kind = (
                next(again, (first, "")) if asked.again else (first, min(counts, key=counts.__getitem__))
            )
            if not kind:
                break
            tried.append(try_case(bench, number, kind, CASES[kind]))
            counts[kind] += 1
            first = max(first, number + 1)
            log.write(json.dumps(tried[-1]) + "\n")
            log.flush()
    keep_table(tried)


if __name__ == "__main__":
    main()
