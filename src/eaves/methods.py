"""Methods as values, and the registry that names them.

A method is a frozen pydantic model: its parameters are its fields, each declared once by `parameter(...)`
with default, sentence, unit, range and the paper's symbol. In Python one writes
`classify_ground(cloud, AdaptiveTin(seed_cell=80))`; names and tables of parameters stand for methods too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from eaves.extensions import METHODS, imported, installed
from eaves.model.checks import describe

Emit = Callable[[str, Any], None]
"""Receives every named intermediate of a method: `emit("seed points", xyz)`."""


def ignore(name: str, value: Any) -> None:
    """Discard a named intermediate: the `Emit` that keeps nothing.

    Parameters
    ----------
    name : str
        Name of the intermediate.
    value : object
        Its value.

    Examples
    --------
    >>> from eaves.methods import ignore
    >>> ignore("seed points", [])
    """


def parameter(
    default: Any,
    sentence: str,
    *,
    unit: str = "1",
    symbol: str | None = None,
    published: Any = None,
    printed_in: str | None = None,
    off: Any = None,
    step: str | None = None,
    **limits: float,
) -> Any:
    """Declare a method's parameter once.

    Parameters
    ----------
    default : object
        The default; None means: derived from the measured spacing and noise, by the rule the sentence states;
        `...`: what the paper prints.
    sentence : str
        Meaning of the parameter.
    unit : str
        Its unit; `1` for shares and counts.
    symbol : str or None
        The paper's symbol.
    published : object
        The number that the paper prints, used by `Method.as_published()`; what it does not print keeps the
        default.
    printed_in : str or None
        The place in the paper where it is printed.
    off : object
        The value at which the parameter does nothing. `Method.as_published()` takes it where `step` is None:
        what the paper does not have is then off.
    step : str or None
        The step of the paper that `off` leaves out, in its words.
    **limits : float
        The range: pydantic's `ge`, `gt`, `le`, `lt`.

    Returns
    -------
    pydantic.fields.FieldInfo
        The declaration; as the value of an annotated class attribute it makes a field.

    Raises
    ------
    TypeError
        When a limit is none of pydantic's.
    ValueError
        When only one of `published` and `printed_in` is given.

    Examples
    --------
    >>> from eaves.methods import Method, parameter
    >>> class Example(Method):
    ...     cell: float = parameter(0.5, "side of a cell", unit="m", gt=0)
    >>> Example().cell
    0.5
    """
    if (published is None) != (printed_in is None):
        raise ValueError(f"parameter '{sentence}': `published` and `printed_in` go together")
    extra = {"unit": unit, "symbol": symbol, "published": published, "printed_in": printed_in}
    extra |= {"off": off, "step": step}
    declared: dict[str, Any] = {"description": sentence, "json_schema_extra": extra, **limits}
    return Field(published if default is ... else default, **declared)


class Method(BaseModel):
    """A published method with its parameters: frozen, comparable, picklable, printable.

    The parameters are the fields of the class, each declared by `parameter(...)`.

    Raises
    ------
    ValueError
        When a parameter does not exist, or its value is out of range.

    Examples
    --------
    >>> import eaves
    >>> eaves.AdaptiveTin(angle=10.0).angle
    10.0
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    stage: ClassVar[str]
    name: ClassVar[str]
    idea: ClassVar[str] = ""
    """One sentence for `eaves methods`."""
    paper: ClassVar[str] = ""
    """Key in references.bib."""
    needs: ClassVar[tuple[str, ...]] = ()
    """Fields of the points, beside coordinates, returns and classes, that a ground filter or a detector finds
    in `PointCloud.fields`; they are read for it alone."""
    wants: ClassVar[tuple[str, ...]] = ()
    """Fields that a method does without: a unit method is given `intensity` where the files have it, a
    detector finds colours in `PointCloud.fields` where every file of a scan without pulses has them."""

    def for_scan(self, blur: float, roughness: float) -> Self:
        """The method for a scan whose walls are smoothed by a normal distribution of `blur` (m), and that is
        rougher than laser scans by `roughness` (m); itself where both are 0, or nothing follows."""
        return self

    def unless_set(self, **parameters: Any) -> Self:
        """The method with these parameters, but for those that were set to another value than the default."""
        fields = type(self).model_fields
        free = {
            name: value for name, value in parameters.items() if getattr(self, name) == fields[name].default
        }
        return self.model_copy(update=free) if free else self

    def __init__(self, **parameters: Any) -> None:
        try:
            super().__init__(**parameters)
        except ValidationError as error:
            raise ValueError(self._refusal(error)) from None

    @classmethod
    def _refusal(cls, error: ValidationError) -> str:
        """One sentence for the first parameter that is refused."""
        first = error.errors(include_url=False)[0]
        parameter = ".".join(map(str, first["loc"]))
        method = f"{cls.stage} method '{cls.name}'"
        if first["type"] == "extra_forbidden":
            parameters = ", ".join(cls.model_fields) or "none"
            nearest = get_close_matches(parameter, cls.model_fields, 1)
            hint = f"did you mean '{nearest[0]}'? it has" if nearest else "it has"
            return f"unknown parameter '{parameter}' of {method}; {hint}: {parameters}"
        rule = first["msg"][:1].lower() + first["msg"][1:]
        remedy = f"see `eaves methods {cls.stage}`"
        return f"parameter '{parameter}' of {method}: {rule}, not {first['input']!r}; {remedy}"

    @property
    def address(self) -> str:
        """The name by which it can be made again (`resolve_method`): ours, or `module:Class`."""
        cls = type(self)
        return self.name if self.name in methods_of(self.stage) else f"{cls.__module__}:{cls.__qualname__}"

    @property
    def buffer(self) -> float:
        """Distance (m) within which other points can change the result at a point."""
        return 0.0

    @classmethod
    def as_published(cls, paper: str | None = None) -> Self:
        """The method with every number its paper prints, and without what the paper does not have; in the
        system of another `paper` (key in references.bib) the numbers stay ours."""
        return cls(**cls.published_values(paper))

    @classmethod
    def published_values(cls, paper: str | None = None) -> dict[str, Any]:
        """What `as_published` changes, by the name of the parameter."""
        notes = cls.declared()
        values = {name: note["off"] for name, note in notes.items() if note["step"] is None}
        nested = {name: field.default for name, field in cls.model_fields.items()}
        values |= {
            name: method.model_copy(update=method.published_values(paper))
            for name, method in nested.items()
            if paper and isinstance(method, Method)
        }
        if paper in (None, cls.paper):
            values |= {name: note["published"] for name, note in notes.items() if note["printed_in"]}
        return {name: value for name, value in values.items() if value is not None}

    @classmethod
    def declared(cls) -> dict[str, dict[str, Any]]:
        """The arguments of `parameter` beside default, sentence and range, by name."""
        extras = {name: field.json_schema_extra for name, field in cls.model_fields.items()}
        return {name: extra for name, extra in extras.items() if isinstance(extra, dict)}

    @classmethod
    def steps(cls) -> dict[str, dict[str, Any]]:
        """Step of the paper, in its words → the parameters that leave it out, with their values."""
        steps: dict[str, dict[str, Any]] = {}
        for name, note in cls.declared().items():
            if note["step"] is not None:
                steps.setdefault(note["step"], {})[name] = note["off"]
        return steps


