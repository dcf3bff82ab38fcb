"""A step as a value, and the engine: units, keys, loading, saving and the order of work of every step.

A step is declared once, in `eaves.flow.steps`. Its functions get loaded values and the parameters that it
declares; they see no store, key or path. A reach is applied here alone.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn

from numpy.typing import NDArray

from eaves.blocks.seams import Heights
from eaves.flow.refusals import copies_records
from eaves.flow.run import Progress, Run, no_progress
from eaves.formats import InputError
from eaves.formats.whole_files import DiskFullError
from eaves.model import Block, Bounds, Failure, Footprint
from eaves.run.clock import Budget
from eaves.run.keys import HOME, code_digest, code_of_methods, key_of
from eaves.run.part_file import as_arrays, load_part
from eaves.run.partition import PartFacts
from eaves.run.points import load_window
from eaves.run.store import Store
from eaves.run.workers import Outcome, Workers, peak_memory_mb
from eaves.run.world_squares import ring, squares_of

log = logging.getLogger("eaves")


@dataclass(frozen=True, eq=False)
class Input:
    """Input of a step: the results of another one, or the points.

    Parameters
    ----------
    source : Step or None
        The step whose results are taken; None for the points.
    reach : str or None
        Parameter with the width (m) of the surroundings of a unit within which they are taken.
    rings : int
        Number of rings of blocks around a unit, where no reach is given.
    load : callable or None
        Reads a block's points from the store; None for those within the reach as one cloud.
    ids : bool
        True if points come with their ids.
    """

    source: Step | None = None
    reach: str | None = None
    rings: int = 0
    load: Callable[[Store, Block], Any] | None = None
    ids: bool = True


@dataclass(frozen=True, eq=False)
class Step:
    """A step whose results are kept.

    Parameters
    ----------
    name : str
        Of the folder of its results.
    code : tuple of str
        The folders and files of this package that it can run, but for those of the methods it is given.
    takes : tuple of Input
        All that its functions are given beside parameters.
    inputs_of : callable
        `inputs_of(unit, *loaded, parameters)`: exactly what the result follows from. Parameters are typed as
        the recipe of which they are the part that is declared.
    run : callable
        `run(seen, parameters)`: the result, a value or arrays by name.
    load : callable or None
        `load(path, square, read_points)`: a result that is opened, and read as the steps that take it need
        it, with the points of its square.
    reads : tuple of str
        Parameters: attributes of the recipe, options, or facts of the run.
    side : float or None
        Side (m) of its squares; None for blocks.
    needs : str
        The step is left out where this attribute of the recipe is false.
    isolated : bool
        True if blocks with isolated points alone are units, too.
    writes : callable or None
        `writes(store, unit)`: takes the points that `run` puts into blocks beside its result.
    earlier : callable or None
        `earlier(path)`: an earlier result of the same code and parameters, which `run` is given, too.
    booked : str
        The name under which its time is booked.
    shown : str
        The name under which its progress is shown; empty if it is not.
    persistent : bool
        True if a run by tiles keeps its results of finished tiles.
    """

    name: str
    code: tuple[str, ...]
    takes: tuple[Input, ...]
    inputs_of: Callable[..., Any]
    run: Callable[..., Any]
    load: Callable[[Path, Block, Callable[[Block], NDArray[Any]]], Any] | None = None
    reads: tuple[str, ...] = ()
    side: float | None = None
    needs: str = ""
    isolated: bool = False
    writes: Callable[[Store, Any], Any] | None = None
    earlier: Callable[[Path], Any] | None = None
    booked: str = "blocks"
    shown: str = ""
    persistent: bool = False

    def result(self, store: Store, square: Any) -> Any:
        """Its result in a square, or of another unit, as the steps that take it are given it."""
        path = store.path(self.name, square)
        if self.load is not None:
            return self.load(path, square, store.read_points)
        return load_part(path)

    def within(self, reach: str) -> Input:
        """Its results within the reach that a parameter names."""
        return Input(self, reach)

    def around(self, rings: int) -> Input:
        """Its results in the unit and in rings of blocks around it."""
        return Input(self, rings=rings)

    def parameters(self, run: Run) -> SimpleNamespace:
        """The parameters that it declares, and the reference system."""
        return SimpleNamespace(system=run.index.system, **{name: parameter(run, name) for name in self.reads})

    def key(self, run: Run, folder: Path = HOME) -> str:
        """The key of its code with that of the methods it is given, its parameters, the reference system and
        its reaches; the code lies in a `folder`, that of this package unless another is given."""
        values = list(vars(self.parameters(run)).values())
        reaches = [parameter(run, entry.reach) for entry in self.takes if entry.reach]
        methods = [list(code_of_methods(value, folder)) for value in values]
        return key_of(self.name, code_digest(self.code, folder), methods, values, reaches)


@dataclass(frozen=True, eq=False)
class GivenFootprints:
    """Given footprints (world metres), and the ones that cannot be modelled."""

    footprints: Sequence[Footprint] = ()
    lost: Sequence[Failure] = ()


@dataclass(frozen=True)
class TileRecord:
    """Record of a finished tile, or of a whole run that has one tile."""

    owners: tuple[Block, ...]
    blocks: tuple[Block, ...]
    """Blocks that the outputs cover."""
    points: int = 0
    read: tuple[Bounds, ...] = ()
    """Extents of everything that was read for it (world metres)."""


@dataclass(eq=False)
class Region:
    """A run's points, and what is noted as they go through the steps."""

    run: Run
    store: Store
    workers: Workers = field(default_factory=Workers)
    progress: Progress = no_progress
    failed: list[str] = field(default_factory=list)
    peak: float = field(default_factory=peak_memory_mb)
    budget: Budget = field(default_factory=Budget)
    wrong_boxes: dict[int, Bounds] = field(default_factory=dict)
    points: int = 0
    """Of the inputs, without those that could not be read."""
    unread: dict[int, str] = field(default_factory=dict)
    """Inputs that could not be read to their end, by number, with the reason."""
    parts: dict[str, PartFacts] = field(default_factory=dict)
    """The parts of inputs that were read, by name."""
    within: set[Block] | None = None
    """The blocks whose points were asked for; None for all."""
    with_points: frozenset[Block] = frozenset()
    """Of these, those that have points, also those that hold nothing but isolated."""
    used: frozenset[Block] = frozenset()
    """Those that have points, without those that hold nothing but isolated."""
    isolated: dict[Block, int] = field(default_factory=dict)
    """Blocks left out, with the number of their points."""
    points_keys: Mapping[str, str] = field(default_factory=dict)
    """Block, by its name → the key of its points."""
    ensured: dict[str, set[Any]] = field(default_factory=dict)
    """Step, by its name → the units whose results are there."""
    copies: dict[Block, tuple[int, ...]] = field(default_factory=dict)
    """Blocks with identical points: how many are copies, and the ids of one and of its copy."""
    heights: dict[Block, Heights] = field(default_factory=dict)
    """Blocks in which inputs overlap or adjoin: differences of their heights."""
    visits: dict[Block | None, TileRecord] = field(default_factory=dict)
    """Tile → what was found of it; None → of a run in one piece."""
    visited: dict[Block, str] = field(default_factory=dict)
    """Tile → the key of what it was found from."""
    unfinished: frozenset[Block] = frozenset()
    """The tiles that come later."""
    given: dict[Block, GivenFootprints] = field(default_factory=dict)
    """Tile → the given footprints that it owns."""

    @property
    def blocks(self) -> list[Block]:
        """The blocks that are used, in order."""
        return sorted(self.used)

    @property
    def shown(self) -> list[Block]:
        """The blocks that the files show, in order."""
        return sorted(block for visit in self.visits.values() for block in visit.blocks)

    @property
    def owners(self) -> list[Block]:
        """The blocks that own buildings, in order."""
        return sorted(owner for visit in self.visits.values() for owner in visit.owners)

    def computes(self, step: Step, square: Block) -> bool:
        """True if a square is a unit of a step; a block is one if it has points."""
        return step.side is not None or square in (self.with_points if step.isolated else self.used)

    def points_read(self, blocks: Sequence[Block]) -> list[tuple[str, str]]:
        """The keys of the points of some blocks, of those that have any."""
        keys = self.points_keys
        more = "".join(f" {name}" for name in self.store.fields)
        fields = ("fields", f"{self.store.has_returns}{self.store.has_classes}{more}")
        return [fields, *((block.name, keys[block.name]) for block in blocks if block.name in keys)]

    def correct_boxes(self) -> None:
        """Widen the boxes of inputs to where their points were found."""
        self.run = replace(self.run, index=self.run.index.with_boxes(self.wrong_boxes))

    def remark(self, *remarks: str) -> None:
        """Say what the user must know of these inputs (`Run.with_remarks`)."""
        self.run = self.run.with_remarks(*remarks)

    def refuse(self, reason: str) -> NoReturn:
        """End the run for its inputs' sake; nothing of it stays."""
        self.store.discard()
        raise InputError(reason)

    def note(self, outcome: Outcome, what: str) -> None:
        """Remember the peak memory of a task, and its error for the report.

        Raises
        ------
        DiskFullError
            When that was the error: there is no use in going on.
        """
        self.peak = max(self.peak, outcome.peak_mb)
        if outcome.full:
            raise DiskFullError(outcome.error)
        if outcome.error:
            self.failed.append(f"{what}: {outcome.error}")
            log.error("%s", self.failed[-1])


