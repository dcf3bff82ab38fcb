"""A step as a value, and the engine: units, keys, loading, saving and the order of work of every step.

A step is declared once, in `eaves.flow.steps`. Its functions get loaded values and the parameters that it
declares; they see no store, key or path. A reach is applied here alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from eaves.flow.run import Run
from eaves.model import Block
from eaves.run.code import Sources, package_sources
from eaves.run.keys import key_of, modules_of
from eaves.run.part_file import as_arrays, load_arrays, load_value
from eaves.run.points import load_window
from eaves.run.store import Store
from eaves.run.world_squares import ring, squares_of

if TYPE_CHECKING:
    from eaves.flow.region import Region


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
    takes : tuple of Input
        All that its functions are given beside parameters.
    see : callable
        `see(unit, *inputs, parameters)`: exactly what the result follows from.
    run : callable
        `run(seen, parameters)`: the result, a value or arrays by name.
    types : mapping
        The classes of a result that is a value; without them it is arrays by name.
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
    earlier : callable or None
        `earlier(path)`: an earlier result of the same code and parameters, which `run` is given, too.
    booked : str
        The name under which its time is booked.
    shown : bool
        True if the progress shown is that of the step.
    """

    name: str
    takes: tuple[Input, ...]
    see: Callable[..., Any]
    run: Callable[..., Any]
    types: Mapping[str, type[Any]] = field(default_factory=dict)
    load: Callable[[Path, Block, Callable[[Block], NDArray[Any]]], Any] | None = None
    reads: tuple[str, ...] = ()
    side: float | None = None
    needs: str = ""
    isolated: bool = False
    earlier: Callable[[Path], Any] | None = None
    booked: str = "blocks"
    shown: bool = False

    def result(self, store: Store, square: Block) -> Any:
        """Its result in a square, as the steps that take it are given it."""
        path = store.path(self.name, square)
        if self.load is not None:
            return self.load(path, square, store.read_points)
        return load_value(path, self.types) if self.types else load_arrays(path)

    def within(self, reach: str) -> Input:
        """Its results within the reach that a parameter names."""
        return Input(self, reach)

    def around(self, rings: int) -> Input:
        """Its results in the unit and in rings of blocks around it."""
        return Input(self, rings=rings)

    def parameters(self, run: Run) -> SimpleNamespace:
        """The parameters that it declares, and the reference system."""
        return SimpleNamespace(system=run.index.system, **{name: parameter(run, name) for name in self.reads})

    def key(self, run: Run, sources: Sources | None = None) -> str:
        """The key of its code with that of the methods it is given, its parameters, the reference system and
        its reaches; `sources` are those of this package unless others are given."""
        values = list(vars(self.parameters(run)).values())
        reaches = [parameter(run, one.reach) for one in self.takes if one.reach]
        return key_of(self.name, (sources or package_sources()).digest(self.modules(run)), values, reaches)

    def modules(self, run: Run) -> list[str]:
        """The modules of its functions and of the methods that it is given."""
        functions: list[Callable[..., Any] | None] = [self.see, self.run]
        functions += [load_window if one.source is None else one.source.load for one in self.takes]
        functions += [one.load for one in self.takes]
        values = vars(self.parameters(run)).values()
        methods = (module for value in values for module in modules_of(value))
        return [*(function.__module__ for function in functions if function is not None), *methods]


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


