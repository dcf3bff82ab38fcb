"""What every rule of the defaults is worth: each switched off by itself, by the command a user runs.

Run `EAVES_DATA=... python -m benchmarks.accuracy.ablation [--rules TEXT...] [--surveys TEXT...] [--keep]`.
Each rule runs `eaves build` in a process of its own, in which its parameters have other defaults or its
functions answer nothing. Stages before the rule come from the run of the defaults (EAVES_CACHE), and where a
rule leaves the inputs of a stage as they are, stages after it. The noise of a measure is how far it moves
when points are left out or the survey is moved by a part of a cell, on the defaults.
"""

from __future__ import annotations

import argparse
import functools
import hashlib
import json
import os
import pickle
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages
from typing import Any

import laspy
import numpy as np
import pyogrio
import shapely

from benchmarks.accuracy.ablation_rules import RULES, Rule
from benchmarks.survey_variants import SOMEWHERE_M, read_survey, survey_of
from benchmarks.table import keep
from eaves.evaluate.footprint_scores import evaluate_footprints
from eaves.geometry.face_table import FaceTable, RoofFaces, fit_roof, roof_point_mask
from eaves.methods import DEFAULTS, method_class
from eaves.model.cloud import BUILDING, GROUND
from eaves.simulate import scan_town, simulate_town

COMMAND = "python -m benchmarks.accuracy.ablation"
DATA = Path(os.environ.get("EAVES_DATA", "data"))
CACHE = Path(os.environ.get("EAVES_CACHE", str(Path.home() / ".cache/eaves"))) / "ablation"
CUTS: dict[str, tuple[str, int, tuple[float, float, float, float]]] = {
    "delft": ("delft/ahn3.laz", 28992, (84808, 447412, 85000, 447600)),
    "williams": ("williams/williams.laz", 26912, (391867, 3901029, 392200, 3901250)),
    "ign_urban": ("ign_urban/*.laz", 2154, (-np.inf, -np.inf, np.inf, np.inf)),
    "ucla": ("ucla/royce.laz", 2229, (-np.inf, -np.inf, np.inf, np.inf)),
    "kleve": ("kleve/kleve.laz", 25832, (290990, 5744590, 291190, 5744790)),
    "woodford": ("woodford/woodford.laz", 3089, (5210600, 3904900, 5212000, 3906300)),
}
"""Files, system and the part of them that is cut out, in its units."""
TOWNS = {
    "town, suburb at 12": (2611, "suburb", "hilly", 12.0, 0.02),
    "town, centre at 5": (2612, "centre", "slope", 5.0, 0.03),
    "town, mixed at 2": (2613, "mixed", "flat", 2.0, 0.04),
}
"""Seed, style, terrain, density and noise of towns that chose nothing."""
OLDER = ("delft", "ign_urban", "woodford")
"""Surveys that chose most rules: what is lost there counts from three times the noise on."""
VARIANTS = ("thinned", "thinned again", "moved")
THINNED, MOVED = 0.97, (0.37, 0.61)
STAGES = {
    "ground": (
        "eaves.ground.stage:classify_ground",
        "eaves.ground.adaptive_tin.method:AdaptiveTin.find_wide_objects",
    ),
    "raster": ("eaves.raster.surfaces:scene_of", "eaves.raster.surfaces:two_scenes"),
    "detect": ("eaves.detect.stage:detect_buildings",),
    "outline": ("eaves.outline.stage:trace_outline", "eaves.outline.stage:regularise_outlines"),
    "units": ("eaves.units.stage:divide_block",),
    "roof": ("eaves.roof.stage:segment_roof",),
    "reconstruct": ("eaves.reconstruct.stage:reconstruct_building",),
}
"""What of each stage is not computed twice."""


