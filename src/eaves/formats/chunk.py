"""A run of points as it comes from a file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eaves.model import Mask, Points

FARTHEST = (2e8, 2e8, 1e5)
"""What no coordinate of a survey exceeds, in metres or feet: false eastings with a zone reach 6e7 m."""


@dataclass(frozen=True, eq=False)
class Chunk:
    """N points of one file, in the file's order; every array is (N,) but `xyz` (N, 3).

    `xyz` is in world metres once `source.iter_chunks` hands it out. `position` counts every record of the
    file, also those left out (withheld points, points without coordinates).
    """

    xyz: Points
    position: NDArray[np.int64]
    return_number: NDArray[np.uint8] | None = None
    number_of_returns: NDArray[np.uint8] | None = None
    classification: NDArray[np.uint8] | None = None
    withheld: Mask | None = None

    def __len__(self) -> int:
        return len(self.xyz)

    def take(self, which: Mask) -> Chunk:
        """The points where the mask (N,) is true."""

        def pick(array: NDArray[np.generic] | None) -> NDArray[np.generic] | None:
            return None if array is None else array[which]

        return Chunk(
            self.xyz[which],
            self.position[which],
            pick(self.return_number),  # type: ignore[arg-type]
            pick(self.number_of_returns),  # type: ignore[arg-type]
            pick(self.classification),  # type: ignore[arg-type]
            pick(self.withheld),  # type: ignore[arg-type]
        )
