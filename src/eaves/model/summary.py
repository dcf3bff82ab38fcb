"""The summary of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

from eaves.model.coordinates import describe_units


class IncompleteRunError(RuntimeError):
    """A part of a run could not be computed; what could is there, and in `results`.

    Parameters
    ----------
    failed : sequence of str
        What is missing, with the reason, a line each.
    results : Summary, Updated or ModelledBuildings
        What the function would have returned.

    Examples
    --------
    >>> import eaves
    >>> try:
    ...     results = eaves.build("tile.laz", "out")                      # doctest: +SKIP
    ... except eaves.IncompleteRunError as error:
    ...     results = error.results
    """

    def __init__(self, failed: Sequence[str], results: Any) -> None:
        super().__init__(failed, results)
        self.failed, self.results = tuple(failed), results

    def __str__(self) -> str:
        more = f" ({len(self.failed)} such in all)" if len(self.failed) > 1 else ""
        return f"{self.failed[0]}{more}; the rest is in `results`: pass allow_failures=True to go on with it"


@dataclass(frozen=True)
class Summary:
    """The numbers and files of a run. `found` is always `modelled` plus the failures.

    Parameters
    ----------
    folder : Path
        Folder of the outputs.
    points, found, modelled : int
        Numbers of points of the inputs, of buildings, and of buildings with a model.
    by_lod, failures, fallbacks : dict of str to int
        Models by level of detail; buildings without a model, and with a coarser one than asked for, by code.
    seconds : dict of str to float
        Processor time (s) of each stage, over all processes.
    elapsed : float
        Time (s) from start to end.
    files : tuple of Path
        The files written.
    failed : tuple of str
        Inputs and blocks that could not be used, with the reason.
    run : dict
        The content of run.json.
    wall : dict of str to float
        Time on the clock (s) of each step, where it was measured.
    points_used : int or None
        Points within bounds and clip area that are not withheld; 0 is an empty result.
    trust : dict of str to int
        Buildings by trust: high, medium, low; those without a model are low.

    Examples
    --------
    >>> from pathlib import Path
    >>> from eaves import Summary
    >>> Summary(Path("out"), 1000, 2, 2, {"2.2": 2}, {}, {}, {}, 1.5, ()).complete
    True
    """

    folder: Path
    points: int
    found: int
    modelled: int
    by_lod: dict[str, int]
    failures: dict[str, int]
    fallbacks: dict[str, int]
    seconds: dict[str, float]
    elapsed: float
    files: tuple[Path, ...]
    failed: tuple[str, ...] = ()
    run: dict[str, Any] = field(default_factory=dict)
    wall: dict[str, float] = field(default_factory=dict)
    points_used: int | None = None
    trust: dict[str, int] = field(default_factory=dict)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the user must know of these inputs, as run.json says it."""
        return tuple(self.run.get("remarks", ()))

    @property
    def complete(self) -> bool:
        """True if every block was computed and every file written."""
        return not self.failed

    def checked(self, allow_failures: bool = False) -> Self:
        """The summary itself; `IncompleteRunError` when something is missing, unless that is allowed."""
        if self.failed and not allow_failures:
            raise IncompleteRunError(self.failed, self)
        return self

    def missing(self, allow_empty: bool = False, strict: bool = False) -> list[str]:
        """What was asked for and is not there, a line each: with one a command ends with status 1.

        Parameters
        ----------
        allow_empty
            No point in the area is what was asked for.
        strict
            A model of every building was.
        """
        lines = [f"incomplete: {reason}" for reason in self.failed]
        if self.points_used == 0 and not allow_empty:
            lines.append(
                f"empty: none of {self.points:,} points is used: see --bounds, --clip, or add --allow-empty"
            )
        failed = self.found - self.modelled
        broken = self.run.get("footprints") or "internal_error" in self.failures
        if failed and (strict or (not self.modelled and broken)):
            codes = ", ".join(f"{code} {count}" for code, count in sorted(self.failures.items()))
            lines.append(
                f"no model: {failed:,} of {self.found:,} footprints failed ({codes}); failure_reason in "
                "footprints.gpkg says why"
            )
        return lines

    def with_step(self, name: str, cpu: float, wall: float) -> Summary:
        """The same with one more step: its processor time and its time on the clock (s)."""
        return replace(
            self,
            seconds={**self.seconds, name: round(cpu, 3)},
            wall={**self.wall, name: round(wall, 3)},
        )

    def profile(self) -> str:
        """Table of where the time went: processor time by stage, and time on the clock by step."""
        total = sum(self.seconds.values()) or 1.0
        rows = [
            f"{name:<22}{cpu:>8.2f} s {100 * cpu / total:>5.1f} %"
            for name, cpu in sorted(self.seconds.items(), key=lambda item: -item[1])
        ]
        lines = ["processor time", *rows, f"{'together':<22}{total:>8.2f} s"]
        if self.points:
            lines.append(f"{'a million points':<22}{1e6 * total / self.points:>8.2f} s")
        if self.wall:
            lines += ["on the clock", *(f"{name:<22}{wall:>8.2f} s" for name, wall in self.wall.items())]
        return "\n".join(lines)

    def as_text(self) -> str:
        """A few lines for the screen."""
        levels = ", ".join(
            f"LoD {lod}: {count} ({100 * count / max(self.found, 1):.1f} %)"
            for lod, count in self.by_lod.items()
        )
        files = self.run.get("files", 1)
        of_all = "" if self.points_used in (None, self.points) else f"{self.points_used:,} of "
        inputs = f"{files:,} file{'s' * (files != 1)}, {of_all}{self.points:,} points"
        methods = self.run.get("methods")
        if methods is not None and methods.get("detect") is None:  # of buildings nothing was asked
            return f"{inputs}, ground and noise classified\n{self._ending()}"
        many = f"{self.found:,} building{'s' * (self.found != 1)}"
        lines = [
            f"{inputs}, "
            f"{many} found = {self.modelled:,} modelled "
            f"+ {self.found - self.modelled:,} failed; {levels or 'no models'}"
        ]
        for title, counts in (("failed", self.failures), ("coarser than asked for", self.fallbacks)):
            if counts:
                lines.append(f"{title}: " + ", ".join(f"{code} {n}" for code, n in sorted(counts.items())))
        if self.trust:
            high, medium, low = (self.trust.get(name, 0) for name in ("high", "medium", "low"))
            manual = self.trust.get("manual", 0)
            edited = f", manual {manual:,}" if manual else ""
            lines.append(f"{many}: trust high {high:,}, medium {medium:,}, low {low:,}{edited}")
        return "\n".join([*lines, self._ending()])

    def _ending(self) -> str:
        units = describe_units(self.run.get("units", {}))
        reference, said = self.run.get("reference"), [f"note: {remark}" for remark in self.remarks]
        if reference:
            told = "system {system}, plane in {plane}, heights in {heights}".format_map(reference)
            said.insert(0, told)
        return "\n".join([*self._doubts(), *([units] if units else []), *said, self._last_line()])

    def _doubts(self) -> list[str]:
        """Number of places the scan left undecided, and the file that lists them; empty for none."""
        doubts = self.run.get("doubts") or {}
        if not doubts.get("count"):
            return []
        if doubts["see"]:
            return [f"doubts: {doubts['count']:,} of {len(doubts['kinds'])} kinds, see {doubts['see']}"]
        largest = doubts["kinds"][0]  # no file lists them
        return [
            f"doubts: {doubts['count']:,}, the largest at {largest['x']:.1f}, {largest['y']:.1f}: "
            + largest["reason"]
        ]

    def _last_line(self) -> str:
        remote, network = self.run.get("remote"), ""
        if remote:
            read, total = (remote[name] / 1e6 for name in ("bytes_read", "bytes"))
            network = f"; {read:.1f} of {total:.1f} MB read over the network"
        memory = self.run.get("peak_memory_mb", 0)
        return f"{self.elapsed:.1f} s, peak {memory} MB; results in {self.folder}{network}"