def store_of(run: Run) -> Store:
    """The store of a run's results."""
    return Store(
        run.work_folder,
        has_returns=run.index.has_field("return_number"),
        has_classes=run.index.has_field("classification"),
        system=run.index.system,
        fields=run.fields,
        persistent=bool(run.options["keep"]),
        copies=copies_records(run),
    )


def parameter(run: Run, name: str) -> Any:
    """A parameter of a run by its name: of the recipe or one of its methods, an option, or a fact."""
    if hasattr(run.recipe, name.partition(".")[0]):
        return attrgetter(name)(run.recipe)
    options: Mapping[str, object] = run.options
    return options[name] if name in options else getattr(run, name)


class Results(Mapping[Block, Any]):
    """Values of some squares, each loaded when it is asked for."""

    def __init__(self, load: Callable[[Block], Any], squares: Sequence[Block]) -> None:
        self._load, self._squares = load, dict.fromkeys(squares)

    def __getitem__(self, square: Block) -> Any:
        if square not in self._squares:
            raise KeyError(square)
        return self._load(square)

    def __iter__(self) -> Iterator[Block]:
        return iter(self._squares)

    def __len__(self) -> int:
        return len(self._squares)


def results_of(step: Step, store: Store, squares: Sequence[Block]) -> Results:
    """The results of a step in those of some squares that have one."""
    return Results(
        partial(step.result, store), [square for square in squares if store.has(step.name, square)]
    )


