"""The models that an earlier run wrote and that are to stay: their lines, and the walls these tell of."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from eaves.model import Mask
from eaves.reconstruct.toolkit.roof_figures import QUARTERS
from eaves.run.party_wall_areas import PARTY_GAP
from eaves.run.stock import PARTY_WALLS

FIGURES = (PARTY_WALLS, "free_wall_area_m2", *(f"free_wall_{side}_m2" for side in QUARTERS))
"""The attributes that `wall_figures` makes."""


HEAD = re.compile(rb'\{"type":"CityJSONFeature","id":"([^"\\]+)"')
"""How a line begins, of an id that is written as it is."""

WALLS = re.compile(rb",".join(rb'"%s":([-+.\deE]+)' % name.encode() for name in FIGURES))
"""How a line tells of a building's walls."""


def id_of(line: bytes) -> str:
    """The id of a line: of all lines of a town few are decoded."""
    known = HEAD.match(line)
    return known[1].decode() if known else str(json.loads(line)["id"])


def walls_in(line: bytes, name: str) -> dict[str, float] | None:
    """What a building's line tells of its walls; None where nothing."""
    if b'"%s"' % PARTY_WALLS.encode() not in line:
        return None
    if len(found := WALLS.findall(line)) == 1:
        return dict(zip(FIGURES, map(json.loads, found[0]), strict=True))
    told = json.loads(line)["CityObjects"][name]["attributes"]
    return {key: told[key] for key in FIGURES} if PARTY_WALLS in told else None


@dataclass(frozen=True, eq=False)
class EarlierLines:
    """Where in a CityJSONSeq the lines of buildings are that are as they were, and their walls' figures."""

    path: Path
    places: dict[str, tuple[int, int]]
    """Id → first byte of the line, and how many it has."""
    walls: dict[str, dict[str, float] | None]
    disturbed: Sequence[Polygon]
    """Outlines (world metres) of all others, as they were and as they are: walls beside them may differ."""

    @classmethod
    def read(cls, path: Path, changed: Collection[str], disturbed: Sequence[Polygon]) -> EarlierLines:
        """The lines of a file but for those of changed buildings; none where there is no file."""
        places: dict[str, tuple[int, int]] = {}
        walls: dict[str, dict[str, float] | None] = {}
        if path.exists():
            with path.open("rb") as file:
                start = len(file.readline())
                for line in file:
                    name = id_of(line)
                    if name not in changed:
                        places[name] = start, len(line)
                        walls[name] = walls_in(line, name)
                    start += len(line)
        return cls(path, places, walls, disturbed)

    def read_lines(self, names: Sequence[str]) -> list[str | None]:
        """The lines of some buildings; None for those that have none to be used again."""
        lines: list[str | None] = []
        with self.path.open("rb") as file:
            for name in names:
                first, length = self.places.get(name, (0, 0))
                file.seek(first)
                lines.append(file.read(length).decode("utf-8") if length else None)
        return lines

    def holds(self, names: Sequence[str], outlines: NDArray[np.object_]) -> Mask:
        """Of which buildings (N,), with their outlines, the walls are known to be as they were."""
        known = np.array([name in self.places for name in names], bool)
        if len(self.disturbed):
            tree = shapely.STRtree(list(self.disturbed))
            known[np.unique(tree.query(outlines, predicate="dwithin", distance=PARTY_GAP)[0])] = False
        return known
