"""The one error of this package's readers."""

from __future__ import annotations

from pathlib import Path


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