def home_of(unit: Any) -> Block:
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
        reaches = tuple(None if one.reach is None else parameter(run, one.reach) for one in step.takes)
        return cls(step, step.key(run), step.parameters(run), reaches, run.side)

    def squares(self, number: int, unit: Any) -> Sequence[Block]:
        """The squares whose values an input of a unit, by its number, may hold, in order."""
        one, reach = self.step.takes[number], self.reaches[number]
        side = self.side if one.source is None else one.source.side or self.side
        if reach is not None:
            return squares_of(home_of(unit).bounds.buffered(reach), side)
        blocks = set(getattr(unit, "blocks", [unit]))
        for _ in range(one.rings):
            blocks = {near for block in blocks for near in ring(block)}
        return sorted(blocks)

    def load(self, number: int, unit: Any, store: Store) -> Any:
        """An input of a unit, by its number, as the step's function is given it."""
        one, squares = self.step.takes[number], self.squares(number, unit)
        if one.source is not None:
            return results_of(one.source, store, squares)
        if one.load is not None:
            return Results(partial(one.load, store), squares)
        return load_window(store, unit, self.reaches[number] or 0.0, one.ids)

    def see(self, unit: Any, store: Store) -> Any:
        """Exactly what the result of a unit follows from."""
        inputs = [self.load(number, unit, store) for number in range(len(self.step.takes))]
        return self.step.see(unit, *inputs, self.parameters)

    def __call__(self, task: tuple[Any, str], store: Store) -> None:
        """Compute a unit and keep its result, unless one that is there follows from the same."""
        step, (unit, read), home = self.step, task, home_of(task[0])
        seen = self.see(unit, store)
        taken = store.key_of(self.key, seen)
        mark = store.mark(step.name, home)
        arguments = [seen]
        if step.earlier is not None:
            same = mark is not None and mark.step == self.key
            arguments.append(step.earlier(store.path(step.name, home)) if same else None)
        if not store.reuse_if_unchanged(step.name, home, read, taken):
            value = step.run(*arguments, self.parameters)
            store.save(step.name, home, as_arrays(value), read, taken, self.key)


def bring(region: Region, step: Step, units: Sequence[Any]) -> None:
    """The results of a step for some units, and before them all results of other steps that it takes."""
    brought = region.brought.setdefault(step.name, set())
    units = [unit for unit in units if unit not in brought and region.computes(step, unit)]
    if not units or (step.needs and not parameter(region.run, step.needs)):
        return
    brought.update(units)
    bring_inputs(region, step, units)
    compute(region, step, units)


def bring_inputs(region: Region, step: Step, units: Sequence[Any]) -> None:
    """All results of other steps that a step takes for some units."""
    work = Work.of(step, region.run)
    for number, one in enumerate(step.takes):
        if one.source is not None:
            squares = {square for unit in units for square in work.squares(number, unit)}
            bring(region, one.source, sorted(squares - region.brought.get(one.source.name, set())))


def squares_read(run: Run, step: Step, units: Iterable[Any]) -> set[Block]:
    """The blocks whose points decide the results of a step for some units, by way of all steps it takes."""
    work, blocks = Work.of(step, run), set[Block]()
    for number, one in enumerate(step.takes):
        squares = {square for unit in units for square in work.squares(number, unit)}
        if one.source is None:
            blocks |= squares
        elif not one.source.needs or parameter(run, one.source.needs):
            blocks |= squares_read(run, one.source, squares)
    return blocks


def compute(region: Region, step: Step, units: Sequence[Any]) -> None:
    """The results of a step for those units that have none yet of what it reads, each with its key."""
    store, work = region.store, Work.of(step, region.run)
    tasks = []
    for unit in units:
        files = [files_read(region, work, number, unit) for number in range(len(step.takes))]
        read = key_of(work.key, work.side, unit, files)
        mark = store.mark(step.name, home_of(unit))
        if mark is None or mark.read != read:
            tasks.append((unit, read))
    for count, outcome in enumerate(region.workers.run(partial(work, store=store), tasks), 1):
        region.note(outcome, f"{step.name} of {home_of(tasks[outcome.index][0]).name}")
        region.budget.add(step.booked, outcome.cpu)
        if step.shown:
            region.progress(step.booked, count, len(tasks))


def files_read(region: Region, work: Work, number: int, unit: Any) -> list[tuple[str, str]]:
    """The names and keys of all files that an input of a unit is loaded from."""
    source, squares = work.step.takes[number].source, work.squares(number, unit)
    if source is None:
        return region.points_read(squares)
    return region.store.found(source.name, [square for square in squares if region.computes(source, square)])
