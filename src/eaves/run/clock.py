"""Processor time by stage."""

from __future__ import annotations

import time


class Clock:
    """Seconds spent between laps, by name."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.process_time()

    def lap(self, name: str) -> None:
        """Book the processor time (s) since the last lap under `name`."""
        now = time.process_time()
        self.laps[name] = self.laps.get(name, 0.0) + now - self._last
        self._last = now
