"""A step as a value, and the engine: units, keys, loading, saving and the order of work of every step.

A step is declared once, in `eaves.flow.step`. Its functions get loaded values and the parameters that it
declares; they see no store, key or path. A reach is applied here alone.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from eaves.blocks.block import find_regions, find_signs, inputs_of_regions, inputs_of_signs
from eaves.blocks.block_file import BlockFile, inputs_of_shown, show_block
from eaves.blocks.ground import (
    classify_block,
    find_floor,
    find_large,
    find_square_decks,
    inputs_of_decks,
    inputs_of_floors,
    inputs_of_ground,
    inputs_of_large,
)
from eaves.blocks.points import (
    find_sharpened,
    find_thinned,
    inputs_of_sharpened,
    inputs_of_thinned,
)
from eaves.blocks.superseded import find_superseded, inputs_of_superseded
from eaves.buildings.building_file import load_buildings
from eaves.buildings.owned import inputs_of_buildings, model_buildings
from eaves.flow.refusals import copies_records
from eaves.flow.run import Run
from eaves.model import Block
from eaves.model.block import WIDE_SQUARE, ring, squares_of
from eaves.run import keys
from eaves.run.keys import HOME, code_digest, code_of_methods, key_of
from eaves.run.points import (
    SliceWriter,
    inputs_of_points,
    load_chosen,
    load_files,
    load_points,
    load_scans,
    load_window,
    read_slice,
)
from eaves.run.store import Results, Store, as_arrays, load_part, open_part

if TYPE_CHECKING:
    from eaves.flow.region import Region

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
    fields : str or None
        Parameter with the names of the other fields that points come with.
    """

    source: Step | None = None
    reach: str | None = None
    rings: int = 0
    load: Callable[[Store, Block], Any] | None = None
    ids: bool = True
    fields: str | None = None


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
    shown : bool
        True if its progress is shown.
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
    shown: bool = False
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
        taken = [parameter(run, name) for one in self.takes for name in (one.reach, one.fields) if name]
        methods = [list(code_of_methods(value, folder)) for value in values]
        return key_of(self.name, code_digest(self.code, folder), methods, values, taken)


def inputs_in(store: Store, run: Run, step: Step, block: Block) -> Any:
    """All that a step follows from in a block."""
    return Work.of(step, run).inputs_of(block, store)


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
    fields: tuple[tuple[str, ...], ...]
    """Names of the other fields of each input's points."""
    side: float
    """Of blocks (m)."""

    @classmethod
    def of(cls, step: Step, run: Run) -> Work:
        """The step as a run asks for it."""
        reaches = tuple(None if entry.reach is None else parameter(run, entry.reach) for entry in step.takes)
        fields = tuple(parameter(run, entry.fields) if entry.fields else () for entry in step.takes)
        return cls(step, step.key(run), step.parameters(run), reaches, fields, run.side)

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
        return load_window(store, unit, self.reaches[number] or 0.0, entry.ids, self.fields[number])

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
        region.budget.add(step.name, outcome.cpu)
        if step.shown:
            region.progress(step.name, count, len(tasks))


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


POINTS = Step(
    name=keys.POINTS,
    code=keys.READING,
    takes=(),
    inputs_of=inputs_of_points,
    run=read_slice,
    reads=("side", "window", "fields"),
    writes=SliceWriter,
    shown=True,
)
"""Its units are the parts of the inputs, whose points it puts into their blocks."""
SUPERSEDED = Step(
    name=keys.SUPERSEDED,
    code=(*keys.BASE, "blocks/superseded.py"),
    takes=(Input(load=load_scans, rings=1),),
    inputs_of=inputs_of_superseded,
    run=find_superseded,
    reads=("generations",),
)
THINNED = Step(
    name=keys.THINNED,
    code=(*keys.BASE, "blocks/points.py"),
    takes=(Input(load=load_files),),
    inputs_of=inputs_of_thinned,
    run=find_thinned,
)
SHARPENED = Step(
    name=keys.SHARPENED,
    code=(*keys.BASE, "blocks/points.py"),
    takes=(Input(load=load_chosen, rings=1),),
    inputs_of=inputs_of_sharpened,
    run=find_sharpened,
    reads=("blur",),
)
FLOORS = Step(
    name=keys.FLOORS,
    code=keys.GROUND_CODE,
    takes=(Input(load=load_points),),
    inputs_of=inputs_of_floors,
    run=find_floor,
)
LARGE = Step(
    name=keys.LARGE,
    code=keys.GROUND_CODE,
    side=WIDE_SQUARE,
    takes=(FLOORS.within("wide_buffer"),),
    inputs_of=inputs_of_large,
    run=find_large,
    reads=("ground", "wide_buffer"),
    needs="sees_wide",
)
DECKS = Step(
    name=keys.DECKS,
    code=keys.GROUND_CODE,
    side=WIDE_SQUARE,
    takes=(FLOORS.within("wide_buffer"), LARGE.around(0)),
    inputs_of=inputs_of_decks,
    run=find_square_decks,
    reads=("wide_buffer",),
    needs="sees_decks",
)
GROUND = Step(
    name=keys.GROUND,
    code=keys.GROUND_CODE,
    takes=(Input(reach="ground.buffer", ids=False, fields="ground.needs"), LARGE.within("ground.buffer")),
    inputs_of=inputs_of_ground,
    run=classify_block,
    reads=("ground", "use_classes", "ground_classes", "sees_wide"),
    isolated=True,
    shown=True,
)
SEEN = (
    Input(reach="scene_buffer", fields="seen_fields"),
    GROUND.within("scene_buffer"),
    LARGE.within("scene_buffer"),
    DECKS.within("scene_buffer"),
)
SIGNS = Step(
    name=keys.SIGNS,
    code=keys.SCENES_CODE,
    takes=SEEN,
    inputs_of=inputs_of_signs,
    run=find_signs,
    load=open_part,
    reads=("detect", "scene_buffer", "sees_wide", "marks_others"),
    needs="coloured",
)
REGIONS = Step(
    name=keys.REGIONS,
    code=keys.SCENES_CODE,
    takes=(*SEEN, SIGNS.within("signs_buffer")),
    inputs_of=inputs_of_regions,
    run=find_regions,
    load=BlockFile,
    reads=(
        "detect",
        "scene_buffer",
        "sees_wide",
        "vegetation",
        "marks_vegetation",
        "marks_others",
        "keeps_low",
        "smallest",
        "classes_only",
    ),
    shown=True,
)
BUILDINGS = Step(
    name=keys.BUILDINGS,
    code=keys.BUILDINGS_CODE,
    takes=(REGIONS.around(1), Input(load=load_points, rings=1)),
    inputs_of=inputs_of_buildings,
    run=model_buildings,
    reads=(
        "outline",
        "units",
        "roof",
        "reconstruct",
        "lod",
        "overhangs",
        "keeps_low",
        "snap_footprints",
        "from_raster",
    ),
    earlier=load_buildings,
    shown=True,
    persistent=True,
)
SHOWN = Step(
    name="shown",
    code=(*keys.BASE, "blocks/block_file.py"),
    takes=(REGIONS.around(0), GROUND.around(0)),
    inputs_of=inputs_of_shown,
    run=show_block,
    load=BlockFile,
    persistent=True,
)
"""What the files show of a block, of a run by tiles, which lets go of the other results."""
STEPS = (
    POINTS,
    SUPERSEDED,
    THINNED,
    SHARPENED,
    FLOORS,
    LARGE,
    DECKS,
    GROUND,
    SIGNS,
    REGIONS,
    BUILDINGS,
    SHOWN,
)
"""In the order in which they run."""
