"""A drawn town in a hundred files, built by tiles, killed twice and resumed: is anything twice, or missing?

The town lies across the corner of four tiles of a run. Held against it are the same command undisturbed, byte
by byte (`faults.contents`), and the town built in one piece, by the digest of `identical`.

usage: python -m benchmarks.scale.killed_tiles [FOLDER]
"""

from __future__ import annotations

import json
import resource
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np

from benchmarks.scale.faults import contents
from benchmarks.scale.identical import digest, write_part
from benchmarks.survey_variants import survey_of
from benchmarks.table import as_markdown
from eaves.model import BLOCK_SIDE
from eaves.simulate import scan_town, simulate_town

AREA_KM2, DENSITY, NOISE, SEED = 0.5, 3.0, 0.03, 9401
FILES_A_SIDE = 10
CORNER_M = np.array([16.0 * BLOCK_SIDE * 125, 16.0 * BLOCK_SIDE * 1500])
"""Of four tiles of a run."""
KILLED_AT = (0.35, 0.5)
"""Shares of the time of the undisturbed run after which it, and the one that resumes it, are killed."""


def write_town(place: Path) -> int:
    """Write the town in files of one size each; how many."""
    scene = scan_town(simulate_town(AREA_KM2, style="mixed", seed=SEED), DENSITY, NOISE, seed=SEED)
    survey = survey_of("town", scene)
    middle = 0.5 * (survey.xyz[:, :2].min(axis=0) + survey.xyz[:, :2].max(axis=0))
    survey = replace(survey, xyz=survey.xyz + [*(CORNER_M - np.round(middle)), 0.0])
    place.mkdir(parents=True)
    survey.write(place / "whole.laz")
    las = laspy.read(place / "whole.laz")
    (place / "whole.laz").unlink()
    xy = np.column_stack([las.x, las.y])
    low, high = xy.min(axis=0), xy.max(axis=0) + 0.01
    square = ((xy - low) / (high - low) * FILES_A_SIDE).astype(int)
    for column in range(FILES_A_SIDE):
        for row in range(FILES_A_SIDE):
            write_part(las, (square == [column, row]).all(axis=1), place / f"{column}_{row}.laz")
    return len(list(place.iterdir()))


def start(tiles: Path, out: Path, *options: str) -> subprocess.Popen[bytes]:
    """A run of the command."""
    command = [sys.executable, "-m", "eaves", "build", str(tiles), "-o", str(out), "--quiet", "--jobs", "2"]
    return subprocess.Popen([*command, *options], start_new_session=True)


def main(place: Path) -> None:
    """Build, kill, resume and compare."""
    files = write_town(place / "tiles")
    began = time.perf_counter()
    status = start(place / "tiles", place / "right", "--per-tile").wait()
    seconds = time.perf_counter() - began
    memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    for share in KILLED_AT:
        process = start(place / "tiles", place / "killed", "--per-tile", "--resume")
        time.sleep(share * seconds)
        subprocess.run(["pkill", "-9", "-s", str(process.pid)], check=False)
        assert process.wait() == -signal.SIGKILL, "it had ended before it was killed"
    resumed = start(place / "tiles", place / "killed", "--per-tile", "--resume").wait()
    whole = start(place / "tiles", place / "whole").wait()
    right, killed = contents(place / "right"), contents(place / "killed")
    run = json.loads((place / "killed" / "run.json").read_text(encoding="utf-8"))
    same = digest(place / "killed")[0] == digest(place / "whole")[0]
    row = {
        "files": files,
        "points": run["points"],
        "buildings": run["found"],
        "statuses": f"{status}, {resumed}, {whole}",
        "files written": len(right),
        "of other bytes": sum(right.get(name) != killed.get(name) for name in right | killed),
        "models as in one piece": same,
        "undisturbed (s)": round(seconds),
        "largest process (MB)": round(memory),
    }
    print(as_markdown([row]))


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as folder:
            main(Path(folder))