def make_files(folder: Path) -> None:
    """The surveys, bare, with their variants and truths."""
    folder.mkdir(parents=True, exist_ok=True)
    towns = {name: None for name in TOWNS}
    for name in [*CUTS, *towns]:
        if (folder / f"{name}.truth.npz").exists():
            continue
        plans: Any = []
        if name in CUTS:
            pattern, epsg, (west, south, east, north) = CUTS[name]
            survey = read_survey(name, sorted(DATA.glob(pattern)), epsg)
            x, y = survey.xyz[:, 0], survey.xyz[:, 1]
            survey = survey.take((x >= west) & (x <= east) & (y >= south) & (y <= north))
            if name == "delft":
                plans = shapely.from_wkb(pyogrio.raw.read(DATA / "delft/footprints.gpkg")[2])
                plans = [plan for plan in plans if shapely.box(west, south, east, north).covers(plan)]
        else:
            seed, style, terrain, density, noise = TOWNS[name]
            town = simulate_town(0.03, terrain=terrain, style=style, seed=seed)  # type: ignore[arg-type]
            scene = scan_town(town, density, noise, seed=seed)
            survey = survey_of(name, scene)
            origin = np.asarray(scene.cloud.origin) + SOMEWHERE_M[:2]
            plans = [shapely.transform(one.footprint, lambda xy, o=origin: xy + o) for one in scene.buildings]
        chance = np.random.default_rng(7)
        for variant in ("", *VARIANTS):
            some, shifted = survey, np.zeros(3)
            if variant.startswith("thinned"):
                some = survey.take(chance.random(len(survey.xyz)) < THINNED)
            if variant == "moved":
                shifted = np.array([*MOVED, 0.0]) / (0.3048 if name in ("ucla", "woodford") else 1.0)
                some = type(survey)(**{**vars(survey), "xyz": survey.xyz + shifted})
            some.write(folder / f"{name}{'.' if variant else ''}{variant}.laz")
            moved = [
                shapely.to_wkb(shapely.transform(plan, lambda xy, s=shifted: xy + s[:2])) for plan in plans
            ]
            np.savez(
                folder / f"{name}{'.' if variant else ''}{variant}.truth.npz",
                xyz=some.xyz,
                truth=some.truth,
                plans=np.array([wkb.hex() for wkb in moved], str),
            )


def figures(name: str, truth: Path, out: Path) -> dict[str, float]:
    """The measures of a result of a survey."""
    known = np.load(truth)
    unit = 0.3048006 if name in ("ucla", "woodford") else 1.0
    xyz, want = known["xyz"], known["truth"]
    las = laspy.read(out / "classified.laz")
    got, place = np.asarray(las.classification), np.lexsort(np.c_[las.x, las.y, las.z].round(4).T)
    got, want, xyz = got[place], want[(order := np.lexsort(xyz.round(4).T))], xyz[order]
    _, _, shapes, _ = pyogrio.raw.read(out / "footprints.gpkg", layer="footprints", columns=[])
    outlines = [one for one in shapely.from_wkb(shapes) if one is not None]
    answer: dict[str, float] = {"buildings": len(outlines)}
    mine, true = got == BUILDING, want == BUILDING
    if true.any():
        answer["class 6 IoU"] = float((mine & true).sum() / (mine | true).sum())
        answer["roofs in 0.2 m"] = near_roofs(out, xyz[true] * unit, unit)
    else:
        answer["class 6 not ground"] = 1.0 - float((mine & (want == GROUND)).sum() / max(1, mine.sum()))
        answer["high found"] = halls_found(xyz * unit, want, mine)
    answer["ground kept"] = float((got[want == GROUND] == GROUND).mean())
    answer["ground right"] = 1.0 - float((~np.isin(want, (GROUND, 1)))[got == GROUND].mean())
    plans = [shapely.from_wkb(bytes.fromhex(one)) for one in known["plans"]]
    if plans:
        area = shapely.union_all(plans).envelope
        near = [one for one in outlines if area.intersects(one.centroid)]
        score = evaluate_footprints(near, plans)
        good = sum(row.iou is not None and row.iou >= 0.5 for row in score.rows)
        answer["outlines F1"] = 2.0 * good / max(1, len(near) + len(plans))
        answer["outlines, -RMS m"] = -score.rms_m
    return answer


