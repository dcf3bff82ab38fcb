"""Sums inside kernels to the bit as numpy has them."""

from __future__ import annotations

from eaves.kernels import kernel
from eaves.model import Values


@kernel
def pairwise_sum_kernel(values: Values) -> float:
    """The sum of values (N,), in halves, which keeps more digits: in the order in which numpy adds them."""
    count = len(values)
    if count < 8:
        total = 0.0
        for value in values:
            total += value
        return total
    if count > 128:
        half = count // 2
        half -= half % 8
        return float(pairwise_sum_kernel(values[:half]) + pairwise_sum_kernel(values[half:]))
    part = values[:8].copy()
    whole = count - count % 8
    for one in range(8, whole):
        part[one % 8] += values[one]
    total = ((part[0] + part[1]) + (part[2] + part[3])) + ((part[4] + part[5]) + (part[6] + part[7]))
    for one in range(whole, count):
        total += values[one]
    return float(total)
