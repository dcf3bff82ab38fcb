"""What a run keeps (`eaves build --keep`) so that it can be corrected: its parts, and its request.

Without the parts every correction would read, classify and detect everything again. They take about 100 bytes
a point.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eaves.formats import InputError
from eaves.methods import resolve_method
from eaves.model import Block
from eaves.run.options import METHOD_OPTIONS
from eaves.run.recipe import Recipe
from eaves.run.run import WORK, Run, open_run
from eaves.run.store import REQUEST, Store
from eaves.run.vegetation import VegetationRules

MODELS = "buildings.city.jsonl"
"""The file of a run's models."""

REMEDY = "build it again with --keep"


@dataclass(frozen=True, eq=False)
class Request:
    """What a run was asked for, and the blocks it computed."""

    inputs: tuple[str, ...]
    options: dict[str, Any]
    plan: dict[str, Any]
    blocks: tuple[Block, ...]
    owners: tuple[Block, ...]


def read_request(folder: Path) -> Request:
    """The request that a run's folder keeps.

    Raises
    ------
    InputError
        When it keeps none, or it is damaged.
    """
    path = folder / WORK / REQUEST
    if not folder.is_dir():
        raise InputError.about(folder, "does not exist", "give what `eaves build --keep` wrote")
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        blocks, owners = (
            tuple(Block(int(column), int(row)) for column, row in told[name]) for name in ("blocks", "owners")
        )
        return Request(tuple(told["inputs"]), told["options"], told["plan"], blocks, owners)
    except FileNotFoundError:
        raise InputError.about(folder, "keeps no parts of its run", REMEDY) from None
    except (ValueError, KeyError, TypeError, RecursionError):
        raise InputError.about(path, "is damaged", REMEDY) from None


def write_request(store: Store, request: Request) -> None:
    """Write a request beside the parts."""
    store.keep_request(
        {"inputs": list(request.inputs), "options": request.options, "plan": request.plan},
        request.blocks,
        request.owners,
    )


def open_kept(folder: Path) -> Run:
    """The run of a folder that keeps its parts, opened again.

    Raises
    ------
    InputError
        When the folder keeps none, or an input is missing, has changed, or another version made the parts.
    """
    request = read_request(folder)
    run = open_run(
        list(request.inputs), folder, recipe_of(request.plan), keep=True, resume=True, **request.options
    )
    run = replace(ordered(run, request.inputs), translate=frame_of(folder))
    for key in ("version", "methods", "use_classes", "lod", "clip", "footprints", "party_walls"):
        if run.plan.get(key) != request.plan.get(key):
            raise InputError.about(
                folder, f"keeps parts of a run with another {key.replace('_', ' ')}", REMEDY
            )
    if marks_of(run.plan) != marks_of(request.plan):
        raise InputError.about(folder, "keeps parts of inputs that have changed since", REMEDY)
    return run


def ordered(run: Run, inputs: Sequence[str]) -> Run:
    """The run with its inputs in an order of their true paths: that in which points were given their ids."""
    places = {os.path.realpath(path): k for k, path in enumerate(inputs)}
    order = sorted(
        range(len(run.index)), key=lambda k: places.get(os.path.realpath(run.index.path(k)), len(places))
    )
    index = run.index.subset(np.array(order, np.int64))
    return replace(run, index=index, plan={**run.plan, **index.describe()})


def frame_of(folder: Path) -> tuple[float, ...] | None:
    """What the coordinates of a run's models count from; None where it wrote none."""
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
        return [(one["points"], one["fingerprint"]) for one in plan["inputs"]]
    return [(plan["files"], plan["inputs_sha256"])]


def recipe_of(plan: dict[str, Any]) -> Recipe:
    """The recipe that a run's plan states."""
    methods: dict[str, Any] = {
        stage: None if told is None else resolve_method(stage, told, False)
        for stage, told in ((stage, plan["methods"][stage]) for stage in METHOD_OPTIONS)
    }
    vegetation = plan.get("vegetation")
    return Recipe(
        **methods,
        use_classes=plan["use_classes"],
        lod=plan["lod"],
        ground_classes=tuple(plan.get("ground_classes") or (2,)),
        vegetation=None if vegetation is None else VegetationRules(**vegetation),
        others=plan.get("others", True),
    )
