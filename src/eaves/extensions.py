"""What installed packages bring, by entry points: methods, systems, formats, outputs, commands, checks.

The satellites of this distribution (`exports`, `change`, `solar`, `evaluate`, `simulate`) are brought the
same way, and nothing of the core names them.
"""

from __future__ import annotations

import sys
from functools import lru_cache
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any

METHODS, SOURCES = "eaves.methods", "eaves.sources"
FORMATS, COMMANDS, CHECKS = "eaves.formats", "eaves.commands", "eaves.checks"
OUTPUTS = "eaves.outputs"
"""The groups of entry points."""


def installed(group: str) -> dict[str, str]:
    """The things that installed packages bring in a group of entry points.

    Parameters
    ----------
    group : str
        `eaves.methods` (names `stage.name`), `eaves.sources`, `eaves.formats`, `eaves.outputs`,
        `eaves.commands` or `eaves.checks`.

    Returns
    -------
    dict of str to str
        Name → `module:attribute`, in the order of the names; nothing is imported.

    Raises
    ------
    ValueError
        When two packages bring things of one name.

    Examples
    --------
    >>> from eaves.extensions import installed
    >>> "solar" in installed("eaves.commands")
    True
    """
    return dict(_installed(group, tuple(sys.path)))


@lru_cache
def _installed(group: str, path: tuple[str, ...]) -> dict[str, str]:
    places: dict[str, str] = {}
    for point in sorted(entry_points(group=group), key=lambda point: point.name):
        if places.setdefault(point.name, point.value) != point.value:
            what = " method ".join(point.name.split(".")) if group == METHODS else point.name
            raise ValueError(
                f"{what} is in two packages, as {places[point.name]} and {point.value}; "
                "write module:Class, or uninstall one"
            )
    return places


def imported(place: str) -> Any:
    """The object at `module:attribute`.

    Parameters
    ----------
    place : str
        Where it is.

    Returns
    -------
    object
        The object.

    Raises
    ------
    ValueError
        When it cannot be imported, in one line.

    Examples
    --------
    >>> from eaves.extensions import imported
    >>> imported("math:pi")
    3.141592653589793
    """
    module, _, name = place.partition(":")
    try:
        return getattr(import_module(module), name)
    except Exception as error:  # whatever a module raises as it is imported
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise ValueError(
            f"{place!r} cannot be imported ({reason}); write module:Class of a module on Python's path"
        ) from error
