"""Where a result and a reference agree, cell by cell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.model import Mask

TRUE_POSITIVE, FALSE_NEGATIVE, FALSE_POSITIVE, UNKNOWN = 1, 2, 3, 255


def agreement_codes(result: Mask, reference: Mask) -> NDArray[np.uint8]:
    """The code of each cell of a result and a reference (H, W); 0 where neither has anything."""
    codes = [TRUE_POSITIVE, FALSE_NEGATIVE, FALSE_POSITIVE]
    return np.select([result & reference, reference, result], codes).astype(np.uint8)
