"""The result of a comparison: the change of each building, and the epochs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from shapely import MultiPolygon, Polygon

from eaves.change.epoch import Epoch
from eaves.change.shift import Shift
from eaves.change.verdict import NOT_COVERED, UNCHANGED, UNCLEAR, Verdict
from eaves.flow import FEWEST, frame_of

if TYPE_CHECKING:
    from geopandas import GeoDataFrame

SEEN_WELL, SURE_SCORE = 0.8, 0.9
"""Share of a roof that the other epoch shows, and the score of what one run alone has: see `certainty`."""


@dataclass(frozen=True, eq=False)
class BuildingChange:
    """The change of one building.

    `id` is the building's name over time: the old epoch's where it was there; `old_ids` and `new_ids` name
    all that stand at its place. `polygon` is its outline, the new epoch's where there is one (world metres).
    """

    id: str
    old_ids: tuple[str, ...]
    new_ids: tuple[str, ...]
    polygon: Polygon | MultiPolygon
    verdict: Verdict
    points: tuple[int, int]
    volumes: tuple[float | None, float | None]
    """Of the models (m³), where the runs know them."""

    @property
    def certainty(self) -> str | None:
        """Certainty of the change, `high`, `medium` or `low`; None where there is none.

        A change rests on the points that show it, on how much of the roof the other epoch shows, and, where
        one run alone has the building, on that run's score. What is unchanged rests on the last two.
        """
        verdict, figures = self.verdict, self.verdict.figures
        if verdict.change in (UNCLEAR, NOT_COVERED):
            return None
        seen, score = figures.get("seen", 1.0), figures.get("score")
        doubted = score is not None and score < SURE_SCORE
        if verdict.change == UNCHANGED:
            seen = min(seen, figures.get("same", 0.0))
        elif sum(map(len, verdict.patches)) < FEWEST:  # of such 3 of 10 were wrong
            return "low"
        return "high" if seen >= SEEN_WELL and not doubted else "medium"

    @property
    def row(self) -> dict[str, Any]:
        """The change as tables show it."""
        verdict = self.verdict
        both = [volume for volume in self.volumes if volume is not None]
        return {
            "id": self.id,
            "change": verdict.change,
            "also": ", ".join(verdict.also) or None,
            "certainty": self.certainty,
            "height_difference_m": round(verdict.height_m, 2),
            "volume_difference_m3": round(verdict.volume_m3, 1),
            "model_volume_difference_m3": round(both[1] - both[0], 1) if len(both) == 2 else None,
            "built_m2": round(verdict.built_m2, 1),
            "gone_m2": round(verdict.gone_m2, 1),
            "moved_m2": round(verdict.moved_m2, 1),
            "points_old": self.points[0],
            "points_new": self.points[1],
            "share_seen": verdict.figures.get("seen"),
            "share_same": verdict.figures.get("same"),
            "ids_old": ", ".join(self.old_ids) or None,
            "ids_new": ", ".join(self.new_ids) or None,
            "area_m2": round(float(self.polygon.area), 2),
            "reason": verdict.reason,
        }


@dataclass(frozen=True, eq=False)
class Comparison:
    """The change of every building of two epochs, and the epochs."""

    old: Epoch
    new: Epoch
    changes: tuple[BuildingChange, ...]
    shift: Shift
    tolerance: float
    """A surface nearer than this (m) counts as the same one."""
    spacings: tuple[float, float]
    """Mean spacings of the points (m)."""

    @property
    def densities(self) -> tuple[float, float]:
        """Points a square metre."""
        return self.spacings[0] ** -2, self.spacings[1] ** -2

    @property
    def table(self) -> GeoDataFrame:
        """One row a building, as changes.gpkg has it, as a geopandas.GeoDataFrame."""
        rows, shapes = [one.row for one in self.changes], [one.polygon for one in self.changes]
        return frame_of(rows, shapes, self.old.system)

    @property
    def counts(self) -> dict[str, int]:
        """Number of buildings that underwent each change."""
        names = [change.verdict.change for change in self.changes]
        return {name: names.count(name) for name in sorted(set(names), key=names.index)}
