"""The command line. What commands of other packages share is here; entry points of the group `eaves.commands`
name them."""

from eaves.cli.runs import (
    COMPLETE,
    INCOMPLETE,
    Basemap,
    Crs,
    Jobs,
    Out,
    Quiet,
    Verbose,
    progress_display,
    run_display,
    start_log,
    start_run_log,
)

__all__ = [
    "COMPLETE",
    "INCOMPLETE",
    "Basemap",
    "Crs",
    "Jobs",
    "Out",
    "Quiet",
    "Verbose",
    "progress_display",
    "run_display",
    "start_log",
    "start_run_log",
]
