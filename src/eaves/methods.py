"""Methods as values, and the registry that names them.

A method is a frozen pydantic model: its parameters are its fields, each declared once by `parameter(...)`
with default, sentence, unit, range and the paper's symbol. Names pick methods only at the border (command
line, configuration file); in Python one writes `classify_ground(cloud, AdaptiveTin(seed_cell=80))`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

Emit = Callable[[str, Any], None]
"""Receives every named intermediate of a method: `emit("seed points", xyz)`."""


def ignore(name: str, value: Any) -> None:
    """The `Emit` that keeps nothing."""


def parameter(
    default: Any,
    sentence: str,
    *,
    unit: str = "1",
    symbol: str | None = None,
    published: Any = None,
    **limits: float,
) -> Any:
    """Declare a method's parameter once.

    `default=None` means: derived from the measured spacing and noise, by the rule the sentence states.
    `published` is the number the paper prints, used by `Method.as_published()`. `limits` are pydantic's
    `ge, gt, le, lt`.
    """
    extra = {"unit": unit, "symbol": symbol, "published": published}
    declared: dict[str, Any] = {"description": sentence, "json_schema_extra": extra, **limits}
    return Field(default, **declared)


class Method(BaseModel):
    """A published method with its parameters: frozen, comparable, picklable, printable."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    stage: ClassVar[str]
    name: ClassVar[str]
    idea: ClassVar[str]
    """One sentence for `eaves methods`."""
    paper: ClassVar[str]
    """Key in references.bib."""

    @property
    def buffer(self) -> float:
        """How far away (m) a point can be and still change the answer here."""
        return 0.0

    @classmethod
    def as_published(cls) -> Self:
        """The method with every number its paper prints."""
        printed = {
            name: extra["published"]
            for name, field in cls.model_fields.items()
            if isinstance(extra := field.json_schema_extra, dict) and extra.get("published") is not None
        }
        return cls(**printed)


DEFAULTS: dict[str, str] = {
    "ground": "adaptive_tin",
    "detect": "consensus",
    "outline": "global_fit",
    "units": "row_walls",
    "roof": "global_refinement",
    "reconstruct": "arrangement",
}

REGISTRY: dict[str, dict[str, str]] = {
    "ground": {
        "adaptive_tin": "eaves.ground.adaptive_tin:AdaptiveTin",
        "smooth_region": "eaves.ground.smooth_region:SmoothRegion",
        "contours": "eaves.ground.contours:ContourGround",
    },
    "detect": {
        "planar_patches": "eaves.detect.planar_patches:PlanarPatches",
        "consensus": "eaves.detect.consensus:Consensus",
        "contours": "eaves.detect.contours:Contours",
        "roof_attributes": "eaves.detect.roof_attributes:RoofAttributes",
        "height_texture": "eaves.detect.height_texture:HeightTexture",
        "normal_echo": "eaves.detect.normal_echo:NormalEcho",
        "given_classes": "eaves.detect.given_classes:GivenClasses",
    },
    "outline": {
        "alpha_shape": "eaves.outline.alpha_shape:AlphaShape",
        "global_fit": "eaves.outline.global_fit:GlobalFit",
        "ransac_lines": "eaves.outline.ransac_lines:RansacLines",
    },
    "units": {
        "row_walls": "eaves.units.row_walls:RowWalls",
    },
    "roof": {
        "region_growing": "eaves.roof.region_growing:RegionGrowing",
        "global_refinement": "eaves.roof.global_refinement:GlobalRefinement",
        "tin_faces": "eaves.roof.tin_faces:TinFaces",
    },
    "reconstruct": {
        "prism": "eaves.reconstruct.prism:Prism",
        "moments": "eaves.reconstruct.moments:Moments",
        "plane_intersection": "eaves.reconstruct.plane_intersection:PlaneIntersection",
        "arrangement": "eaves.reconstruct.arrangement:Arrangement",
    },
}
"""Stage → name → where the class is. A new method is one line here and one file there."""


def method_class(stage: str, name: str) -> type[Method]:
    """The class registered under a name; ValueError lists the names there are."""
    try:
        module, attribute = REGISTRY[stage][name].split(":")
    except KeyError:
        known = ", ".join(REGISTRY.get(stage, REGISTRY))
        raise ValueError(f"unknown {stage} method '{name}'; choose one of: {known}") from None
    found: type[Method] = getattr(import_module(module), attribute)
    return found


def make_method(
    stage: str, name: str | None = None, parameters: dict[str, Any] | None = None, published: bool = False
) -> Method:
    """The method of a stage by name (None: the default), with parameters; ValueError names the bad one."""
    cls = method_class(stage, name or DEFAULTS[stage])
    unknown = set(parameters or {}) - set(cls.model_fields)
    if unknown:
        raise ValueError(
            f"unknown parameter '{min(unknown)}' of {stage} method '{cls.name}'; "
            f"it has: {', '.join(cls.model_fields) or 'none'}"
        )
    base = cls.as_published().model_dump() if published else {}
    return cls(**{**base, **(parameters or {})})


MethodChoice = Method | str | Mapping[str, Any] | None
"""A method, its name, its parameters (with its name under `method`), or None for the stage's default."""


def resolve_method(stage: str, choice: MethodChoice, published: bool = False) -> Method:
    """The method that is meant.

    Raises
    ------
    TypeError
        When the choice is of another type, or a method of another stage.
    ValueError
        When no method or parameter has that name, or a value is out of range.
    """
    if isinstance(choice, Method):
        if choice.stage != stage:
            raise TypeError(
                f"{type(choice).__name__} is a {choice.stage} method, and a {stage} method is wanted"
            )
        return choice
    if choice is None or isinstance(choice, str):
        return make_method(stage, choice, None, published)
    if isinstance(choice, Mapping):
        table = dict(choice)
        return make_method(stage, table.pop("method", None), table, published)
    raise TypeError(
        f"a {stage} method is given by a value, a name or a table of parameters, not by "
        f"{type(choice).__name__}; see `eaves methods {stage}`"
    )


def emitter(debug: str | Path | Emit | None) -> Emit:
    """The `Emit` for a verb's `debug=` argument: a callback, a folder to save arrays in, or None."""
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
        else:
            np.save(stem, np.asarray(value, object if isinstance(value, list | tuple) else None))

    return save
