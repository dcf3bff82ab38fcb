"""Roof wireframes against reference wireframes: corners and edges, as in Building3D [wang2023].

Run `python -m benchmarks.wireframes.scores RESULT REFERENCE`, each an OBJ file or a folder of them.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from eaves.evaluate.matching import Agreement, ratio
from eaves.evaluate.report import Evaluation
from eaves.formats import InputError
from eaves.model import Points
from eaves.model.checks import check_positive

CORNER_RADIUS = 1.0
"""Corners this near (m) or nearer are the same one."""


@dataclass(frozen=True, eq=False)
class Wireframe:
    """Corners (V, 3) in metres and edges (E, 2) between them."""

    corners: Points
    edges: NDArray[np.int64]


NOTHING = Wireframe(np.zeros((0, 3)), np.zeros((0, 2), np.int64))
"""The wireframe of a roof that was not found."""


@dataclass(frozen=True)
class WireframeScore:
    """Scores of a wireframe.

    Parameters
    ----------
    corners, edges : Agreement
        By number of corners and of edges.
    corner_offset_m : float
        Mean distance (m) of the paired corners; NaN without any.

    Examples
    --------
    >>> from benchmarks.wireframes.scores import WireframeScore
    >>> from eaves.evaluate import Agreement
    >>> WireframeScore(Agreement(4, 4, 4, 5), Agreement(4, 4, 4, 6), 0.1).corners.correctness
    0.8
    """

    corners: Agreement
    edges: Agreement
    corner_offset_m: float


def evaluate_wireframe(
    result: Wireframe, reference: Wireframe, radius: float = CORNER_RADIUS
) -> WireframeScore:
    """Scores of a wireframe.

    Corners are paired one to one by least total distance; an edge is found when both its corners are paired
    and the reference joins them.

    Parameters
    ----------
    result, reference : Wireframe
        Corners (V, 3) in metres of one system, and edges (E, 2) between them.
    radius : float
        Largest distance (m, > 0) of a pair of corners.

    Returns
    -------
    WireframeScore
        Agreement of corners and edges, and the mean distance of the pairs.

    Raises
    ------
    TypeError
        When `radius` is no number.
    ValueError
        When `radius` is not above 0.

    Examples
    --------
    >>> import numpy as np
    >>> from benchmarks.wireframes.scores import Wireframe, evaluate_wireframe
    >>> corners = np.array([[0.0, 0, 5], [10, 0, 5], [10, 8, 5]])
    >>> edges = np.array([[0, 1], [1, 2]])
    >>> score = evaluate_wireframe(Wireframe(corners + 0.1, edges), Wireframe(corners, edges))
    >>> score.corners.completeness, round(score.corner_offset_m, 2)
    (1.0, 0.17)
    """
    check_positive(radius, "radius")
    distance = cdist(result.corners, reference.corners)
    cost = np.where(distance <= radius, distance, 1e6)
    one, two = linear_sum_assignment(cost)
    good = distance[one, two] <= radius
    one, two = one[good], two[good]
    partner = np.full(len(result.corners), -1)
    partner[one] = two
    known = {frozenset(edge) for edge in reference.edges.tolist()}
    joined = partner[result.edges.reshape(-1, 2)]
    drawn = {frozenset(edge) for edge in joined.tolist() if min(edge) >= 0}
    shared = len(known & drawn)
    offsets = distance[one, two]
    return WireframeScore(
        Agreement(len(one), len(reference.corners), len(one), len(result.corners)),
        Agreement(shared, len(reference.edges), shared, len(result.edges)),
        ratio(float(offsets.sum()), len(offsets)),
    )


def sum_scores(scores: Sequence[WireframeScore]) -> WireframeScore:
    """The score of many roofs together, every corner and edge counted alike.

    Parameters
    ----------
    scores : sequence of WireframeScore
        One of each roof.

    Returns
    -------
    WireframeScore
        The counts added, and the mean offset of all corners that are the same.

    Examples
    --------
    >>> import numpy as np
    >>> from benchmarks.wireframes.scores import Wireframe, evaluate_wireframe, sum_scores
    >>> roof = Wireframe(np.array([[0.0, 0, 5], [10, 0, 5]]), np.array([[0, 1]]))
    >>> sum_scores([evaluate_wireframe(roof, roof)] * 3).corners.f1
    1.0
    """

    def added(agreements: Sequence[Agreement]) -> Agreement:
        return Agreement(*(sum(counts) for counts in zip(*map(astuple, agreements), strict=True)))

    offsets = [score.corner_offset_m * score.corners.found for score in scores if score.corners.found]
    corners = added([score.corners for score in scores])
    return WireframeScore(
        corners, added([score.edges for score in scores]), ratio(float(sum(offsets)), corners.found)
    )


def figures_of(score: WireframeScore) -> dict[str, float]:
    """Building3D's measures, by name."""
    figures = {"mean offset of corners (m)": score.corner_offset_m}
    for name, agreement in (("corners", score.corners), ("edges", score.edges)):
        figures |= {
            f"{name}, precision": agreement.correctness,
            f"{name}, recall": agreement.completeness,
            f"{name}, F1": agreement.f1,
        }
    return figures


