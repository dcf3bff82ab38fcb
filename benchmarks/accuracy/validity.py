"""Whether models of random houses are valid, as written, by the schema and by every code of `eaves validate`.

usage: python -m benchmarks.accuracy.validity [--models 10000] [--first 0] [--seconds S] [--log FILE.jsonl]
       [--keep FOLDER]

Every house is made of its number alone: kind, turn, place, density, noise and how good its footprint is. A
log goes on where it ended. With --keep the file of each invalid model stays, and the call that makes it.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import affinity

from benchmarks.accuracy.rotations import scatter
from benchmarks.table import keep
from eaves.buildings.owned import keep_valid
from eaves.formats import write_cityjson
from eaves.geometry.neighbours import measure_spacing
from eaves.model import BuildingModel, Failure, Footprint, Points
from eaves.reconstruct import reconstruct_building
from eaves.roof import segment_roof
from eaves.simulate.objects.houses import (
    draw_church,
    draw_detached,
    draw_row,
    draw_tower,
    draw_town_house,
    make_building,
)
from eaves.validate import validate_file

COMMAND = "python -m benchmarks.accuracy.validity"
BASE = -5.0
KINDS = ("detached", "row", "town house", "tower", "church")
NOISES = (0.0, 0.02, 0.05, 0.1)
CORNER_NOISES = (0.0, 0.02, 0.3)
"""Of the footprint's corners (m): a true one, one of a survey, one of an old map."""


def house(number: int) -> tuple[Points, Footprint, str]:
    """The points, the footprint and the kind of one house."""
    rng = np.random.default_rng([number, 17])
    kind = str(rng.choice(KINDS, p=(0.6, 0.15, 0.15, 0.05, 0.05)))
    drawn = {
        "detached": lambda: draw_detached(rng),
        "row": lambda: draw_row(rng.uniform(12.0, 40.0), rng),
        "town house": lambda: draw_town_house(rng.uniform(5.0, 9.0), rng.uniform(9.0, 16.0), rng),
        "tower": lambda: draw_tower(rng),
        "church": lambda: draw_church(rng),
    }[kind]()
    building = make_building(drawn.masses, 1, 1, kind, BASE, drawn.overhang)
    points = scatter(building, float(rng.choice(NOISES)), rng)
    points = points[: int(len(points) * float(rng.choice((1.0, 0.5, 0.2, 0.05))))]
    turn, shift = rng.uniform(0.0, 360.0), rng.uniform(0.0, 240.0, 2)
    cosine, sine = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    points[:, :2] = points[:, :2] @ np.array([[cosine, sine], [-sine, cosine]]) + shift
    polygon = affinity.translate(affinity.rotate(building.footprint, turn, origin=(0, 0)), *shift)
    spread = float(rng.choice(CORNER_NOISES))
    corners = np.asarray(polygon.exterior.coords)[:-1]
    moved = shapely.Polygon(corners + rng.normal(0.0, spread, corners.shape), polygon.interiors)
    moved = shapely.set_precision(moved if moved.is_valid else polygon, 0.001)
    whole = moved if moved.geom_type == "Polygon" else max(moved.geoms, key=lambda one: one.area)
    return (
        points,
        Footprint(shapely.orient_polygons(whole), origin=(85200.0, 447120.0), id=f"h{number}"),
        kind,
    )


def model_of(number: int, checked: bool) -> BuildingModel | Failure:
    """The model of one house: as a method gives it, or as a run keeps it (`checked`)."""
    points, footprint, _ = house(number)
    if len(points) < 3:
        return Failure("too_few_points", "the scan is too thin", "roof", footprint)
    planes = segment_roof(points, measure_spacing(points))
    model = reconstruct_building(points, footprint, planes, BASE)
    return keep_valid(model, "2.2") if checked and isinstance(model, BuildingModel) else model


def judge(number: int, place: Path, kept: Path | None) -> dict[str, Any]:
    """What became of one house: its level, and the codes found before and after the run's own check."""
    found: dict[str, Any] = {"house": number, "kind": house(number)[2]}
    for stage, checked in (("method", False), ("run", True)):
        try:
            model = model_of(number, checked)
        except Exception as error:  # counted as a defect
            return {**found, "lod": "none", "method": [type(error).__name__], "run": [type(error).__name__]}
        path = place / "a.city.json"
        write_cityjson(path, [model])
        codes = sorted({finding.code for finding in validate_file(path)})
        found[stage], found["lod"] = codes, model.lod if isinstance(model, BuildingModel) else model.code
        if not codes and not checked:
            return {**found, "run": []}
        if codes and kept is not None:
            kept.mkdir(parents=True, exist_ok=True)
            (kept / f"{number}-{stage}.city.json").write_bytes(path.read_bytes())
            call = (
                f"from benchmarks.accuracy.validity import model_of\nmodel = model_of({number}, {checked})\n"
            )
            (kept / f"{number}-{stage}.py").write_text(call, encoding="utf-8")
    return found


def main() -> None:
    """Print and keep the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--models", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--log", type=Path)
    parser.add_argument("--keep", type=Path)
    asked = parser.parse_args()
    known = asked.log.read_text().splitlines() if asked.log is not None and asked.log.exists() else []
    rows = [json.loads(line) for line in known]
    done, end = {row["house"] for row in rows}, time.monotonic() + asked.seconds
    with tempfile.TemporaryDirectory() as place:
        for number in range(asked.first, asked.first + asked.models):
            if time.monotonic() > end:
                break
            if number not in done:
                rows.append(judge(number, Path(place), asked.keep))
                if asked.log is not None:
                    with asked.log.open("a", encoding="utf-8") as log:
                        log.write(json.dumps(rows[-1]) + "\n")
    table = []
    for kind in (*KINDS, "all"):
        mine = [row for row in rows if kind in (row["kind"], "all")]
        levels = Counter(row["lod"] for row in mine)
        bad = {stage: sum(bool(row[stage]) for row in mine) for stage in ("method", "run")}
        table.append(
            {
                "kind": kind,
                "houses": len(mine),
                **{f"LoD {lod}": levels[lod] for lod in ("2.2", "2.0", "1.3", "1.2")},
                "no model": sum(count for lod, count in levels.items() if not lod[0].isdigit()),
                "invalid from the method": bad["method"],
                "invalid in the file": bad["run"],
            }
        )
    codes = Counter(f"{stage} {code}" for row in rows for stage in ("method", "run") for code in row[stage])
    named = [f"{row['house']} ({row['method']})" for row in rows if row["method"]][:30]
    note = (
        "Density 1 to 20 points/m², noise 0 to 10 cm, footprints true, surveyed or of an old map. Invalid "
        "from the method: before what is not valid is dropped, as a run does (`keep_valid`). Checked is the "
        "file as written, schema included.\n\n"
        f"Codes: {', '.join(f'{name}: {count}' for name, count in sorted(codes.items())) or 'none'}. "
        f"Houses: {', '.join(named) or 'none'}."
    )
    keep("validity", "Validity of models of random houses", table, COMMAND, note)


if __name__ == "__main__":
    main()
