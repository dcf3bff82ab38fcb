"""How far a building can be trusted, and why not, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

HIGH, LOW = 0.9, 0.7
"""Share of the roof that faces with enough support must cover for high, and for medium trust."""

LEAST_SCORE, LEAST_WALL = 0.5, 0.6
"""A lower score of the detection, or certainty of a party wall, is a reason to look."""


DETAILED = "2.2"
"""At this level the whole roof is modelled; why there is no finer one says nothing of the roof."""


def judge(row: Mapping[str, Any]) -> tuple[str, float, str]:
    """The class of trust of a building (high, medium, low), how bad it is (0 to 2), and the reasons in words.

    Examples
    --------
    >>> from eaves.run.trust import judge
    >>> judge({"lod": "2.2", "score": 1.0, "supported_share": 0.8})[0]
    'medium'
    """
    if row.get("lod") in (None, "0") and row.get("failure_code"):
        return "low", 2.0, f"no model: {row.get('failure_reason')}"
    reasons, badness = [], 0.0
    share = row.get("supported_share")
    if share is not None and share < HIGH:
        badness += (1.0 - share) if share >= LOW else 1.0 + (LOW - share)
        reasons.append(f"{1.0 - share:.0%} of the roof is not supported by its points")
    if row.get("failure_code") and str(row.get("lod")) < DETAILED:
        badness += 1.0
        reasons.append(f"coarser than LoD 2.2: {row.get('failure_reason')}")
    if row.get("score", 1.0) < LEAST_SCORE:
        badness += 0.5
        reasons.append(f"detection score {row['score']:.2f}")
    wall = row.get("wall_certainty")
    if wall is not None and wall < LEAST_WALL:
        badness += 0.3
        reasons.append(f"a party wall of certainty {wall:.2f}")
    if row.get("ground_source") in ("interpolated", "nearest ground"):
        badness += 0.3
        far = row.get("ground_distance_m")
        base = "is interpolated" if far is None else f"is that of ground {far} m away"
        reasons.append(f"no ground was seen beside it: its base {base}")
    badness = min(badness, 2.0)
    return ("low" if badness >= 1.0 else "medium" if badness > 0.0 else "high"), badness, "; ".join(reasons)
