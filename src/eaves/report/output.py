"""The page as an output of a run."""

from __future__ import annotations

from pathlib import Path

from eaves.model.summary import Summary
from eaves.report.contents import BUILDINGS_SHOWN, POINTS_SHOWN, read_contents
from eaves.report.page_file import write_page
from eaves.report.sample import PointSample


class Page:
    """The page of a run (`LateOutput`), which draws a sample of the points as they are written."""

    def __init__(self) -> None:
        self.sink = PointSample(POINTS_SHOWN, BUILDINGS_SHOWN)

    def write(self, summary: Summary) -> Path:
        """Write the page of what a run wrote; its path."""
        return write_page(read_contents(summary.folder, received=self.sink), summary.as_text())
