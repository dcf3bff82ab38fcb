"""Methods of a run, with their parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from eaves.detect import Detector
from eaves.detect.stage import MIN_AREA_M2, MIN_HEIGHT_M
from eaves.extensions import SOURCES, imported, installed
from eaves.ground import GroundMethod
from eaves.methods import DEFAULTS, Method, MethodChoice, method_class, resolve_method
from eaves.model import (
    BRIDGE_DECK,
    BUILDING,
    GROUND,
    HIGH_VEGETATION,
    LODS,
    LOW_VEGETATION,
    MEDIUM_VEGETATION,
    NOISE_CLASSES,
    OVERHANGS,
    SEAM,
    WATER,
    WIRE,
    WIRE_TOWER,
)
from eaves.outline import OutlineMethod
from eaves.raster.blur import height_kept
from eaves.reconstruct import Reconstructor
from eaves.reconstruct.overhangs import OverhangRules
from eaves.roof import RoofMethod
from eaves.surroundings.wires import VegetationRules
from eaves.units import UnitMethod


@dataclass(frozen=True)
class PublishedSource:
    """One published system: the method of each stage, and the level of detail it ends at.

    Parameters
    ----------
    name : str
        Its name.
    paper : str
        Key in references.bib.
    title : str
        Of the paper.
    delivers : str
        What comes out, in words.
    methods : mapping
        Stage to the name of its method.
    lod : str
        The level of detail it ends at.

    Examples
    --------
    >>> from eaves.recipe.recipe import find_source
    >>> find_source("xiao2014").lod
    '2.2'
    """

    name: str
    paper: str
    title: str
    delivers: str
    methods: Mapping[str, str]
    lod: str

    @property
    def cited(self) -> dict[str, str]:
        """Name, key in references.bib and title: what a run notes of its source."""
        return {"name": self.name, "paper": self.paper, "title": self.title}

    @property
    def printed(self) -> str:
        """What its paper prints, in one line: all that running it as published can take from it."""
        classes = {stage: method_class(stage, name) for stage, name in self.methods.items()}
        count = {
            stage: sum(note["printed_in"] is not None for note in cls.declared().values())
            for stage, cls in classes.items()
            if cls.paper == self.paper
        }
        numbers = ", ".join(f"{number} of {stage}" for stage, number in count.items() if number)
        numbers_text = f"numbers of its paper: {numbers}" if numbers else "its paper prints no number"
        ours = [name for stage, name in self.methods.items() if classes[stage].paper != self.paper]
        beside = f"; ours as it is: {', '.join(ours)}" if ours else ""
        return f"{numbers_text}; what is ours and can be off is off{beside}"

    @property
    def steps(self) -> list[tuple[str, str, dict[str, Any]]]:
        """Stage, words and parameters of each step that a parameter leaves out."""
        deviations = []
        for stage, name in self.methods.items():
            deviations += [(stage, step, off) for step, off in method_class(stage, name).steps().items()]
        return deviations


@cache
def sources() -> dict[str, PublishedSource]:
    """Name → source, of those that installed packages bring by entry points of the group `eaves.sources`.
    What a document leaves open (an outline, a ground filter) takes what is nearest to it."""
    return {name: imported(place) for name, place in installed(SOURCES).items()}


def find_source(name: str) -> PublishedSource:
    """The source of a name.

    Parameters
    ----------
    name : str
        One of `sources()`.

    Returns
    -------
    PublishedSource
        Its methods and the level of detail it ends at.

    Raises
    ------
    ValueError
        When there is none of that name; it lists those there are.

    Examples
    --------
    >>> from eaves.recipe.recipe import find_source
    >>> find_source("xiao2014").methods["ground"]
    'smooth_region'
    """
    if name not in sources():
        raise ValueError(f"unknown source '{name}'; choose one of: {', '.join(sources())}")
    return sources()[name]


def with_source(name: str, methods: Mapping[str, MethodChoice] | None) -> dict[str, MethodChoice]:
    """The methods of a source by stage, under those that are given.

    Parameters
    ----------
    name : str
        One of `sources()`.
    methods : mapping or None
        A method, its name or a table of parameters by stage; what is named here goes before the source's.

    Returns
    -------
    dict
        By stage.

    Raises
    ------
    ValueError
        When there is no source of that name.

    Examples
    --------
    >>> from eaves.recipe.recipe import with_source
    >>> with_source("chen_sun", {"outline": "global_fit"})["outline"]
    'global_fit'
    """
    chosen: dict[str, MethodChoice] = dict(find_source(name).methods)
    for stage, choice in (methods or {}).items():
        method = chosen.get(stage)
        if isinstance(choice, Mapping) and "method" not in choice and isinstance(method, str):
            chosen[stage] = {"method": method, **choice}
        elif choice is not None:
            chosen[stage] = choice
    return chosen


LARGEST_CLASS = 255
"""One byte holds a class."""
VEGETATION = LOW_VEGETATION, MEDIUM_VEGETATION, HIGH_VEGETATION
OTHERS = WATER, WIRE, WIRE_TOWER, BRIDGE_DECK


@dataclass(frozen=True)
class Recipe:
    """The methods of a run, with their parameters, and how the file's classes are used.

    Parameters
    ----------
    ground : GroundMethod
        The ground filter.
    detect : Detector or None
        The detector; None stops after the ground.
    outline : OutlineMethod
        The outline method.
    roof : RoofMethod
        The roof segmentation method.
    reconstruct : Reconstructor
        The reconstruction method.
    units : UnitMethod or None
        The method that divides blocks into buildings; None leaves detected blocks whole.
    use_classes : bool
        Use the classes of the files: 2 is ground, 6 building, 7 and 18 noise.
    lod : str
        The finest level of detail to keep: `0` (footprints alone), `1.2`, `1.3`, `2.0`, `2.2` or `2.3`.
    ground_classes : tuple of int
        The files' classes of the ground, with `use_classes`.
    vegetation : VegetationRules or None
        How low, medium and high vegetation (3, 4, 5) is distinguished from the rest; None leaves it
        unclassified.
    others : bool
        Distinguish water (9), wires (14), their towers (15) and decks of bridges (17) from the rest.
    overhangs : OverhangRules
        The limits of a wall seen under a roof, at LoD 2.3.
    smallest : (float, float)
        Area (m²) and height (m) under which what a detector finds is no building.
    from_raster : bool
        True if points are cells of a surface raster, which lowers the trust in every building.

    Examples
    --------
    >>> import eaves
    >>> eaves.make_recipe().reconstruct.name
    'arrangement'
    """

    ground: GroundMethod
    detect: Detector | None
    outline: OutlineMethod
    roof: RoofMethod
    reconstruct: Reconstructor
    units: UnitMethod | None = None
    use_classes: bool = False
    lod: str = "2.2"
    ground_classes: tuple[int, ...] = (GROUND,)
    vegetation: VegetationRules | None = VegetationRules()  # noqa: RUF009 (frozen)
    others: bool = True
    overhangs: OverhangRules = OverhangRules()  # noqa: RUF009 (frozen)
    smallest: tuple[float, float] = (MIN_AREA_M2, MIN_HEIGHT_M)
    from_raster: bool = False

    @property
    def buffer(self) -> float:
        """Width (m) of the surroundings a block is computed with: the largest of the methods'."""
        return max(self.ground.buffer, self.scene_buffer)

    @property
    def needs(self) -> tuple[str, ...]:
        """The fields of points that the methods need beside coordinates, returns and classes."""
        detected = self.detect.needs if self.detect else ()
        return tuple(sorted({*self.ground.needs, *detected}))

    def for_scan(self, blur: float, roughness: float) -> Recipe:
        """The recipe for a scan that is smoothed and rough so far (`Method.for_scan`)."""
        detect = self.detect and self.detect.for_scan(blur, roughness)
        area, height = self.smallest
        return replace(
            self,
            ground=self.ground.for_scan(blur, roughness),
            detect=detect,
            smallest=(area, height * height_kept(blur)),
        )

    @property
    def wants_of_images(self) -> tuple[str, ...]:
        """The fields that the detector takes where every file of a scan without pulses has them."""
        return self.detect.wants if self.detect else ()

    @property
    def wants(self) -> tuple[str, ...]:
        """The fields of points that the methods take where every file has them."""
        return self.units.wants if self.units else ()

    @property
    def sees_wide(self) -> bool:
        """True if points beyond a block's buffer are looked at to find wider objects."""
        return self.ground.wide_buffer > 0.0 and not self.use_classes

    @property
    def wide_buffer(self) -> float:
        """Width (m) of the surroundings of a square in which large objects are looked for; 0 for not."""
        return self.ground.wide_buffer if self.sees_wide else 0.0

    @property
    def sees_decks(self) -> bool:
        """True if decks of bridges are looked for."""
        return self.sees_wide and self.marks_others

    @property
    def marks_vegetation(self) -> bool:
        """True if vegetation is distinguished from the rest: buildings are looked for, classes not given."""
        return self.vegetation is not None and self.detect is not None and not self.use_classes

    @property
    def marks_others(self) -> bool:
        """True if water, wires and decks of bridges are distinguished from the rest."""
        return self.others and self.marks_vegetation

    @property
    def keeps_low(self) -> bool:
        """True if buildings need the points below and around them: walls, ground."""
        return self.lod == OVERHANGS

    @property
    def scene_buffer(self) -> float:
        """Width (m) of the surroundings the detector sees: its reach, in whole 3 m (all cells' multiple)."""
        needed = max(self.detect.buffer if self.detect else 0.0, 2 * SEAM)
        return float(np.ceil(needed / 3.0) * 3.0)