DEFAULTS: dict[str, str] = {
    "ground": "adaptive_tin",
    "detect": "consensus",
    "outline": "global_fit",
    "units": "row_walls",
    "roof": "global_refinement",
    "reconstruct": "arrangement",
}

REGISTRY: dict[str, dict[str, str]] = {
    "ground": {"adaptive_tin": "eaves.ground.adaptive_tin:AdaptiveTin"},
    "detect": {
        "consensus": "eaves.detect.consensus:Consensus",
        "given_classes": "eaves.detect.given_classes:GivenClasses",
    },
    "outline": {
        "alpha_shape": "eaves.outline.alpha_shape:AlphaShape",
        "global_fit": "eaves.outline.global_fit:GlobalFit",
    },
    "units": {"row_walls": "eaves.units.row_walls:RowWalls"},
    "roof": {
        "region_growing": "eaves.roof.region_growing:RegionGrowing",
        "global_refinement": "eaves.roof.global_refinement:GlobalRefinement",
    },
    "reconstruct": {
        "prism": "eaves.reconstruct.prism:Prism",
        "arrangement": "eaves.reconstruct.arrangement:Arrangement",
    },
}
"""Stage → name → where the class is, of the core's methods; installed packages bring others."""

CONTRACTS: dict[str, tuple[str, ...]] = {
    "ground": ("eaves.ground:GroundMethod", "ground_mask"),
    "detect": ("eaves.detect:Detector", "label"),
    "outline": ("eaves.outline:OutlineMethod", "trace", "regularise"),
    "units": ("eaves.units:UnitMethod", "divide"),
    "roof": ("eaves.roof:RoofMethod", "planes"),
    "reconstruct": ("eaves.reconstruct:Reconstructor", "model"),
}
"""Stage → where its contract is, and the functions that a method must define."""


