"""The ground of surveys as they lie, turned, mirrored, tilted, and with late echoes added.

`python -m benchmarks.accuracy.ground_placements`, EAVES_DATA set. SMRF with one set of five numbers stands
beside.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.accuracy.ground import SMRF, by_smrf
from benchmarks.accuracy.late_echoes import SEEDS, Scan, read_scan
from benchmarks.table import keep
from eaves.ground import classify_ground
from eaves.model import GROUND, NOISE_CLASSES, Mask

TURN_DEG, TILT = 30.0, 0.1


def placed(scan: Scan) -> dict[str, Scan]:
    """The survey as it lies, turned, mirrored and tilted about its middle."""
    middle = np.append(scan.xyz[:, :2].mean(axis=0), 0.0)
    angle = np.radians(TURN_DEG)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    maps = {
        "as it lies": np.eye(3),
        f"turned by {TURN_DEG:g}°": turn,
        "mirrored": np.diag([-1.0, 1.0, 1.0]),
        "tilted by a tenth": np.array([[1, 0, 0], [0, 1, 0], [TILT, 0, 1]]),
    }
    return {
        name: replace(scan, xyz=((scan.xyz - middle) @ map_.T + middle).round(3))
        for name, map_ in maps.items()
    }


def errors(scan: Scan, counted: Mask) -> dict[str, float]:
    """Total errors, %, of the counted points (N,), by the default and by SMRF."""
    cloud, truth = scan.cloud(), scan.classes == GROUND
    found = {"total error %": classify_ground(cloud), f"{SMRF} %": by_smrf(cloud)}
    return {name: 100.0 * float((one.ground != truth)[counted].mean()) for name, one in found.items()}


def main() -> None:
    """Print and keep the table."""
    data = Path(os.environ["EAVES_DATA"])
    paths = [data / "delft" / "ahn3.laz", data / "williams" / "williams.laz"]
    rows: list[dict[str, object]] = []
    for path in [*paths, *sorted((data / "ign_urban").glob("*.laz"))]:
        scan = read_scan(path, path.parent.name if path in paths else f"ign {path.stem[10:22]}")
        counted = ~np.isin(scan.classes, NOISE_CLASSES)
        for name, one in placed(scan).items():
            rows.append({"survey": scan.name, "placement": name, **errors(one, counted)})
        late = [scan.with_echoes(seed) for seed in SEEDS]
        some = [errors(one, np.append(counted, one.classes[len(counted) :] == GROUND)) for one in late]
        for name, choose in (("mean", np.mean), ("worst", np.max)):
            means = {key: float(choose([one[key] for one in some])) for key in some[0]}
            rows.append({"survey": scan.name, "placement": f".5 % late echoes, {name} of six", **means})
    note = "Total error of the survey's own points against its class 2, noise left out, in process."
    command = "python -m benchmarks.accuracy.ground_placements"
    keep("ground-placements", "Ground: placements and late echoes", rows, command, note)


if __name__ == "__main__":
    main()
