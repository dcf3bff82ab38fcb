"""How far a building can be trusted, and why not, in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

HIGH, LOW = 0.9, 0.6
"""Least probability that a building is right for high, and for medium trust."""

WEIGHTS = {"one": 1.56, "error": -0.6, "empty": -1.41, "sparse": -1.06, "score": -0.41, "small": -1.2}
"""Of the traits in the log-odds that a building is right; from `python -m benchmarks.accuracy.trust`."""

LEAST_ERROR_M, MOST_ERROR_M = 0.03, 2.0
"""The RMSE counts within these: less is noise, more is no roof."""

ENOUGH = 8.0
"""Points per m² of which more say no more."""

LEAST_SCORE = 0.01
"""Detection scores count down to this and up to as much below 1."""

LARGE_M2 = 60.0
"""Of a larger building the rim, where an outline errs, is a small share of the plan."""

DETAILED = "2.2"
"""At this level the whole roof is modelled; why there is no finer one says nothing of the roof."""

LEAST_LOSS = 0.7
"""Log-odds that a trait must cost to be a reason: half of the odds."""

SEEN_FROM_AFAR = ("interpolated", "nearest ground")
"""Sources of a base that no ground beside the building shows."""


def trust_traits(row: Mapping[str, Any]) -> NDArray[np.float64]:
    """The traits (6,) that `WEIGHTS` weigh: 1, logarithm of the RMSE of the best 95 % over that of noise,
    share without data, logarithms of how sparse the points are, of the odds against the detection, and of
    how small the building is.
    """
    error, density, area = row.get("rmse95_m"), row.get("density"), row.get("area_m2")
    score = float(np.clip(row.get("score", 1.0), LEAST_SCORE, 1.0 - LEAST_SCORE))
    return np.array(
        [
            1.0,
            0.0 if error is None else np.log(np.clip(error, LEAST_ERROR_M, MOST_ERROR_M) / LEAST_ERROR_M),
            row.get("share_no_data") or 0.0,
            0.0 if not density else max(float(np.log(ENOUGH / density)), 0.0),
            float(np.log((1.0 - score) / score)),
            0.0 if not area else max(float(np.log(LARGE_M2 / area)), 0.0),
        ]
    )


def judge(row: Mapping[str, Any]) -> tuple[str, float, str]:
    """The class of trust of a building (high, medium, low), how likely it is wrong (0 to 1), and the reasons
    in words.

    Right is a building of which nine tenths of the plan lie within 0.2 m of the true roof. What towns of
    which everything is known do not show lowers the class by itself: a roof that its points do not support,
    a coarser model, an uncertain party wall, a base that no ground beside the building shows.

    Examples
    --------
    >>> from eaves.buildings.trust import judge
    >>> judge({"lod": "2.2", "score": 1.0, "supported_share": 0.3})[0]
    'low'
    """
    if row.get("lod") in (None, "0") and row.get("failure_code"):
        return "low", 1.0, f"no model: {row.get('failure_reason')}"
    gains = dict(zip(WEIGHTS, (trust_traits(row) * np.array(list(WEIGHTS.values()))).tolist(), strict=True))
    badness = float(1.0 / (1.0 + np.exp(sum(gains.values()))))
    reasons = []
    supported = row.get("supported_share")
    if supported is not None and supported < HIGH:
        badness = max(badness, 1.0 - supported)
        reasons.append(f"{1.0 - supported:.0%} of the roof is not supported by its points")
    seen = [name for name, gain in gains.items() if name in WORDS and gain <= -LEAST_LOSS]
    reasons += [WORDS[name].format(**row) for name in sorted(seen, key=lambda name: gains[name])]
    others = list(doubts_of(row))
    if others:
        badness = max(badness, 1.0 - 0.5 * (HIGH + LOW))
    trust = "high" if 1.0 - badness >= HIGH else "medium" if 1.0 - badness >= LOW else "low"
    return trust, badness, "; ".join([*reasons, *others] or [SMALL_DOUBTS] * (trust != "high"))


WORDS = {
    "error": "its points lie {rmse95_m:.2f} m from the roof (RMSE)",
    "empty": "{share_no_data:.0%} of its plan has no points",
    "sparse": "{density:.1f} points/m²",
    "small": "only {area_m2:.0f} m²: its rim is much of it",
    "score": "detection score {score:.2f}",
}
"""The fault that a trait shows, in words."""

SMALL_DOUBTS = "no single reason: error, points without data and detection together"


def doubts_of(row: Mapping[str, Any]) -> Iterator[str]:
    """The reasons that lower the trust by themselves, in words."""
    if row.get("failure_code") and str(row.get("lod")) < DETAILED:
        yield f"coarser than LoD 2.2: {row.get('failure_reason')}"
    wall = row.get("wall_certainty")
    if wall is not None and wall < LOW:
        yield f"a party wall of certainty {wall:.2f}"
    if row.get("ground_source") in SEEN_FROM_AFAR:
        far = row.get("ground_distance_m")
        base = "is interpolated" if far is None else f"is that of ground {far} m away"
        yield f"no ground was seen beside it: its base {base}"