def square_of(unit: Any) -> Block:
    """The square by which a unit's result is known: itself, or the block that owns its buildings."""
    square: Block = getattr(unit, "owner_block", unit)
    return square


@dataclass(frozen=True, eq=False)
class Work:
    """A step with all that a worker needs for any of its units; picklable."""

    step: Step
    key: str
    parameters: SimpleNamespace
    reaches: tuple[float | None, ...]
    """Width (m) of each input's surroundings."""
    side: float
    """Of blocks (m)."""

    @classmethod
    def of(cls, step: Step, run: Run) -> Work:
        """The step as a run asks for it."""
        reaches = tuple(None if entry.reach is None else parameter(run, entry.reach) for entry in step.takes)
        return cls(step, step.key(run), step.parameters(run), reaches, run.side)

    def squares(self, number: int, unit: Any) -> Sequence[Block]:
        """The squares whose values an input of a unit, by its number, may hold, in order."""
        entry, reach = self.step.takes[number], self.reaches[number]
        side = self.side if entry.source is None else entry.source.side or self.side
        if reach is not None:
            return squares_of(square_of(unit).bounds.buffered(reach), side)
        blocks = set(getattr(unit, "blocks", [unit]))
        for _ in range(entry.rings):
            blocks = {neighbour for block in blocks for neighbour in ring(block)}
        return sorted(blocks)

    def load(self, number: int, unit: Any, store: Store) -> Any:
        """An input of a unit, by its number, as the step's function is given it."""
        entry, squares = self.step.takes[number], self.squares(number, unit)
        if entry.source is not None:
            return results_of(entry.source, store, squares)
        if entry.load is not None:
            return Results(partial(entry.load, store), squares)
        return load_window(store, unit, self.reaches[number] or 0.0, entry.ids)

    def inputs_of(self, unit: Any, store: Store) -> Any:
        """Exactly what the result of a unit follows from."""
        inputs = [self.load(number, unit, store) for number in range(len(self.step.takes))]
        return self.step.inputs_of(unit, *inputs, self.parameters)

    def __call__(self, task: tuple[Any, str], store: Store) -> None:
        """Compute a unit and keep its result, unless one that is there follows from the same."""
        step, (unit, read), home = self.step, task, square_of(task[0])
        view = self.inputs_of(unit, store)
        view_key = store.key_of(self.key, view)
        mark = store.mark(step.name, home)
        arguments = [view, *([] if step.writes is None else [step.writes(store, unit)])]
        if step.earlier is not None:
            same = mark is not None and mark.step == self.key
            arguments.append(step.earlier(store.path(step.name, home)) if same else None)
        if not store.reuse_if_unchanged(step.name, home, read, view_key):
            value = step.run(*arguments, self.parameters)
            store.save(step.name, home, as_arrays(value), read, view_key, self.key)


