"""The hour of each of four users as a script: their commands on real data, what each ends with, and pictures.

    python -m benchmarks.scale.roles DATA OUT

Everything goes through the command line, as they would type it; pages are drawn by chromium where there
is one.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
import pyogrio

from benchmarks.table import keep

COMMAND = "python -m benchmarks.scale.roles DATA OUT"
WINDOW = "1400,900"
"""Pixels of a picture."""
METHOD = '''
from typing import ClassVar

import numpy as np

import eaves
from eaves.model import Regions


class Blocks(eaves.Detector):
    """Squares of four metres in which most points are high."""

    name: ClassVar[str] = "blocks"
    idea: ClassVar[str] = "Squares in which most points are high."

    def label(self, scene, emit=eaves.methods.ignore):
        cell = np.floor(scene.cloud.xyz[:, :2] / 4.0).astype(int)
        number = np.unique(cell, axis=0, return_inverse=True)[1].ravel()
        high = scene.height > 2.5
        share = np.bincount(number, high) / np.bincount(number)
        return Regions(np.where(high & (share[number] > 0.5), number + 1, 0).astype(np.int32))
'''


@dataclass(frozen=True)
class Step:
    """What a user does: the words after `eaves`, the file (in the folder) that must be there then, and
    the status that is right."""

    words: str
    leaves: str = ""
    status: int = 0


ROLES = {
    "analyst": (
        Step("info small.laz"),
        Step("build small.laz -o out", "out/report.html"),
        Step("update out --edits verdict.csv", "out/edits.gpkg"),
        Step("build small.laz -o out", "out/edits.gpkg"),
        Step("view out --no-browser --again", "out/report.html"),
        Step("export out --formats citygml,glb,dxf", "out/buildings.glb"),
        Step("validate out"),
    ),
    "agency": (
        Step("build tiles -o town --dry-run"),
        Step("build tiles/west.laz -o town --keep", "town/footprints.gpkg"),
        Step("build tiles/west.laz -o town --keep --resume", "town/footprints.gpkg"),
        Step("update town tiles/east.laz -o again", "again/footprints.gpkg"),
        Step("compare town again -o same", "same/changes.gpkg"),
        Step("build tiles --footprints far.gpkg -o far", status=2),
        Step("validate town"),
    ),
    "researcher": (
        Step("methods detect"),
        Step("build small.laz -o own --detect-method own:Blocks --steps", "own/footprints.gpkg"),
        Step("build small.laz -o own2 --detect-method own:Missing", status=2),
        Step("build small.laz -o published --source chen_sun", "published/footprints.gpkg"),
        Step("build small.laz -o ours", "ours/footprints.gpkg"),
    ),
    "solar modeller": (
        Step("build small.laz -o roofs", "roofs/report.html"),
        Step("solar roofs", "roofs/solar.gpkg"),
        Step("solar roofs --annual 1050", "roofs/irradiation.tif"),
        Step("solar roofs --annual 2000", status=2),
    ),
}


def main() -> None:
    """Do all of it, and write the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("out", type=Path)
    options = parser.parse_args()
    rows = []
    for role, steps in ROLES.items():
        folder = options.out / role.replace(" ", "_")
        shutil.rmtree(folder, ignore_errors=True)
        lay_out(options.data, folder)
        rows += list(taken(role, steps, folder))
    keep("roles", "Four roles", rows, COMMAND)


def lay_out(data: Path, folder: Path) -> None:
    """A user's files: a small survey, two tiles of it, a map that lies elsewhere, a verdict, a method."""
    (folder / "tiles").mkdir(parents=True)
    shutil.copy(data / "misc" / "delft_small.laz", folder / "small.laz")
    cloud = laspy.read(folder / "small.laz")
    middle = float(np.median(cloud.x))
    for name, chosen in (("west", cloud.x < middle), ("east", cloud.x >= middle)):
        cloud[chosen].write(folder / "tiles" / f"{name}.laz")
    far = pyogrio.read_dataframe(data / "delft" / "footprints.gpkg")
    pyogrio.write_dataframe(far.set_geometry(far.translate(100_000.0, 0.0)), folder / "far.gpkg")
    (folder / "own.py").write_text(METHOD, encoding="utf-8")


def taken(role: str, steps: tuple[Step, ...], folder: Path) -> Iterator[dict[str, object]]:
    """The steps of a role, done in its folder: a row for each."""
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
    }
    for step in steps:
        if "verdict.csv" in step.words:
            summary = json.loads((folder / "out" / "run.json").read_text("utf-8"))
            assert summary["found"]
            first = pyogrio.read_dataframe(folder / "out" / "footprints.gpkg", layer="footprints")["id"][0]
            (folder / "verdict.csv").write_text(f"id,verdict\n{first},no building\n", encoding="utf-8")
        before = os.times()
        command = [sys.executable, "-m", "eaves", *step.words.split()]
        answer = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
        after = os.times()
        right = answer.returncode == step.status and (folder / step.leaves).exists()
        yield {
            "role": role,
            "command": f"eaves {step.words}",
            "status": answer.returncode,
            "as it should be": "yes" if right else "**no**",
            "CPU s": round(after[2] + after[3] - before[2] - before[3], 1),
            "last line": " ".join(
                (answer.stderr if answer.returncode else answer.stdout).strip().split("\n")[-1].split()
            )[:160],
        }
    for page in sorted(folder.glob("*/report.html")):
        draw(page, folder / f"{page.parent.name}.png")


def draw(page: Path, picture: Path) -> None:
    """The page as chromium draws it, where there is one."""
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is not None:
        flags = ["--headless", "--no-sandbox", "--use-gl=swiftshader", "--enable-unsafe-swiftshader"]
        flags += [f"--window-size={WINDOW}", "--virtual-time-budget=20000", f"--screenshot={picture}"]
        subprocess.run([browser, *flags, page.resolve().as_uri()], capture_output=True, timeout=120)


if __name__ == "__main__":
    main()