def near_roofs(out: Path, points: Any, unit: float) -> float:
    """Share of roof points (N, 3) of the truth that lie within 0.2 m of the highest face over them."""
    _, _, shapes, _ = pyogrio.raw.read(out / "footprints.gpkg", layer="roof_planes", columns=[])
    origin = np.array([*points[:, :2].mean(axis=0), 0.0])
    rings = [
        [
            shapely.get_coordinates(r, include_z=True)[:-1] * unit - origin
            for r in (one.exterior, *one.interiors)
        ]
        for one in shapely.from_wkb(shapes)
    ]
    faces = RoofFaces.of(FaceTable.of(rings))
    some = points[::3] - origin
    apart = np.abs(fit_roof(some[roof_point_mask(some)], faces).vertical)
    return float((apart <= 0.2).mean())


def halls_found(xyz: Any, want: Any, mine: Any, cell: float = 4.0) -> float:
    """Share of the cells of wide groups, high over the ground of the truth, with a building's point."""
    from scipy import ndimage

    place = ((xyz[:, :2] - xyz[:, :2].min(axis=0)) / cell).astype(np.int64)
    shape = tuple(place.max(axis=0) + 1)
    low, top = np.full(shape, np.inf), np.full(shape, -np.inf)
    ground = want == GROUND
    np.minimum.at(low, tuple(place[ground].T), xyz[ground, 2])
    np.maximum.at(top, tuple(place.T), xyz[:, 2])
    nearest = ndimage.distance_transform_edt(~np.isfinite(low), return_distances=False, return_indices=True)
    even = ndimage.median_filter(np.where(np.isfinite(top), top, -1e3), 3)
    high = (even - low[tuple(nearest)] > 2.5) & (np.abs(even - top) < 1.0)
    group, count = ndimage.label(ndimage.binary_opening(high, np.ones((3, 3))))
    large = np.flatnonzero(np.bincount(group.ravel(), minlength=count + 1) * cell**2 >= 300.0)
    wanted = np.isin(group, large[large > 0])
    found = np.zeros(shape, bool)
    found[tuple(place[mine].T)] = True
    return float((found & wanted).sum() / max(1, wanted.sum()))


def digest_of(out: Path) -> str:
    """A hash of all that a run found."""
    found = hashlib.sha256(laspy.read(out / "classified.laz").points.array.tobytes())
    for layer, _ in pyogrio.list_layers(out / "footprints.gpkg"):
        for part in pyogrio.raw.read(out / "footprints.gpkg", layer=layer)[2:]:
            part = [] if part is None else part
            found.update(pickle.dumps([one.tolist() if isinstance(one, np.ndarray) else one for one in part]))
    return found.hexdigest()[:12]


def target_of(name: str) -> tuple[Any, str]:
    """The object and the name of its attribute that `stage.parameter` or `module:path` stand for."""
    if ":" not in name:
        stage, _, field = name.partition(".")
        return method_class(stage, DEFAULTS[stage]), field
    module, _, path = name.partition(":")
    found: Any = import_module(module if module.startswith("eaves.") else f"eaves.{module}")
    *parents, last = path.split(".")
    return functools.reduce(getattr, parents, found), last