def make_recipe(
    methods: Mapping[str, MethodChoice] | None = None,
    *,
    source: str | None = None,
    published: bool = False,
    use_classes: bool = False,
    lod: str | None = None,
    building_classes: Sequence[int] | None = None,
    ground_classes: Sequence[int] | None = None,
    classes: Sequence[int] | None = None,
) -> Recipe:
    """The recipe for the methods given by stage; a stage not named uses its default.

    A detector comes with the ground filter of its own paper unless one is given. With `use_classes` buildings
    are the points of class 6 unless a detector is given.

    Parameters
    ----------
    methods : mapping or None
        By stage (`ground`, `detect`, `outline`, `units`, `roof`, `reconstruct`): a method, its name, or a
        table of its parameters with its name under `method`. The name `off` leaves blocks whole (`units`).
    source : str or None
        One of the published systems (`eaves.recipe.recipe`): its chain is used where no method is given.
    published : bool
        Methods given by name take the numbers that their papers print, with a source those of its own paper
        alone, and leave out what these do not have; so do the classes of vegetation, water, wires and decks,
        unless `classes` names them, and the limits of `Recipe.smallest`.
    use_classes : bool
        Use the classes of the files.
    lod : str or None
        The finest level of detail: `0`, `1.2`, `1.3`, `2.0`, `2.2` or `2.3`; by default what the source
        delivers, or 2.2.
    building_classes, ground_classes : sequence of int or None
        The numbers by which the files' classes mean building and ground, with `use_classes`; by default 6 and
        67, and 2.
    classes : sequence of int or None
        The classes that are written: `2, 3, 4, 5, 6, 9, 14, 15, 17` by default; `2, 3, 4, 5, 6` leaves
        water, wires and decks of bridges what they would be otherwise, `2, 6` vegetation, too.

    Returns
    -------
    Recipe
        One method for each stage.

    Raises
    ------
    ValueError, TypeError
        When a source, a stage, a method, a parameter or a level does not exist.

    Examples
    --------
    >>> import eaves
    >>> recipe = eaves.make_recipe({"detect": "normal_echo"})
    >>> recipe.ground.name, recipe.detect.name, recipe.roof.name
    ('smooth_region', 'normal_echo', 'global_refinement')
    """
    of_paper: bool | str = published
    if source is not None:
        methods = {"units": "off", **with_source(source, methods)}  # no source divides blocks
        lod = lod or find_source(source).lod
        of_paper = published and find_source(source).paper
    lod = lod or "2.2"
    classes = (GROUND, BUILDING) if published and classes is None else classes
    chosen = {stage: choice for stage, choice in (methods or {}).items() if choice is not None}
    unknown = chosen.keys() - DEFAULTS.keys()
    if unknown:
        raise ValueError(f"unknown stage '{min(unknown)}'; choose one of: {', '.join(DEFAULTS)}")
    if lod not in LODS:
        raise ValueError(f"--lod {lod}: unknown level of detail; choose one of: {', '.join(LODS)}")
    _check_given(use_classes, chosen.get("detect"), building_classes, ground_classes)
    if use_classes and not is_named(chosen.get("detect")):
        believed = {"classes": tuple(building_classes)} if building_classes else {}
        chosen["detect"] = {"method": "given_classes", **believed}
    methods_made: dict[str, Method | None] = {}
    for stage in ("detect", *(stage for stage in DEFAULTS if stage != "detect")):
        choice = chosen.get(stage)
        if stage == "units" and _name_of(choice) == "off":
            methods_made[stage] = None
            continue
        if stage == "ground" and not is_named(choice):
            ground = getattr(methods_made["detect"], "ground_method", DEFAULTS["ground"])
            choice = {"method": ground, **(choice if isinstance(choice, Mapping) else {})}
        methods_made[stage] = resolve_method(stage, choice, of_paper)
    return Recipe(
        **methods_made,  # type: ignore[arg-type]
        use_classes=use_classes,
        lod=lod,
        ground_classes=tuple(ground_classes or (GROUND,)),
        vegetation=VegetationRules() if _with(classes, VEGETATION) else None,
        others=_with(classes, OTHERS),
        smallest=(0.0, 0.0) if published else Recipe.smallest,
    )


