"""What a format is that runs write on request."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from eaves.formats.errors import require_extra


@dataclass(frozen=True)
class Format:
    """A format in which a run writes its results on request; packages bring others by entry points of the
    group `eaves.formats`.

    Parameters
    ----------
    files : mapping of str to (str, callable)
        What it holds (`models`, `footprints`, `roof_planes`, `points`) → the name of its file in the run's
        folder, and the writer, which is called with the path, the models or rows, the coordinate system and
        `provenance`. Of points the name is the suffix, and the writer is called with the path of the
        classified points, that of the copy, and the system; it returns the number of points.
    beside : sequence of str
        Names of files that a writer makes beside its own.
    point_bytes : int
        Of memory that a point takes while points are written.
    extra : (str, str, str) or None
        The extra that is needed, the library that it installs, and the sentence that says who needs it.

    Examples
    --------
    >>> from eaves.formats import Format
    >>> def write(path, models, system, provenance): ...
    >>> Format({"models": ("buildings.stl", write)}).files["models"][0]
    'buildings.stl'
    """

    files: Mapping[str, tuple[str, Callable[..., object]]]
    beside: tuple[str, ...] = ()
    point_bytes: int = 0
    extra: tuple[str, str, str] | None = None

    def require(self) -> None:
        """Raise `InputError` when the library of its extra is missing."""
        if self.extra is not None:
            require_extra(*self.extra)
