"""A run of points as it comes from a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.model import Integers, Mask, Points, Values

FARTHEST = (2e8, 2e8, 1e5)
"""The largest coordinates of any survey, in metres or feet: false eastings with a zone reach 6e7 m."""


@dataclass(frozen=True, eq=False)
class Chunk:
    """N points of one file, in the file's order.

    Parameters
    ----------
    xyz : ndarray (N, 3) of float64
        World metres once `iter_chunks` returns it.
    position : ndarray (N,) of int64
        Number of each record in the file, records that are left out counted too.
    return_number, number_of_returns, classification : ndarray (N,) of uint8 or None
        The dimensions of these names, where the file has them.
    withheld : ndarray (N,) of bool or None
        Points that the file flags as withheld.
    moment : ndarray (N,) of uint16 or None
        Digest of the time of each pulse, where the file has times: points of one time have the same.
    fields : mapping of str to ndarray (N,) of float64
        The other fields that were asked for.

    Examples
    --------
    >>> import numpy as np
    >>> from eaves.formats import Chunk
    >>> len(Chunk(np.zeros((3, 3)), np.arange(3)))
    3
    """

    xyz: Points
    position: Integers
    return_number: NDArray[np.uint8] | None = None
    number_of_returns: NDArray[np.uint8] | None = None
    classification: NDArray[np.uint8] | None = None
    withheld: Mask | None = None
    moment: NDArray[np.uint16] | None = None
    fields: Mapping[str, Values] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.xyz)

    def take(self, which: Mask) -> Chunk:
        """The points where the mask (N,) is true."""
        fields = {name: values[which] for name, values in self.fields.items()}
        arrays: dict[str, Any] = {
            name: one if one is None else one[which] for name, one in vars(self).items() if name != "fields"
        }
        return Chunk(**arrays, fields=fields)