class ContractError(TypeError):
    """What a method is, or returned, is not what the contract of its stage allows.

    Examples
    --------
    >>> import eaves
    >>> from eaves.methods import ContractError, resolve_method
    >>> class Nameless(eaves.Detector):
    ...     def label(self, scene, emit):
    ...         return eaves.Regions(scene.height > 2.0)
    >>> try:
    ...     resolve_method("detect", Nameless())
    ... except ContractError as error:
    ...     print(error)
    detect method Nameless has no name; give its class one: name = "nameless"
    """


@contextmanager
def naming(method: Method) -> Iterator[None]:
    """A context in which an exception gets a note that names the method whose function is called.

    Parameters
    ----------
    method : Method
        The method.

    Returns
    -------
    context manager
        The exception goes on as it is, with one more of its `__notes__`.

    Raises
    ------
    Exception
        What the method raises.

    Examples
    --------
    >>> import eaves
    >>> from eaves.methods import naming
    >>> try:
    ...     with naming(eaves.Consensus()):
    ...         1 / 0
    ... except ZeroDivisionError as error:
    ...     error.__notes__
    ["detect method 'consensus'"]
    """
    try:
        yield
    except Exception as error:
        error.add_note(f"{method.stage} method '{method.name}'")
        raise


def check_returned(method: Method, held: bool, rule: str, value: Any) -> None:
    """Raise when what a method returned is not what its contract says.

    Parameters
    ----------
    method : Method
        The method.
    held : bool
        True if the contract is held.
    rule : str
        What the contract says is returned.
    value : object
        What was.

    Raises
    ------
    ContractError
        One line with the method, the rule, the value and the place of the contract.

    Examples
    --------
    >>> import eaves
    >>> from eaves.methods import check_returned
    >>> check_returned(eaves.Consensus(), True, "Regions", None)
    """
    if not held:
        contract = CONTRACTS[method.stage][0].replace(":", ".")
        raise ContractError(
            f"{method.stage} method '{method.name}' must return {rule}, not {describe(value)}; see {contract}"
        )