def put(name: str, value: Any) -> None:
    """Set a parameter's default, a constant or a function, wherever it was imported."""
    owner, last = target_of(name)
    if isinstance(owner, type) and last in getattr(owner, "model_fields", {}):
        owner.model_fields[last].default = value
        owner.model_rebuild(force=True)
        return
    before = getattr(owner, last)
    if is_dataclass(owner) and isinstance(owner, type):
        names = [field.name for field in fields(owner) if field.default is not MISSING]
        known = dict(zip(names, owner.__init__.__defaults__, strict=True))  # type: ignore[misc]
        owner.__init__.__defaults__ = tuple({**known, last: value}.values())  # type: ignore[misc]
        return
    if not isinstance(owner, type(os)):
        (setattr if isinstance(owner, type) else object.__setattr__)(owner, last, value)
        return
    for module in [one for key, one in list(sys.modules.items()) if key.startswith("eaves.")]:
        if getattr(module, last, None) is before:
            setattr(module, last, value)


def remembered(function: Callable[..., Any], folder: Path) -> Callable[..., Any]:
    """The function, whose answers are kept by a hash of what it is given."""

    @functools.wraps(function)
    def answer(*given: Any, **named: Any) -> Any:
        key = hashlib.sha256(pickle.dumps((given, sorted(named.items())))).hexdigest()[:24]
        path = folder / f"{function.__qualname__}-{key}"
        if path.exists():
            return pickle.loads(path.read_bytes())
        found = function(*given, **named)
        path.with_suffix(f".{os.getpid()}").write_bytes(pickle.dumps(found))
        path.with_suffix(f".{os.getpid()}").replace(path)
        return found

    return answer


def run_one(rule: Rule, name: str, variant: str, files: Path) -> dict[str, Any]:
    """The measures of a survey without a rule, what it cost, and the hash of the result: in this process."""
    from eaves.cli.app import main as eaves

    for stage in DEFAULTS:
        import_module(method_class(stage, DEFAULTS[stage]).__module__)
    for place, value in rule.off.items():
        put(place, value)
    memory = CACHE / "stages"
    memory.mkdir(parents=True, exist_ok=True)
    for stage, functions in STAGES.items():
        for place in functions if stage not in rule.rooms and not variant else ():
            owner, last = target_of(place)
            put(place, remembered(getattr(owner, last), memory))
    stem = f"{name}{'.' if variant else ''}{variant}"
    with tempfile.TemporaryDirectory() as folder:
        solid = {"roof", "reconstruct"} & set(rule.rooms)
        sys.argv = ["eaves", "build", str(files / f"{stem}.laz"), "-o", f"{folder}/out", "-q", "--jobs", "1"]
        sys.argv += ["--outputs", "footprints,classified", *(() if solid else ("--lod", "0"))]
        before = os.times()
        try:
            eaves()
        except SystemExit as end:
            if end.code:
                raise RuntimeError(f"{rule.name}, {stem}: status {end.code}") from end
        after = os.times()
        out = Path(folder) / "out"
        cpu = after.user + after.system - before.user - before.system
        found = figures(name, files / f"{stem}.truth.npz", out)
        return {"cpu_s": round(cpu, 2), "digest": digest_of(out), **found}


def measured(rule: Rule, name: str, variant: str, files: Path) -> dict[str, Any] | None:
    """What `run_one` answers in a process of its own, kept; None where it fails."""
    key = hashlib.sha256(f"{rule.name}|{sorted(rule.off)}|{name}|{variant}|{code_now()}".encode()).hexdigest()
    path = CACHE / "figures" / f"{key[:20]}.json"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        read, write = os.pipe()
        if (child := os.fork()) == 0:
            status = 1
            try:
                warnings.simplefilter("ignore")
                os.write(write, json.dumps(run_one(rule, name, variant, files)).encode())
                status = 0
            except BaseException as error:
                print(f"{rule.name}, {name}: {type(error).__name__}: {error}", file=sys.stderr, flush=True)
            os._exit(status)
        os.close(write)
        text = b"".join(iter(lambda: os.read(read, 1 << 16), b""))
        os.close(read)
        if os.waitpid(child, 0)[1] or not text:
            return None
        path.write_bytes(text)
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


