"""Point files of others, and mutations of each: what laspy reads, a build reads to the same points.

usage: python -m benchmarks.scale.zoo FOLDER [--mutations 10] [--seed 1]

FOLDER holds LAS, LAZ and COPC samples, a folder for each project that they come from. Each file is opened
as a build opens it, in a process of its own whose memory and time are bounded; its points are compared with
those of laspy one by one. What is refused must be refused in one line with the file, the rule and the remedy.
A system that a build refuses (degrees, conflicts) leaves the points to be compared with one that is given.
"""

from __future__ import annotations

import argparse
import logging
import multiprocessing
import random
import resource
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path

import laspy
import numpy as np

from benchmarks.scale.mutations import hurt_bytes
from benchmarks.scale.point_mutations import hurt_points
from benchmarks.table import keep
from eaves.formats import InputError, Source, iter_chunks, open_source
from eaves.formats.inputs import LAS_SUFFIXES
from eaves.formats.points.las_header import LasHeader
from eaves.formats.points.source import has_coordinates
from eaves.run.index import index_inputs

SECONDS = 30
"""A file that takes longer hangs."""
ROOM_BYTES = 3 << 30
LARGEST_TRUTH = 50_000_000
"""More points than any sample has, and laspy would fill memory with what a wrong header states."""
PLANE = "EPSG:3857"
"""The system given in place of one that no build takes, so that the points can be compared all the same."""
SAME, SYSTEM = "same points", "its system refused"
REFUSED_TOO, MORE = "refused, as by laspy", "laspy refuses"
NOTHING, UNCOUNTED = "refused, laspy reads no place", "more than is counted"
GOOD = (SAME, SYSTEM, REFUSED_TOO, MORE, NOTHING, UNCOUNTED)
NOTE = (
    "Same points: coordinates, returns and classes are those of laspy. Its system refused: in one line; "
    "with a system that is given the points are the same. Laspy refuses: opened, and all points read. "
    "Refused, laspy reads no place: in one line, where laspy reads 0 points, or points whose scales are "
    "zero or no numbers. More than is counted: the file holds more points than its header counts, which "
    "is said; the first are those of laspy."
)
SMALLEST = 1e-300
"""A scale under this is no number that a writer chose."""
UNITS = 1e-9
"""Relative difference that multiplication by a unit and division leave."""


def truth(path: Path) -> laspy.LasData | None:
    """The points of laspy; None where it fails."""
    try:
        with path.open("rb") as file:
            records = int.from_bytes(file.read(104)[100:], "little")
        if records > LARGEST_TRUTH:  # laspy would read each of them, for minutes
            return None
        with laspy.open(path) as reader:
            return None if reader.header.point_count > LARGEST_TRUTH else reader.read()
    except BaseException:  # of damaged files it raises whatever its parts raise, panics too
        return None


def compare(source: Source, known: laspy.LasData) -> str:
    """`SAME`, or how the points differ from laspy's, in the units of the file."""
    stated = source.layout.stated if isinstance(source.layout, LasHeader) else None
    uncounted = stated == len(known.points) < source.count
    if source.count != len(known.points) and not uncounted:
        return f"{source.count} points, laspy has {len(known.points)}"
    xyz = np.column_stack([known.x, known.y, known.z])
    units, seen = np.array(source.system.unit_m), np.zeros(len(xyz), bool)
    for whole in iter_chunks(source):
        chunk = whole.take(whole.position < len(xyz))
        place, seen[chunk.position] = chunk.position, True
        if not np.allclose(chunk.xyz / units, xyz[place], rtol=UNITS, atol=1e-9):
            return "other coordinates"
        for name in ("return_number", "number_of_returns", "classification"):
            if not np.array_equal(getattr(chunk, name), np.asarray(known[name])[place]):
                return f"other {name}"
    with np.errstate(invalid="ignore", over="ignore"):
        expected = has_coordinates(xyz) & (np.asarray(known["withheld"]) == 0)
    differing = seen != expected
    if differing.any():
        return f"{int(differing.sum())} points left out or too many"
    return UNCOUNTED if uncounted else SAME