@cache
def check_contract(stage: str, cls: type[Any]) -> None:
    """Raise when a class is no method of a stage.

    Parameters
    ----------
    stage : str
        `ground`, `detect`, `outline`, `units`, `roof` or `reconstruct`.
    cls : type
        The class.

    Raises
    ------
    ContractError
        When it is not of the stage's contract, leaves a function of that out, or has no name of its own.

    Examples
    --------
    >>> import eaves
    >>> from eaves.methods import check_contract
    >>> check_contract("detect", eaves.Consensus)
    """
    place, *functions = CONTRACTS[stage]
    contract = imported(place)
    method = f"{stage} method {getattr(cls, '__qualname__', cls)}"
    if not (isinstance(cls, type) and issubclass(cls, contract)):
        raise ContractError(f"{method} must be a subclass of {contract.__name__}; see {place}")
    missing = [name for name in functions if getattr(cls, name) is getattr(contract, name)]
    if missing:
        raise ContractError(f"{method} does not define {' and '.join(missing)}; see {place}")
    if not isinstance(getattr(cls, "name", None), str):
        raise ContractError(f'{method} has no name; give its class one: name = "{cls.__name__.lower()}"')
    if cls.needs and stage not in ("ground", "detect"):
        raise ContractError(
            f"{method} needs {', '.join(cls.needs)}, which only ground and detect methods are given"
        )
    ours = methods_of(stage).get(cls.name)
    if ours is not None and imported(ours) is not cls:
        raise ContractError(f"{method} has the name of another, '{cls.name}'; give it one of its own")


def installed_methods(stage: str) -> dict[str, str]:
    """The methods of a stage that installed packages bring, by the entry points of the group `eaves.methods`.

    Parameters
    ----------
    stage : str
        `ground`, `detect`, `outline`, `units`, `roof` or `reconstruct`.

    Returns
    -------
    dict of str to str
        Name → `module:Class`; nothing is imported.

    Raises
    ------
    ValueError
        When two packages bring methods of one name.

    Examples
    --------
    >>> from eaves.methods import installed_methods
    >>> sorted(installed_methods("units"))
    []
    """
    names = {name.partition("."): place for name, place in installed(METHODS).items()}
    return {name: place for (of, _, name), place in names.items() if of == stage}


def methods_of(stage: str) -> dict[str, str]:
    """All methods of a stage: the core's, and those that installed packages bring.

    Parameters
    ----------
    stage : str
        `ground`, `detect`, `outline`, `units`, `roof` or `reconstruct`.

    Returns
    -------
    dict of str to str
        Name → `module:Class`; nothing is imported.

    Raises
    ------
    ValueError
        When there is no such stage, or two packages bring methods of one name.

    Examples
    --------
    >>> from eaves.methods import methods_of
    >>> sorted(methods_of("units"))
    ['row_walls']
    """
    if stage not in REGISTRY:
        raise ValueError(f"unknown stage {stage!r}; choose one of: {', '.join(REGISTRY)}")
    return {**REGISTRY[stage], **installed_methods(stage)}


def method_class(stage: str, name: str) -> type[Method]:
    """The class of a method of a stage by its name.

    Parameters
    ----------
    stage : str
        `ground`, `detect`, `outline`, `units`, `roof` or `reconstruct`.
    name : str
        A name in `methods_of(stage)`, or `module:Class`, which is imported.

    Returns
    -------
    type of Method
        The class.

    Raises
    ------
    ValueError
        When there is no such stage or name, where the message lists those that exist, or the class cannot be
        imported.
    ContractError
        When the class is no method of the stage.

    Examples
    --------
    >>> from eaves.methods import method_class
    >>> method_class("ground", "adaptive_tin").__name__
    'AdaptiveTin'
    """
    places = methods_of(stage)
    place = places.get(name) or (name if ":" in name else None)
    if place is None:
        raise ValueError(f"unknown {stage} method {name!r}; choose one of: {', '.join(places)}")
    cls: type[Method] = imported(place)
    check_contract(stage, cls)
    return cls


MethodChoice = Method | str | Mapping[str, Any] | None
"""A method, its name, its parameters (with its name under `method`), or None for the stage's default."""


