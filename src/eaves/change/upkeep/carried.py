"""The edits of a run's folder carried to a new build of the same inputs: matched by id, else by place."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from eaves.buildings.building_file import Kept
from eaves.change.edits import Edit, write_edits
from eaves.change.upkeep.corrected import correct, kept_edits
from eaves.flow.collisions import EDITS
from eaves.flow.run import Run
from eaves.flow.step import Region
from eaves.model import Block

log = logging.getLogger("eaves")


@dataclass(frozen=True)
class CarriedEdits:
    """The edits that a build finds in its folder."""

    run: Run
    edits: Sequence[Edit]

    @classmethod
    def of(cls, run: Run) -> Self:
        """Those in the folder of a run."""
        return cls(run, kept_edits(run.folder, run.index.system))

    def correct(self, region: Region, owners: list[Block]) -> list[Block]:
        """Carry them out on the buildings of a region, which `owners` own, and say of each that gave nothing
        why; the blocks that own buildings then."""
        corrected = correct(region, self.edits)
        log.info("%d edits of an earlier run are carried over", len(self.edits))
        for words in (*corrected.conflicts, *corrected.failed):
            log.warning("edit: %s", words)
        return Kept(region.store).owners(region.run.side)

    def keep(self) -> Path:
        """Write the file of the edits again, as those of this build; its path."""
        path = self.run.folder / EDITS
        write_edits(path, self.edits, self.run.index.system)
        return path
