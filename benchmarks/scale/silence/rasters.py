"""None drawn yet."""

from benchmarks.scale.silence import Variant


def variants() -> list[Variant]:
    """The variants of this kind."""
    return []
