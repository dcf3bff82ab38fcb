"""The one error of this package's readers, and that of a library that is missing."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

INSTALL = "pip install '.[{}]'"
"""The command that installs an extra, in the clone that eaves is installed from; no index has it yet."""


class InputError(ValueError):
    """A file cannot be used as it is. Its text is one line: file, broken rule with the value, remedy.

    Examples
    --------
    >>> import eaves
    >>> try:
    ...     eaves.read("missing.laz")
    ... except eaves.InputError as error:
    ...     print("missing.laz" in str(error))
    True
    """

    @classmethod
    def about(cls, path: str | Path, rule: str, remedy: str) -> InputError:
        """The error for a file, on one line whatever the parts hold."""
        return cls(" ".join(f"{path}: {rule}; {remedy}".split()))


def require_extra(extra: str, library: str, need: str) -> None:
    """Raise `InputError` when the library that an extra installs is missing; `need` says who needs it."""
    if find_spec(library) is None:
        raise InputError(f"{need}, which is missing; run: {INSTALL.format(extra)}")


def require_plots() -> None:
    """Raise `InputError` when what draws pictures is missing."""
    require_extra("plots", "matplotlib", "pictures need matplotlib")
