"""The detector fitted to one survey, its weights and its score, from what a user says is a building or not.

A verdict is one observation: the mean, over the cells at its place, of the terms that the detector weighs.
Logistic regression moves the shipped weights as far as the verdicts demand; what the detector says of all
other surfaces around holds it back, and so do the shipped weights themselves. Each verdict is judged once by
the weights that the others give (leave-one-out): where that is no better than the shipped ones, they stay.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from eaves.blocks.block import load_block, see_block
from eaves.buildings.building_file import Kept, as_found
from eaves.change.edits import read_edits, settle
from eaves.change.upkeep.corrected import outlines_in
from eaves.change.upkeep.kept import open_kept
from eaves.change.upkeep.rebuild import kept_edits
from eaves.detect.consensus.classifier import ScoreWeights, Weights, measured_terms, write_weights
from eaves.detect.consensus.method import Consensus
from eaves.flow.region import store_of
from eaves.flow.run import Progress, no_progress
from eaves.formats import InputError
from eaves.formats.atomic import atomic
from eaves.model import Block, Values
from eaves.recipe.recipe import Recipe
from eaves.run.keys import BLOCKS
from eaves.run.store import Store

LEAST, LEAST_EACH = 20, 5
"""Fewer verdicts fit nothing: 28 weights would follow chance. Nothing else holds the score: it needs so many
of each kind."""

RIDGE = 1.0
"""Precision of each weight about the shipped one: unit terms then move the odds by a factor of e at the most
that is usual."""

ANCHOR = 5.0
"""The weight of the surfaces and cells of no verdict together, in verdicts for each verdict: with 1 a
simulated town (seed 11, not scored) found more and invented more, with 25 it hardly moved."""

HELD_CELLS = 2000
"""So many cells of no verdict in a block stand for all."""

CLIP = 8.0
"""Odds (log) beyond which a place is sure either way."""


@dataclass(frozen=True, eq=False)
class Places:
    """Places that the detector judges: mean terms (N, T), the verdict of each (N,), and its weight."""

    terms: Values
    truth: Values
    weight: Values


@dataclass(frozen=True)
class Check:
    """How verdicts are judged by weights that have not seen them, and by the shipped ones: how many are
    right, and the mean log loss."""

    count: int
    right: tuple[int, int]
    loss: tuple[float, float]
    error: float
    """Standard error of the difference of the losses."""

    @property
    def better(self) -> bool:
        """Whether the fitted weights are, by more than chance gives."""
        gain = self.loss[1] - self.loss[0]
        return gain > self.error and self.right[0] >= self.right[1]

    @property
    def words(self) -> str:
        """In words."""
        return (
            f"left out one by one, {self.right[0]} of {self.count} are right (shipped: {self.right[1]}), "
            f"log loss {self.loss[0]:.3f} (shipped: {self.loss[1]:.3f})"
        )


@dataclass(frozen=True, eq=False)
class Calibrated:
    """The result of a calibration."""

    buildings: int
    others: int
    detector: Check | None
    score: Check | None
    weights: Weights | None
    """None where the shipped ones stay."""
    path: Path

    def as_text(self) -> str:
        """The closing lines."""
        count = self.buildings + self.others
        lines = [f"{count} verdicts: {self.buildings} buildings, {self.others} that are none"]
        if self.detector is None:
            return f"{lines[0]}\ntoo few, {LEAST} are needed: the shipped weights stay, nothing is written"
        for name, check in (("detector", self.detector), ("score", self.score)):
            if check is not None:
                lines.append(
                    f"{name}: {check.words}" + ("" if check.better else "; no better, the shipped one stays")
                )
        if self.weights is None:
            lines.append("nothing is written")
        else:
            lines.append(f"eaves build … --config {self.path}")
        return "\n".join(lines)


def calibrate(
    folder: Path, file: Path | None = None, out: Path | None = None, progress: Progress = no_progress
) -> Calibrated:
    """The detector of a run fitted to the user's verdicts; its configuration for `eaves build --config`.

    Parameters
    ----------
    folder
        What `eaves build --keep` wrote; the verdicts in its edits.gpkg count.
    file
        More edits, as `eaves update --edits` takes them. 'no building' says that there is none; every other
        verdict that there is one.
    out
        The configuration; by default calibration.toml in the folder. It is written only where it is better.
    progress
        Called with the step, how much of it is done, and how much there is.

    Raises
    ------
    InputError
        When the folder keeps no parts, its detector has no weights, or an edit cannot be read.
    """
    folder = Path(folder)
    run = open_kept(folder)
    method = run.recipe.detect
    if not isinstance(method, Consensus):
        raise InputError.about(folder, "was built with a detector that has no weights", "use consensus")
    store = store_of(run)
    found = outlines_in(as_found(store), run.side)
    edits = kept_edits(folder, store)
    if file is not None:
        edits += read_edits(file, store.system, {**found, **outlines_in(Kept(store), run.side)})
    orders, _ = settle(edits, found)
    truths = np.array([bool(order.outlines) for order in orders], bool)
    outlines = [shapely.union_all(order.outlines) if order.outlines else found[order.id] for order in orders]
    path = out or folder / "calibration.toml"
    counts = int(truths.sum()), int((~truths).sum())
    if sum(counts) < LEAST:
        return Calibrated(*counts, None, None, None, path)
    judged, held = gather(store, run.recipe, method, outlines, truths, progress)
    shipped = method.judged_by
    start = weights_of(shipped)
    detector = leave_one_out(judged, held, start)
    rows = as_found(store).rows(as_found(store).owners(run.side))
    scores = {str(row.values["id"]): float(row.values["score"]) for row in rows}
    known = [k for k, order in enumerate(orders) if order.known and order.id in scores]
    score_check, scale = check_score(np.array([scores[orders[k].id] for k in known]), truths[known])
    weights = shipped
    if detector.better:
        fit = regress(judged, held, start)
        count = len(shipped.surface)
        weights = replace(weights, surface=rounded_weights(fit[:count]), cell=rounded_weights(fit[count:]))
    if score_check is not None and score_check.better:
        weights = replace(weights, score=scaled(weights.score, *scale))
    if weights == shipped:
        return Calibrated(*counts, detector, score_check, None, path)
    given = {**method.model_dump(mode="json", exclude_defaults=True), "weights": write_weights(weights)}
    lines = [f"# fitted by eaves calibrate to {sum(counts)} verdicts on {folder.resolve().name}"]
    lines += [
        "[detect]",
        'method = "consensus"',
        *(f"{name} = {toml(value)}" for name, value in given.items()),
    ]
    with atomic(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return Calibrated(*counts, detector, score_check, weights, path)


def toml(value: object) -> str:
    """A value as TOML has it."""
    return f"'{value}'" if isinstance(value, str) and '"' in value else json.dumps(value)


def rounded_weights(values: Values) -> tuple[float, ...]:
    """To three places: more is chance."""
    return tuple(round(float(value), 3) for value in values)


def gather(
    store: Store,
    recipe: Recipe,
    method: Consensus,
    outlines: Sequence[BaseGeometry],
    truths: NDArray[np.bool_],
    progress: Progress,
) -> tuple[Places, Places]:
    """The terms that the detector weighs at the places of verdicts, and elsewhere in their blocks; the truth
    of the latter is what it says itself."""
    by_block: dict[Block, list[int]] = {}
    for k, outline in enumerate(outlines):
        point = outline.representative_point()
        by_block.setdefault(Block.at(point.x, point.y), []).append(k)
    judged, held = [], []
    everything = shapely.STRtree(list(outlines))
    for done, (block, own) in enumerate(sorted(by_block.items()), 1):
        if store.has(BLOCKS, block):
            xy, terms = terms_of_cells(store, recipe, method, block)
            within = ((k, shapely.contains_xy(outlines[k], xy)) for k in own)
            judged += [(terms[cells].mean(axis=0), truths[k]) for k, cells in within if cells.any()]
            others = [outlines[k] for k in everything.query(shapely.box(*vars(block.bounds).values()))]
            free = np.flatnonzero(~shapely.contains_xy(shapely.union_all(others), xy))
            held.append(terms[free[:: max(1, len(free) // HELD_CELLS)]])
        progress("verdicts", done, len(by_block))
    start = weights_of(method.judged_by)
    told = np.array([terms for terms, _ in judged]).reshape(len(judged), len(start))
    rest = np.concatenate([np.zeros((0, len(start))), *held])
    weight = np.full(len(rest), ANCHOR * len(judged) / max(len(rest), 1))
    places = Places(told, np.array([float(truth) for _, truth in judged]), np.ones(len(judged)))
    return places, Places(rest, sigmoid(rest @ start), weight)


def weights_of(weights: Weights) -> Values:
    """The weights (T,) of surfaces and of cells."""
    return np.array([*weights.surface, *weights.cell])


def terms_of_cells(
    store: Store, recipe: Recipe, method: Consensus, block: Block
) -> tuple[NDArray[np.float64], Values]:
    """The places (C, 2) of the cells of a block where something stands, and the terms (C, T) by which the
    detector judges each: those of its surface, or its own."""
    cloud, wide, decks, _ = load_block(block, store, recipe)
    _, scene, _ = see_block(cloud, block, recipe, wide, decks)
    halves = method.half_cells(scene, method.candidates(scene))
    evidence, segments = method.find_surfaces(scene, halves)
    found = measured_terms(evidence, segments, method.tolerance(scene.spacing), method.judged_by, method)
    seen = np.flatnonzero(evidence.candidate)
    large = found.large.ravel()[seen, None]
    of_surface = np.vstack([np.zeros(found.surface.shape[1]), found.surface])[segments.label.ravel()[seen]]
    xy = evidence.cells.centres(seen) + np.array(block.origin)
    return xy, np.hstack([np.where(large, of_surface, 0.0), np.where(large, 0.0, found.cell)])


def sigmoid(odds: Values) -> Values:
    """Probabilities (N,) of log odds."""
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(odds, -CLIP, CLIP))))


def regress(judged: Places, held: Places, start: Values) -> Values:
    """Weights (T,) that fit the verdicts and hold to what was said elsewhere, near `start` (Newton)."""
    terms = np.concatenate([judged.terms, held.terms])
    truth, weight = np.r_[judged.truth, held.truth], np.r_[judged.weight, held.weight]
    found = start.copy()
    for _ in range(30):
        likely = sigmoid(terms @ found)
        slope = terms.T @ (weight * (truth - likely)) - RIDGE * (found - start)
        curve = (terms * (weight * likely * (1 - likely))[:, None]).T @ terms + RIDGE * np.eye(len(start))
        step = np.clip(np.linalg.solve(curve, slope), -2.0, 2.0)
        found = found + step
        if np.abs(step).max() < 1e-4:
            break
    return np.asarray(found)


def leave_one_out(judged: Places, held: Places, start: Values) -> Check:
    """How each verdict is judged by the weights that all others give."""
    odds = np.zeros(len(judged.truth))
    for k in range(len(odds)):
        others = np.arange(len(odds)) != k
        some = Places(judged.terms[others], judged.truth[others], judged.weight[others])
        odds[k] = judged.terms[k] @ regress(some, held, start)
    return compare(odds, judged.terms @ start, judged.truth > 0.5)


def compare(fitted: Values, shipped: Values, truth: NDArray[np.bool_]) -> Check:
    """Two ways to judge (log odds, (N,)) held against the truth."""
    losses = []
    for odds in (fitted, shipped):
        likely = sigmoid(odds)
        losses.append(-np.log(np.where(truth, likely, 1.0 - likely)))
    apart = losses[0] - losses[1]
    error = float(apart.std(ddof=1) / np.sqrt(len(apart))) if len(apart) > 1 else np.inf
    right = int(((fitted > 0) == truth).sum()), int(((shipped > 0) == truth).sum())
    return Check(len(truth), right, (float(losses[0].mean()), float(losses[1].mean())), error)


def check_score(scores: Values, truth: NDArray[np.bool_]) -> tuple[Check | None, tuple[float, float]]:
    """The score's odds shifted and scaled to the verdicts on detected buildings, left out one by one; the
    shift and the scale of all. None where there are too few."""
    if len(truth) < LEAST or min(int(truth.sum()), int((~truth).sum())) < LEAST_EACH:
        return None, (0.0, 1.0)
    clipped = np.clip(scores, 1e-3, 1.0 - 1e-3)
    odds = np.log(clipped / (1.0 - clipped))
    terms, start = np.column_stack([np.ones(len(odds)), odds]), np.array([0.0, 1.0])
    judged = Places(terms, truth.astype(float), np.ones(len(odds)))
    none = Places(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    shift, scale = regress(judged, none, start)
    return leave_one_out(judged, none, start), (float(shift), float(scale))


def scaled(score: ScoreWeights, shift: float, scale: float) -> ScoreWeights:
    """The weights of a score whose odds are shifted and scaled."""
    return ScoreWeights(*rounded_weights(np.array([score.constant * scale + shift, score.odds * scale])))
