"""A run opened again, to be corrected or updated: with the results that it kept (`eaves build --keep`), about
100 bytes a point, or without any, so that all of them are computed again."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eaves.flow.region import EARLIER, REQUEST
from eaves.flow.run import Run, look_at_scan, open_run
from eaves.formats import InputError
from eaves.methods import installed_methods, resolve_method
from eaves.recipe.recipe import Recipe
from eaves.run.index import Index
from eaves.run.manifest import read_facts
from eaves.run.options import DECLARED, METHOD_OPTIONS
from eaves.run.store import WORK
from eaves.surroundings.vegetation import VegetationRules

MODELS = "buildings.city.jsonl"
"""The file of a run's models."""

REMEDY = "build it again with --keep"
DECISIVE = ("methods", "use_classes", "lod", "clip", "footprints", "party_walls")
"""Of a run's plan: where one of these is another, the results are."""


@dataclass(frozen=True)
class Request:
    """The request of a run, and the updates that it went through."""

    inputs: Sequence[str]
    options: dict[str, Any]
    plan: dict[str, Any]
    generations: Sequence[int]
    updates: Sequence[dict[str, Any]]
    keep: bool = False
    """True if its results are kept."""


def read_request(folder: Path) -> Request:
    """The request of the run in a folder: that beside the results that it kept, or else that in its run.json.

    Raises
    ------
    InputError
        When there is none, or it is damaged, or of another version.
    """
    path = folder / WORK / REQUEST
    if not folder.is_dir():
        raise InputError.about(folder, "does not exist", "give what `eaves build --keep` wrote")
    facts = read_facts(folder)
    try:
        if path.exists():
            request = Request(**json.loads(path.read_text(encoding="utf-8")), keep=True)
        else:
            request = Request(plan=facts, **facts["request"])
    except KeyError:
        raise InputError.about(folder, "keeps no parts of its run", REMEDY) from None
    except TypeError:
        raise InputError.about(folder, "keeps parts that another version of eaves wrote", REMEDY) from None
    except (ValueError, RecursionError):
        raise InputError.about(path, "is damaged", REMEDY) from None
    if request.options.keys() - DECLARED.keys():
        raise InputError.about(folder, "keeps parts that another version of eaves wrote", REMEDY)
    return request


def open_again(
    folder: Path,
    new: Sequence[str] = (),
    out: Path | None = None,
    jobs: int = 1,
    overwrite: bool = False,
    methods: Collection[str] = (),
) -> Run:
    """The run of a folder, opened again; with `new` inputs, a later scan, into `out`. Of other packages the
    `methods` named (`module:Class`) are imported.

    Points keep their ids, for the inputs keep their order.

    Raises
    ------
    InputError
        When the folder holds none, an input is missing, has changed or cannot be used, another version made
        the results, results are needed that it did not keep, or `out` holds what would be written over.
    """
    request = read_request(folder)
    if not request.keep and (new or request.generations):
        raise InputError.about(folder, "keeps no parts of its run", REMEDY)
    inputs = [*request.inputs, *new]
    # in its own folder edits are kept
    options = {**request.options, "jobs": jobs, "overwrite": overwrite or out is None}
    recipe = kept_recipe(request.plan, methods)
    run = look_at_scan(open_run(inputs, out or folder, recipe, keep=request.keep, resume=True, **options))
    broken = [reason for reason in run.failed if any(path in reason for path in new)]
    if broken:
        raise InputError(broken[0])
    index = ordered(run.index, inputs)
    for key in DECISIVE:
        if run.plan.get(key) != request.plan.get(key):
            raise InputError.about(
                folder, f"keeps parts of a run with another {key.replace('_', ' ')}", REMEDY
            )
    count = len(index) - len(new)
    if marks_of(index.subset(np.arange(count)).describe()) != marks_of(request.plan):
        raise InputError.about(folder, "keeps parts of inputs that have changed since", REMEDY)
    return replace(
        run,
        index=index,
        plan={**run.plan, **index.describe()},
        inputs=tuple(inputs),
        generations=(*request.generations, count) if new else tuple(request.generations),
        updates=tuple(request.updates),
        translate=frame_of(folder),
    )


def ordered(index: Index, inputs: Sequence[str]) -> Index:
    """The index with its files in an order of their true paths."""
    places = {os.path.realpath(path): k for k, path in enumerate(inputs)}
    order = sorted(range(len(index)), key=lambda k: places.get(os.path.realpath(index.path(k)), len(places)))
    return index.subset(np.array(order, np.int64))


def frame_of(folder: Path) -> tuple[float, ...] | None:
    """The origin of the coordinates of a run's models; None where it wrote none."""
    path = folder / MODELS
    try:
        with path.open(encoding="utf-8") as file:
            return tuple(map(float, json.loads(file.readline())["transform"]["translate"]))
    except FileNotFoundError:
        return None
    except (ValueError, KeyError, TypeError):
        raise InputError.about(path, "is damaged", REMEDY) from None


def marks_of(plan: dict[str, Any]) -> list[tuple[int, str]]:
    """Points and fingerprint of each input, wherever it lies; of very many inputs their common hash."""
    if "inputs" in plan:
        return [(entry["points"], entry["fingerprint"]) for entry in plan["inputs"]]
    return [(plan["files"], plan["inputs_sha256"])]


def kept_recipe(plan: dict[str, Any], named: Collection[str] = ()) -> Recipe:
    """The recipe that a run's plan states. A file imports no code: a method of another package is one that an
    installed package brings, or is among those `named`.

    Raises
    ------
    InputError
        When one is neither.
    """
    for stage in METHOD_OPTIONS:
        place = str((plan["methods"][stage] or {}).get("method"))
        if ":" in place and place not in {*named, *installed_methods(stage).values()}:
            raise InputError(
                f"the run's {stage} method is {place!r}, code that is not imported because a file names it; "
                f"if you trust it, add --method {place}"
            )
    methods: dict[str, Any] = {
        stage: None if table is None else resolve_method(stage, table, False)
        for stage, table in ((stage, plan["methods"][stage]) for stage in METHOD_OPTIONS)
    }
    vegetation = plan.get("vegetation")
    return Recipe(
        **methods,
        use_classes=plan["use_classes"],
        from_raster=bool(plan.get("from_raster")),
        lod=plan["lod"],
        ground_classes=tuple(plan.get("ground_classes") or (2,)),
        vegetation=None if vegetation is None else VegetationRules(**vegetation),
        others=plan.get("others", True),
        smallest=tuple(plan.get("smallest", Recipe.smallest)),
    )


def link_file(source: str | Path, target: str | Path) -> None:
    """One file under another name, in a folder that is made when missing."""
    Path(target).parent.mkdir(parents=True, exist_ok=True)
    Path(target).unlink(missing_ok=True)
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)


def link_results(source: Path, target: Path) -> None:
    """The results of a run under other names, without taking room where the disk can do that. They are never
    written in place, so neither run sees what the other does."""
    hidden = shutil.ignore_patterns(EARLIER, ".*")
    shutil.copytree(source, target, copy_function=link_file, ignore=hidden, dirs_exist_ok=True)
