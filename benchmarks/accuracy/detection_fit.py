"""The weights of `consensus`, by logistic regression over surfaces and cells of labelled scans.

Run `EAVES_DATA=... python -m benchmarks.accuracy.detection_fit`. Trained on simulated towns of varied
scanners and on the labelled surveys, whole, with few echoes and thinned. Prints the weights of all, and keeps
in `detection_weights.json`, for `unseen`, those fitted with each place and all its variants left out.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.detection import varied_town
from benchmarks.survey_variants import (
    PLACES,
    VARIANTS,
    Survey,
    applies,
    few_echoes,
    judged,
    labelled_surveys,
    no_fields,
    simulated_survey,
)
from eaves.detect.consensus.classifier import CELL_TERMS, FITTED, SURFACE_TERMS, Weights, measured_terms
from eaves.detect.consensus.evidence import Evidence, Segments
from eaves.detect.consensus.method import Consensus
from eaves.ground import classify_ground
from eaves.model import Bounds, Values
from eaves.model.cloud import BUILDING
from eaves.raster.surfaces import make_scene

TRAINED_ON = ("whole", "echoes 15 %", "echoes 0 %", "no return fields", "density 1/4", "density 1/10")
FIRST_SEED, TOWNS = 7400, 24
DENSITIES = (0.3, 0.6, 1.0, 2.0, 4.0, 8.0, 15.0, 30.0)
SHARES = (1.0, 0.5, 0.15, 0.05, 0.0)
ROW_WEIGHT, CELLS_AS_ONE = 100.0, 50.0
"""Every scan counts as its surfaces, but no more than a hundred, and fifty cells as one of them."""
RIDGE = 0.5
"""Precision of the prior of each weight: unit terms move the odds by a factor of four or so."""
ROUNDS = 3
"""The separations depend on the weights: so often both are fitted."""
CELLS_A_ROW = 5_000
KEPT = Path(__file__).with_name("detection_weights.json")


@dataclass(frozen=True, eq=False)
class Row:
    """What one scan teaches: its evidence and what is true of its surfaces (K,) and cells (M,)."""

    place: str
    evidence: Evidence
    segments: Segments
    max_residual: float
    true_surface: Values
    true_cell: Values
    """Shares of candidate points that are building; NaN where none has a known class."""


def row_of(survey: Survey, place: str) -> Row | None:
    """The row of a survey; None where nothing stands."""
    method = Consensus()
    keep = judged(survey)
    cloud, truth = survey.cloud()
    known = np.isin(truth, np.unique(survey.truth[keep]))
    cloud = classify_ground(cloud)
    around = Bounds.of(cloud.xyz)
    bounds = Bounds(*np.floor([around.west, around.south]), *np.ceil([around.east, around.north]))
    scene = make_scene(cloud, bounds)
    candidate = method.candidates(scene)
    if candidate.sum() < 100:
        return None
    _, evidence, segments = method.find_surfaces(scene, candidate)
    chosen = np.flatnonzero(candidate & known)
    cell = evidence.cells.cell[chosen]
    total = np.bincount(cell, minlength=evidence.cells.size).astype(float)
    hits = np.bincount(cell[truth[chosen] == BUILDING], minlength=evidence.cells.size).astype(float)
    label = segments.label.ravel()
    with np.errstate(invalid="ignore"):
        true_surface = (np.bincount(label, hits) / np.bincount(label, total))[1:]
        true_cell = (hits / total).reshape(evidence.shape)
    return Row(place, evidence, segments, method.tolerance(scene.spacing), true_surface, true_cell)


def rows(data: Path) -> Iterator[Row]:
    """The rows of all towns and surveys."""
    for number in range(TOWNS):
        town = varied_town("fit", FIRST_SEED, number, DENSITIES[number % 8])
        survey = few_echoes(simulated_survey(town), SHARES[number % 5])
        found = row_of(no_fields(survey) if number % 6 == 5 else survey, "simulated")
        if found is not None:
            yield found
    for name, read in labelled_surveys(data).items():
        survey = read()
        for variant in TRAINED_ON:
            if applies(variant, survey):
                found = row_of(VARIANTS[variant](survey), PLACES.get(name, name))
                if found is not None:
                    yield found


def regression(terms: Values, truth: Values, weight: Values, prior: Values) -> Values:
    """Weights (T,) of a logistic regression on terms (M, T), with soft truth (M,), by Newton's method.

    Each row counts by its weight (M,); `prior` is the precision of each weight about 0 (T,).
    """
    found = np.zeros(terms.shape[1])
    for _ in range(60):
        likely = 1.0 / (1.0 + np.exp(-(terms @ found)))
        slope = terms.T @ (weight * (truth - likely)) - prior * found
        curve = (terms * (weight * likely * (1 - likely))[:, None]).T @ terms + np.diag(prior)
        step = np.linalg.solve(curve, slope)
        found = found + np.clip(step, -2.0, 2.0)
    return found


def samples(row: Row, weights: Weights) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    """Terms, truth and weight of the surfaces of a row, and of its cells."""
    judged = row.evidence.candidate
    terms = measured_terms(row.evidence, row.segments, judged, row.max_residual, weights, Consensus())
    size = row.segments.area
    use = (size >= 2.0) & np.isfinite(row.true_surface) & (row.segments.tall > 0.1)
    share = np.sqrt(size[use])
    whole = min(ROW_WEIGHT, float(use.sum()))
    surface = [terms.surface[use], row.true_surface[use], whole * share / max(share.sum(), 1.0)]
    truth = row.true_cell[terms.cells]
    chosen = np.flatnonzero(~terms.large[terms.cells] & np.isfinite(truth))
    if len(chosen) > CELLS_A_ROW:
        chosen = np.random.default_rng(0).choice(chosen, CELLS_A_ROW, replace=False)
    whole = min(ROW_WEIGHT, len(chosen) / CELLS_AS_ONE)
    cell = [
        terms.cell[chosen],
        truth[chosen],
        np.full(len(chosen), whole / max(len(chosen), 1)),
    ]
    return surface, cell


def fitted(some: Sequence[Row], start: Weights = FITTED) -> Weights:
    """The weights fitted to some rows."""
    weights = start
    for _ in range(ROUNDS):
        parts = [samples(row, weights) for row in some]
        made = []
        for kind in (0, 1):
            terms, truth, weight = (np.concatenate([part[kind][k] for part in parts]) for k in range(3))
            prior = np.append(1e-3, np.full(terms.shape[1] - 1, RIDGE))
            made.append(tuple(round(float(value), 2) for value in regression(terms, truth, weight, prior)))
        weights = Weights(made[0], made[1])
    return weights


def main() -> None:
    """Print and keep the weights."""
    there = list(rows(Path(os.environ["EAVES_DATA"])))
    kept: dict[str, dict[str, tuple[float, ...]]] = {}
    places = sorted({row.place for row in there} - {"simulated"})
    for place in ["", *places]:
        weights = fitted([row for row in there if row.place != place])
        print(f"without {place}" if place else "all")
        print("  surface", dict(zip(SURFACE_TERMS, weights.surface, strict=True)))
        print("  cell   ", dict(zip(CELL_TERMS, weights.cell, strict=True)), flush=True)
        kept[place or "all"] = {"surface": weights.surface, "cell": weights.cell}
    KEPT.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
