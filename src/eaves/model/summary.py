"""What a run found and wrote."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Summary:
    """What a run found and wrote. `found` is always `modelled` + `failures`."""

    folder: Path
    points: int
    found: int
    modelled: int
    by_lod: dict[str, int]
    failures: dict[str, int]
    """Buildings without a model, by code."""
    fallbacks: dict[str, int]
    """Buildings with a coarser model than asked for, by code."""
    seconds: dict[str, float]
    elapsed: float
    files: tuple[Path, ...]
    failed: tuple[str, ...] = ()
    """Blocks that could not be computed, with the reason."""
    run: dict[str, Any] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """Whether every block was computed and every file written."""
        return not self.failed

    def as_text(self) -> str:
        """A few lines for the screen."""
        levels = ", ".join(
            f"LoD {lod}: {count} ({100 * count / max(self.found, 1):.1f} %)"
            for lod, count in self.by_lod.items()
        )
        files = self.run.get("files", 1)
        lines = [
            f"{files:,} file{'s' * (files != 1)}, {self.points:,} points, "
            f"{self.found:,} buildings found = {self.modelled:,} modelled "
            f"+ {self.found - self.modelled:,} failed; {levels or 'no models'}"
        ]
        for title, counts in (("failed", self.failures), ("coarser than asked for", self.fallbacks)):
            if counts:
                lines.append(f"{title}: " + ", ".join(f"{code} {n}" for code, n in sorted(counts.items())))
        lines.append(
            f"{self.elapsed:.1f} s, peak {self.run.get('peak_memory_mb', 0)} MB; results in {self.folder}"
        )
        return "\n".join(lines)