def resolve_method(stage: str, choice: MethodChoice, published: bool | str = False) -> Method:
    """The method that a choice stands for.

    Parameters
    ----------
    stage : str
        `ground`, `detect`, `outline`, `units`, `roof` or `reconstruct`.
    choice : Method, str, mapping or None
        A method, its name, its parameters (with its name under `method`), or None for the stage's default.
    published : bool or str
        Methods given by name start from the numbers that the paper prints; a key in references.bib: only
        where the paper is this.

    Returns
    -------
    Method
        The method.

    Raises
    ------
    TypeError
        When the choice is of another type, or a method of another stage.
    ValueError
        When no method or parameter has that name, or a value is out of range.

    Examples
    --------
    >>> from eaves.methods import resolve_method
    >>> resolve_method("roof", {"method": "tin_faces"}).name
    'tin_faces'
    """
    if isinstance(choice, Method):
        of = getattr(choice, "stage", stage)
        if of != stage:
            raise TypeError(f"{type(choice).__name__} is a {of} method, and a {stage} method is wanted")
        check_contract(stage, type(choice))
        return choice
    if not isinstance(choice, str | Mapping | None):
        raise TypeError(
            f"a {stage} method is given by a value, a name or a table of parameters, not by "
            f"{type(choice).__name__}; see `eaves methods {stage}`"
        )
    table = dict(choice) if isinstance(choice, Mapping) else {"method": choice}
    cls = method_class(stage, table.pop("method", None) or DEFAULTS[stage])
    paper = published if isinstance(published, str) else None
    nested = {name: field.default for name, field in cls.model_fields.items()}
    base = {name: one.model_dump() for name, one in nested.items() if isinstance(one, Method)}
    base |= cls.as_published(paper).model_dump() if published else {}
    return cls(**merged(base, table))


def merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """A table with the values of another in place of its own, also inside the tables that both have.

    Parameters
    ----------
    base, over : mapping
        The tables; those inside them are mappings, too.

    Returns
    -------
    dict
        A table of its own.

    Raises
    ------
    AttributeError
        When one is no mapping.

    Examples
    --------
    >>> from eaves.methods import merged
    >>> merged({"houses": {"tolerance": 0.3, "empty_share": 0.1}}, {"houses": {"tolerance": 0.2}})
    {'houses': {'tolerance': 0.2, 'empty_share': 0.1}}
    """
    both = {name for name in base if all(isinstance(one.get(name), Mapping) for one in (base, over))}
    return {**base, **over, **{name: merged(base[name], over[name]) for name in base if name in both}}


def emitter(debug: str | Path | Emit | None) -> Emit:
    """The `Emit` for the `debug` argument of a stage function.

    Parameters
    ----------
    debug : str, Path, callable or None
        A folder to save arrays in (made when missing), a callback `(name, value)`, or None to keep nothing.

    Returns
    -------
    callable
        Called with the name and the value of every intermediate. Lists of arrays of several shapes become an
        archive (`.npz`) with an array each; geometries are saved as well-known text, other objects as what
        `repr` says of them. No file in the folder is a pickle, which could run code when it is loaded.

    Raises
    ------
    OSError
        When the folder cannot be made.

    Examples
    --------
    >>> from eaves.methods import emitter
    >>> emit = emitter("steps")
    >>> emit("seed points", [[0.0, 0.0, 1.0]])
    >>> from pathlib import Path
    >>> [path.name for path in Path("steps").iterdir()]
    ['seed_points.npy']
    """
    if debug is None:
        return ignore
    if callable(debug):
        return debug
    folder = Path(debug)
    folder.mkdir(parents=True, exist_ok=True)

    def save(name: str, value: Any) -> None:
        stem = folder / name.replace(" ", "_")
        if hasattr(value, "values") and hasattr(value, "cell"):  # a Raster keeps its place
            np.savez(stem, values=value.values, west=value.west, north=value.north, cell=value.cell)
            return
        try:
            np.save(stem, _without_objects(value))
        except ValueError:  # arrays of several shapes
            np.savez(stem, *map(_without_objects, value))

    return save


def _without_objects(value: Any) -> NDArray[Any]:
    """A value as an array of numbers or texts; ValueError for arrays of several shapes."""
    array = np.asarray(value)
    if not array.dtype.hasobject:
        return array
    return np.array([getattr(item, "wkt", None) or repr(item) for item in array.ravel()]).reshape(array.shape)
