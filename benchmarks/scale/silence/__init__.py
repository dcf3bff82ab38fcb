"""Situations that users report in public, drawn with what is true: right, refused, said, or wrong in silence.

Every variant is an input made of its seed, the words of a command, a judge that knows the truth, and what a
message must name to count: the cause, and the number or name that belongs to it.

right: status 0 and the judge finds nothing.
refused: status 2, one line that names the cause, and no results.
said: the results are not the truth, and summary, run.json and standard error all name the cause.
wrong in silence: anything else.

A message that an undisturbed run prints, too, counts as silence: the causes are looked for in what the plain
scene says, and one that is found there is an error of this benchmark.

usage: python -m benchmarks.scale.silence [--kind WORD] [--keep FOLDER] [--jobs N]
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import numpy as np

from benchmarks.scale.silence.houses import draw_houses, in_world, write_points
from benchmarks.table import keep

KINDS = ("unseen", "systems", "maps", "rasters", "points", "orders")
"""The modules of this package that draw variants, as the issue numbers them from 1 to 6."""
VERDICTS = ("right", "refused", "said", "wrong in silence")
LONGEST = 240.0
"""Seconds after which a run counts as hung."""


@dataclass(frozen=True)
class Drawn:
    """A variant as it lies in a folder: the words after `eaves` (OUT stands for the folder of the run), the
    judge of that folder, and the pattern of what names cause and number."""

    words: list[str]
    judge: Callable[[Path], str]
    cause: str


@dataclass(frozen=True)
class Variant:
    """A situation: its kind, its name, and what draws it into a folder, by a seed that follows from both."""

    kind: str
    name: str
    draw: Callable[[Path, np.random.Generator], Drawn]

    @property
    def seed(self) -> int:
        """The seed."""
        return zlib.crc32(f"{self.kind}/{self.name}".encode())


def all_variants(kind: str | None = None) -> Iterator[Variant]:
    """The variants of a kind, or of all kinds."""
    for name in KINDS if kind is None else (kind,):
        yield from import_module(f"{__name__}.{name}").variants()


def run(words: list[str], out: Path) -> tuple[int, str, str]:
    """Status, standard error and summary of a command."""
    command = [sys.executable, "-m", "eaves", *(str(out) if word == "OUT" else word for word in words)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST)
    except subprocess.TimeoutExpired:
        return -1, f"not ended after {LONGEST:.0f} s", ""
    return done.returncode, done.stderr, done.stdout


def verdict_of(drawn: Drawn, out: Path, plain: str) -> tuple[str, str]:
    """The verdict on a run into `out`, and what is wrong with it. `plain` is what a plain run says."""
    status, error, summary = run(drawn.words, out)
    if re.search(drawn.cause, plain):
        raise AssertionError(f"{drawn.cause!r} stands in what every run says")
    named = re.compile(drawn.cause, re.DOTALL)
    if "Traceback" in error or status not in (0, 1, 2):
        return VERDICTS[3], f"status {status}: {error.strip()[-200:]}"
    if status == 2:
        lines = [line for line in error.splitlines() if line.startswith("error:")]
        clear = len(lines) == 1 and named.search(lines[0]) and not (out / "footprints.gpkg").exists()
        return (VERDICTS[1], lines[0]) if clear else (VERDICTS[3], f"status 2: {error.strip()[-200:]}")
    try:
        wrong = drawn.judge(out)
    except Exception as failure:  # what cannot be judged is not right
        wrong = f"cannot be judged: {failure!r}"[:200]
    if status == 0 and not wrong:
        return VERDICTS[0], ""
    facts = out / "run.json"
    told = json.loads(facts.read_text(encoding="utf-8")) if facts.exists() else {}
    if all(named.search(text) for text in (error, json.dumps(told, ensure_ascii=False), summary)):
        return VERDICTS[2], wrong
    return VERDICTS[3], wrong or f"status {status}: {error.strip()[-200:]}"


def plain_words(folder: Path) -> str:
    """All that an undisturbed run says: on both streams and in run.json."""
    points = write_points(folder / "plain.laz", in_world(draw_houses(np.random.default_rng(0)).xyz))
    _, error, summary = run(["build", str(points), "-o", "OUT"], folder / "plain")
    return error + summary + (folder / "plain" / "run.json").read_text(encoding="utf-8")


def main() -> None:
    """Run the variants and keep the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--kind", choices=KINDS)
    parser.add_argument("--name", help="only the variants whose name contains this; no table is kept")
    parser.add_argument("--keep", type=Path, help="a folder for the inputs and results")
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    place = asked.keep or Path(tempfile.mkdtemp())
    place.mkdir(parents=True, exist_ok=True)
    plain = plain_words(place)

    def judged(variant: Variant) -> tuple[Variant, str, str]:
        folder = place / variant.kind / re.sub(r"\W+", "_", variant.name)
        folder.mkdir(parents=True)
        drawn = variant.draw(folder, np.random.default_rng(variant.seed))
        verdict, wrong = verdict_of(drawn, folder / "out", plain)
        print(f"{variant.kind:8} {variant.name:48} {verdict:16} {wrong}", flush=True)
        return variant, verdict, wrong

    chosen = [one for one in all_variants(asked.kind) if (asked.name or "") in one.name]
    with ThreadPoolExecutor(asked.jobs) as pool:
        results = list(pool.map(judged, chosen))
    rows = []
    for kind in (*dict.fromkeys(variant.kind for variant in chosen), "together"):
        counts = Counter(said for variant, said, _ in results if kind in (variant.kind, "together"))
        rows.append(
            {"kind": kind, "variants": sum(counts.values())} | {said: counts[said] for said in VERDICTS}
        )
    silent = [f"- {one.kind}: {one.name}: {wrong}" for one, said, wrong in results if said == VERDICTS[3]]
    note = "Wrong in silence:\n" + "\n".join(silent) if silent else ""
    if asked.kind is None and asked.name is None:
        keep("silence", "Wrong in silence", rows, "python -m benchmarks.scale.silence", note)
    else:
        print(rows, note, sep="\n")


if __name__ == "__main__":
    main()