def ensure(region: Region, step: Step, units: Sequence[Any]) -> None:
    """The results of a step for some units, and before them all results of other steps that it takes.

    Those of units that have none yet of what it reads are computed, and kept with their keys.
    """
    ensured = region.ensured.setdefault(step.name, set())
    units = [unit for unit in units if unit not in ensured]
    if not units or (step.needs and not parameter(region.run, step.needs)):
        return
    ensured.update(units)
    store, work = region.store, Work.of(step, region.run)
    for number, entry in enumerate(step.takes):
        if entry.source is not None:
            squares = {square for unit in units for square in work.squares(number, unit)}
            ensure(region, entry.source, sorted(filter(partial(region.computes, entry.source), squares)))
    tasks = []
    for unit in units:
        read, mark = read_key(region, work, unit), store.mark(step.name, square_of(unit))
        if mark is None or mark.read != read:
            tasks.append((unit, read))
    for count, outcome in enumerate(region.workers.run(partial(work, store=store), tasks), 1):
        unit = square_of(tasks[outcome.index][0])
        region.note(outcome, getattr(unit, "label", f"{step.name} of {unit.name}"))
        region.budget.add(step.booked, outcome.cpu)
        if step.shown:
            region.progress(step.shown, count, len(tasks))


def read_key(region: Region, work: Work, unit: Any) -> str:
    """The key of the files that a step reads for a unit."""
    files = [files_read(region, work, number, unit) for number in range(len(work.step.takes))]
    return key_of(work.key, work.side, unit, files)


def squares_read(run: Run, step: Step, units: Iterable[Any]) -> set[Block]:
    """The blocks whose points decide the results of a step for some units, by way of all steps it takes."""
    work, blocks = Work.of(step, run), set[Block]()
    for number, entry in enumerate(step.takes):
        squares = {square for unit in units for square in work.squares(number, unit)}
        if entry.source is None:
            blocks |= squares
        elif not entry.source.needs or parameter(run, entry.source.needs):
            blocks |= squares_read(run, entry.source, squares)
    return blocks


def files_read(region: Region, work: Work, number: int, unit: Any) -> list[tuple[str, str]]:
    """The names and keys of all files that an input of a unit is loaded from."""
    source, squares = work.step.takes[number].source, work.squares(number, unit)
    if source is None:
        return region.points_read(squares)
    return region.store.found(source.name, [square for square in squares if region.computes(source, square)])