def read_wireframe(path: str | Path) -> Wireframe:
    """The corners and edges of an OBJ file: its `v` and `l` lines, and the sides of its `f` faces."""
    corners: list[list[float]] = []
    edges: set[tuple[int, int]] = set()
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
        for line in lines:
            kind, *words = line.split() or [""]
            if kind == "v":
                corners.append([float(word) for word in words[:3]])
            elif kind in ("l", "f"):
                numbers = [int(word.split("/")[0]) for word in words]
                chain = [n - 1 if n > 0 else len(corners) + n for n in numbers]
                ends = chain[1:] + (chain[:1] if kind == "f" else [])
                edges |= {(min(pair), max(pair)) for pair in zip(chain, ends, strict=False)}
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise InputError.about(
            path, f"is no OBJ wireframe ({error})", "give a file of v and l lines"
        ) from None
    if not corners or any(not 0 <= number < len(corners) for edge in edges for number in edge):
        raise InputError.about(path, "names corners it does not have", "give a file of v and l lines")
    return Wireframe(np.array(corners), np.array(sorted(edges), np.int64).reshape(-1, 2))


def compare_wireframes(result: Path, reference: Path) -> Evaluation:
    """Roof wireframes against others by Building3D's measures: one OBJ file against one, or the files of a
    folder against those of the same name in another.

    Parameters
    ----------
    result, reference : Path
        OBJ files or folders of them. A file of the reference without one in the result is a roof with nothing
        found.

    Returns
    -------
    Evaluation
        The measures over all corners and edges, and a row for each file.

    Raises
    ------
    InputError
        For a file that is no wireframe, and a folder without any.

    Examples
    --------
    >>> from pathlib import Path
    >>> from benchmarks.wireframes.scores import compare_wireframes
    >>> _ = Path("roof.obj").write_text("v 0 0 5\\nv 9 0 5\\nl 1 2\\n")
    >>> compare_wireframes(Path("roof.obj"), Path("roof.obj")).figures["corners, F1"]
    1.0
    """
    pairs = [(result, reference)]
    if reference.is_dir():
        if not result.is_dir():
            raise InputError.about(result, "is no folder", "give a folder of wireframes, as the reference is")
        pairs = [(result / path.name, path) for path in sorted(reference.glob("*.obj"))]
        if not pairs:
            raise InputError.about(reference, "holds no wireframe", "give a folder of .obj files")
    for path in (path for pair in pairs for path in pair):
        if path.suffix.lower() != ".obj":
            raise InputError.about(path, "is no wireframe", "compare OBJ with OBJ")
    scores, rows = [], []
    for drawn, true in pairs:
        found = read_wireframe(drawn) if drawn.exists() or len(pairs) == 1 else NOTHING
        score = evaluate_wireframe(found, read_wireframe(true))
        scores.append(score)
        rows.append({"roof": true.stem, **figures_of(score)})
    figures = {"roofs": len(pairs), **figures_of(sum_scores(scores))}
    return Evaluation("wireframe", str(result), str(reference), figures=figures, rows=tuple(rows))


if __name__ == "__main__":
    print(compare_wireframes(Path(sys.argv[1]), Path(sys.argv[2])).as_text())