@functools.cache
def code_now() -> str:
    """A hash of the sources that the defaults run."""
    import eaves

    digest = hashlib.sha256()
    for path in sorted(Path(eaves.__file__).parent.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def losses(
    found: Mapping[str, float], base: Mapping[str, float], noise: Mapping[str, float]
) -> dict[str, float]:
    """What each measure loses, in multiples of its noise."""
    shown = [key for key in base if key not in ("cpu_s", "digest", "buildings")]
    return {key: (base[key] - found[key]) / noise[key] for key in shown}


def main() -> None:
    """Print and keep the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--rules", nargs="+", metavar="TEXT", help="rules that hold one of these")
    options.add_argument("--surveys", nargs="+", metavar="TEXT", help="surveys that hold one of these")
    options.add_argument("--keep", action="store_true", help="keep the table")
    chosen = options.parse_args()
    files = CACHE / "surveys"
    if subprocess.call(
        [sys.executable, "-c", f"from {__spec__.name} import *; make_files(Path({str(files)!r}))"]
    ):  # type: ignore[union-attr]
        raise SystemExit(1)
    import eaves.cli.app  # noqa: F401 (the children start with it)

    for package in (
        *("run", "ground", "detect", "outline", "units"),
        *("footprints", "formats", "raster", "validate"),
    ):
        for module in walk_packages(import_module(f"eaves.{package}").__path__, f"eaves.{package}."):
            import_module(module.name)
    names = [
        name for name in (*CUTS, *TOWNS) if not chosen.surveys or any(one in name for one in chosen.surveys)
    ]
    nothing = Rule("nothing", (), 0, {})
    base, noise, rows = {}, {}, []
    for name in names:
        base[name] = measured(nothing, name, "", files) or {}
        others = [measured(nothing, name, variant, files) or {} for variant in VARIANTS]
        measures = [key for key in base[name] if key not in ("cpu_s", "digest")]
        noise[name] = {
            key: max(0.001, *(abs(one[key] - base[name][key]) for one in others)) for key in measures
        }
        print(name, base[name], noise[name], flush=True)
    for rule in RULES:
        if chosen.rules and not any(one in rule.name for one in chosen.rules):
            continue
        row: dict[str, object] = {"room": rule.rooms[0], "without": rule.name, "numbers": rule.numbers}
        lost: list[str] = []
        same, saved, worse, worst = True, 0.0, 0, 0.0
        for name in names:
            found = measured(rule, name, "", files)
            if found is None:
                lost.append(f"{name}: fails")
                continue
            same &= found["digest"] == base[name]["digest"]
            saved += base[name]["cpu_s"] - found["cpu_s"]
            told = losses(found, base[name], noise[name])
            for key, times in told.items():
                if abs(times) > 1.0:
                    lost.append(f"{name} {key} {found[key] - base[name][key]:+.4f} ({-times:+.1f})")
            most = max(told.values())
            worse += name not in OLDER and most > 1.0
            worst = max(worst, most if name in OLDER else 0.0)
            if (more := found["buildings"] - base[name]["buildings"]) and abs(more) > noise[name][
                "buildings"
            ]:
                lost.append(f"{name} {more:+d} buildings")
        verdict = "changes nothing" if same else "stays" if worse > 1 or worst > 3.0 else "may go"
        row |= {"verdict": verdict, "moved by more than the noise (times it)": "; ".join(lost) or "–"}
        print(row, flush=True)
        rows.append(row)
    if chosen.keep:
        keep("ablation", "The defaults without each of their rules", rows, COMMAND, NOTE)


NOTE = """Figures less those of the defaults, in brackets in multiples of the noise of that measure on that
survey (points left out, the survey moved by a part of a cell). A rule stays when without it at least two of
williams, ucla, kleve and the drawn towns get worse by more than the noise, or one of the others by more than
three times it. What guards validity or honesty stays in any case. Cut-outs, bare files, `eaves build`."""


if __name__ == "__main__":
    main()