def verdict(path: Path, compared_to_laspy: bool) -> tuple[str, str]:
    """What becomes of a file in a build, and the line that it is refused with."""
    known, refusal = truth(path) if compared_to_laspy else None, ""
    try:
        try:
            index = index_inputs([path], None, [])
            source = index.source(0)
        except InputError as error:
            refusal = one_line(path, str(error))
            source = open_source(path, PLANE)
        compared = SAME if known is None else compare(source, known)
        if known is None:
            for _ in iter_chunks(source):
                pass
    except InputError as error:
        line = one_line(path, str(error))
        if known is None:
            return REFUSED_TOO, line
        word = f"refused, laspy reads {len(known.points)} points"
        return word if says_a_place(known) else NOTHING, line
    if compared != SAME:
        return compared, refusal
    return (SYSTEM if refusal else MORE if known is None else SAME), refusal


def says_a_place(known: laspy.LasData) -> bool:
    """Whether there are points, and their coordinates are numbers on a grid."""
    scales = np.asarray(known.header.scales)
    return len(known.points) > 0 and bool((np.isfinite(scales) & (np.abs(scales) > SMALLEST)).all())


def one_line(path: Path, text: str) -> str:
    """A refusal, when it is one line with the file, the rule and the remedy.

    Raises
    ------
    AssertionError
        When it is not.
    """
    assert "\n" not in text and str(path) in text and ";" in text, text
    return text.removeprefix(f"{path}: ")


def _answer(path: Path, compared_to_laspy: bool, pipe: Connection) -> None:
    logging.disable()
    limit = ROOM_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    try:
        pipe.send(verdict(path, compared_to_laspy))
    except BaseException as error:
        pipe.send((f"traceback: {type(error).__name__}", str(error)[:200]))


def judge(path: Path) -> tuple[str, str]:
    """The verdict of a process of its own; of a second one without laspy, where laspy ended the first."""
    return ask(path, True) or ask(path, False) or ("dies or hangs", "")


def ask(path: Path, compared_to_laspy: bool) -> tuple[str, str] | None:
    """The verdict of one process, None where it ends without."""
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe(False)
    process = context.Process(target=_answer, args=(path, compared_to_laspy, theirs))
    process.start()
    theirs.close()
    answer: tuple[str, str] | None = None
    with suppress(EOFError):
        answer = ours.recv() if ours.poll(SECONDS) else None
    process.kill()
    process.join()
    return answer


def mutants(path: Path, number: int, seed: int, place: Path) -> Iterator[Path]:
    """Hurt copies of a file, every other one by who knows its parts; each made of its number alone."""
    data = path.read_bytes()
    for k in range(number):
        chance = random.Random(f"{seed} {path.name} {k}")
        try:
            hurt = hurt_points(data, chance) if k % 2 else hurt_bytes(data, chance)
        except Exception:  # of a file that is damaged already no parts are known
            hurt = hurt_bytes(data, chance)
        copy = place / f"{k}{path.suffix.lower()}"
        copy.write_bytes(hurt)
        yield copy


def main() -> None:
    """Judge all files of the folder and keep the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--mutations", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    rows: dict[tuple[str, str], Counter[str]] = {}
    files = sorted(path for path in given.folder.rglob("*") if path.suffix.lower() in LAS_SUFFIXES)
    refusals: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as scratch:
        for path in files:
            project = path.parent.name
            word, line = judge(path)
            rows.setdefault((project, "files"), Counter())[word if word in GOOD else "wrong"] += 1
            if line or word not in GOOD:
                refusals[f"{project}/{path.name}"] = f"{word}: {line}"
            for copy in mutants(path, given.mutations, given.seed, Path(scratch)):
                word, line = judge(copy)
                rows.setdefault((project, "mutations"), Counter())[word if word in GOOD else "wrong"] += 1
                if word not in GOOD:
                    refusals[f"{project}/{path.name}, mutation {copy.stem}"] = f"{word}: {line}"
    table = [
        {"project": project, "what": what, "number": sum(one.values())}
        | {w: one[w] for w in (*GOOD, "wrong")}
        for (project, what), one in sorted(rows.items())
    ]
    note = "\n".join(f"- {name}: {line}" for name, line in sorted(refusals.items()))
    command = f"python -m benchmarks.scale.zoo FOLDER --mutations {given.mutations} --seed {given.seed}"
    keep("zoo", "Point files of other projects", table, command, f"{NOTE}\n\n{note}")


if __name__ == "__main__":
    main()
