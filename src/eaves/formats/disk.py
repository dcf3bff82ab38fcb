"""A full disk, distinguished from other errors: it ends a run that can be resumed."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

NUMBERS = (errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC))
"""No space left, file too large for the disk or the limit, quota used up."""
PHRASES = (
    *("no space left", "disk is full", "disk full", "write error", "writeerror", "disk quota exceeded"),
    "failed to call write",
)
"""Messages of GDAL, SQLite and lazrs, which give no error number."""


class DiskFullError(OSError):
    """The disk is full. Its text is one line with the place and the remedy."""


def is_full(error: BaseException | None) -> bool:
    """Whether an error, or the one that caused it, means that the disk is full."""
    while error is not None:
        if isinstance(error, DiskFullError) or getattr(error, "errno", None) in NUMBERS:
            return True
        if not isinstance(error, ValueError) and any(phrase in str(error).lower() for phrase in PHRASES):
            return True
        error = error.__cause__ or error.__context__
    return False


@contextmanager
def report_full_disk(folder: Path) -> Iterator[None]:
    """Turn any error that means a full disk into one DiskFullError about `folder`."""
    try:
        yield
    except Exception as error:
        if not is_full(error):
            raise
        raise DiskFullError(
            f"{folder}: the disk is full; nothing is half-written: free space and run again with --resume"
        ) from None