def _check_given(
    use_classes: bool,
    detect: MethodChoice,
    building_classes: Sequence[int] | None,
    ground_classes: Sequence[int] | None,
) -> None:
    """Raise ValueError for numbers of classes that nothing would read, or that contradict each other."""
    for name, numbers in (("building-classes", building_classes), ("ground-classes", ground_classes)):
        if not numbers:
            continue
        option_text = f"--{name} {','.join(map(str, numbers))}"
        if not use_classes:
            raise ValueError(f"{option_text}: the files' classes are not used; add --use-classes")
        if not all(0 <= number <= LARGEST_CLASS for number in numbers):
            raise ValueError(f"{option_text}: classes are numbers from 0 to {LARGEST_CLASS}")
        if set(numbers) & set(NOISE_CLASSES):
            raise ValueError(f"{option_text}: 7 and 18 are noise; leave them out")
    if building_classes and is_named(detect):
        raise ValueError("--building-classes: they are of the detector given_classes; leave --detect out")
    shared = set(building_classes or (BUILDING,)) & set(ground_classes or (GROUND,))
    if shared:
        raise ValueError(f"class {min(shared)} cannot be both ground and building; leave it out of one")


def _with(classes: Sequence[int] | None, chosen: tuple[int, ...]) -> bool:
    """True if the classes to write, once checked, include all of `chosen`."""
    if classes is None:
        return True
    sets = [{GROUND, BUILDING}, {GROUND, *VEGETATION, BUILDING}, {GROUND, *VEGETATION, BUILDING, *OTHERS}]
    if set(classes) not in sets:
        asked = ",".join(map(str, classes))
        allowed = ", ".join(",".join(map(str, sorted(allowed_set))) for allowed_set in sets[:-1])
        last = ",".join(map(str, sorted(sets[-1])))
        raise ValueError(f"--classes {asked}: write {allowed} or {last}; noise (7, 18) is always marked")
    return set(chosen) <= set(classes)


def _name_of(choice: MethodChoice) -> object:
    """The name by which a choice is given, if by one."""
    return choice.get("method") if isinstance(choice, Mapping) else choice


def is_named(choice: MethodChoice) -> bool:
    """True if a choice names its method.

    Parameters
    ----------
    choice : Method, str, mapping or None
        A method, its name, or a table of its parameters.

    Returns
    -------
    bool
        False for None and for a table without the key `method`.

    Examples
    --------
    >>> from eaves.recipe.recipe import is_named
    >>> is_named("prism"), is_named({"cell": 0.5})
    (True, False)
    """
    return "method" in choice if isinstance(choice, Mapping) else choice is not None
