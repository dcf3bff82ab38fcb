"""A worker is killed at a random moment, twenty times; then the whole run is, and resumed.

usage: python -m benchmarks.scale.killed [--times N]
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.scale.identical import digest
from benchmarks.table import keep
from eaves.simulate import scan_town, simulate_town, write_simulation


def workers_of(process: subprocess.Popen[bytes]) -> list[int]:
    """Process ids of the children of a process (Linux)."""
    listing = subprocess.run(["ps", "--ppid", str(process.pid), "-o", "pid="], capture_output=True, text=True)
    return [int(word) for word in listing.stdout.split()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=20)
    asked = parser.parse_args()
    chance = random.Random(1)
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        town = simulate_town(0.03, seed=13)
        points = write_simulation(scan_town(town, 4.0, seed=13), place / "town")["points"]
        words = [
            sys.executable,
            "-m",
            "eaves.cli.app",
            "build",
            str(points),
            "-q",
            "--jobs",
            "2",
            "--block",
            "60",
        ]
        started = time.perf_counter()
        subprocess.run([*words, "-o", str(place / "whole")], check=True, capture_output=True)
        whole, right = time.perf_counter() - started, digest(place / "whole")
        tries = 0
        while len(rows) < asked.times:
            out, tries = place / str(tries), tries + 1
            all_of_it = len(rows) % 4 == 3
            process = subprocess.Popen(
                [*words, "-o", str(out)], stderr=subprocess.DEVNULL, start_new_session=True
            )
            moment = chance.uniform(0.2, 0.95) * whole
            time.sleep(moment)
            ended = process.poll() is not None
            victims = [] if ended else [process.pid] if all_of_it else workers_of(process)
            if not victims:  # too late, or between two stages; the machine may be faster now
                process.wait()
                whole = 0.9 * whole if ended else whole
                continue
            os.kill(chance.choice(victims), signal.SIGKILL)
            status = process.wait()
            if all_of_it:
                subprocess.run(["pkill", "-9", "-g", str(process.pid)], check=False)
            resumed = status != 0
            if resumed:
                status = subprocess.run([*words, "-o", str(out), "--resume"], capture_output=True).returncode
            rows.append(
                {
                    "run": len(rows) + 1,
                    "killed": "the whole run" if all_of_it else "a worker",
                    "after s": round(moment, 1),
                    "resumed": "yes" if resumed else "no need",
                    "status": status,
                    "identical": "yes" if digest(out) == right else "NO",
                }
            )
            print(rows[-1], flush=True)
    keep("killed", "Killed at a random moment", rows, "python -m benchmarks.scale.killed")


if __name__ == "__main__":
    main()
