"""Processor time by stage, and wall time by step."""

from __future__ import annotations

import time
from collections.abc import Mapping


class Clock:
    """Seconds spent between laps, by name."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.process_time()

    def lap(self, name: str) -> None:
        """Book the processor time (s) since the last lap under `name`."""
        before = self._last
        self.skip()
        self.laps[name] = self.laps.get(name, 0.0) + self._last - before

    def skip(self) -> None:
        """Book the time since the last lap nowhere: others have."""
        self._last = time.process_time()


BLOCK_STAGES = ("ground", "rasters", "detect")
"""The stages that a block's clock books; the rest of its task is its points read and its part written."""


class Budget:
    """Time of a region: processor time of all its tasks, wall time of its steps.

    The stages book their own time where they run (`Clock`); the rest of a task is its reading and writing.
    """

    def __init__(self) -> None:
        self.cpu: dict[str, float] = {}
        self.wall: dict[str, float] = {}
        self._last = time.perf_counter()

    def add(self, name: str, seconds: float) -> None:
        """Book processor time (s) of a task under the name of its step."""
        self.cpu[name] = self.cpu.get(name, 0.0) + seconds

    def step(self, name: str) -> None:
        """Book the wall time (s) since the last step under `name`."""
        now = time.perf_counter()
        self.wall[name] = round(self.wall.get(name, 0.0) + now - self._last, 3)
        self._last = now

    def with_stages(self, stages: Mapping[str, float]) -> dict[str, float]:
        """Processor time (s) by stage; `stages` is what was booked inside the tasks."""
        inside = {"blocks": 0.0, "buildings": 0.0}
        for name, seconds in stages.items():
            inside["blocks" if name in BLOCK_STAGES else "buildings"] += seconds
        parts: dict[str, float] = {}
        for name, seconds in self.cpu.items():
            if name not in inside:
                parts[name] = seconds
            else:  # parts kept from an earlier run have stages, and no task of this one
                parts[f"{name}, in and out"] = max(seconds - inside[name], 0.0)
        return {name: round(seconds, 3) for name, seconds in {**stages, **parts}.items()}
