"""The five systems that eaves brings together: each one's whole chain, from points to what it delivers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from eaves.methods import MethodChoice


@dataclass(frozen=True)
class PublishedStep:
    """One step of a document: in its words, the stage that holds it, the parameters that switch it off."""

    words: str
    stage: str
    off: Mapping[str, Any]


@dataclass(frozen=True)
class PublishedSource:
    """One published system: the method of each stage, and the level of detail it ends at."""

    name: str
    paper: str
    """Key in references.bib."""
    delivers: str
    methods: Mapping[str, str]
    lod: str
    steps: tuple[PublishedStep, ...] = ()
    """Those that a parameter switches off: each can be measured (benchmarks/accuracy/sources_ablation.py)."""


SOURCES: dict[str, PublishedSource] = {
    source.name: source
    for source in (
        PublishedSource(
            "chen_sun",
            "chen_sun_vaihingen",
            "a mask and the contours of buildings",
            {"ground": "adaptive_tin", "detect": "planar_patches", "outline": "alpha_shape"},
            "0",
            (
                PublishedStep("patches: planar cells", "detect", {"max_rmse": 100.0}),
                PublishedStep("at least 2 m over the DTM", "detect", {"min_height": 0.0}),
                PublishedStep("facades go", "detect", {"max_slope": 89.99}),
                PublishedStep("region growth", "detect", {"max_distance": 1e-9}),
                PublishedStep("small planes take no part", "detect", {"min_cells": 1, "min_points": 0.5}),
                PublishedStep("contour by alpha shape", "detect", {"alpha": 1e-3, "min_hole": 0.0}),
            ),
        ),
        PublishedSource(
            "xiao2014",
            "xiao2014",
            "3D models of intersected roof planes inside regular outlines",
            {
                "ground": "smooth_region",
                "detect": "normal_echo",
                "outline": "ransac_lines",
                "roof": "region_growing",
                "reconstruct": "plane_intersection",
            },
            "2.2",
            (
                PublishedStep("walls by normals", "ground", {"wall_angle": 90.0}),
                PublishedStep("trees by echoes", "ground", {"tree_share": 1.0}),
                PublishedStep("small regions are noise", "ground", {"noise_area": 0.0}),
                PublishedStep("area", "detect", {"min_area": 0.0, "min_width": 0.0}),
                PublishedStep("width to height", "detect", {"min_width_to_height": 0.0}),
                PublishedStep("mean density", "detect", {"min_density": 0.0}),
                PublishedStep("share of high curvature", "detect", {"max_curved": 1.0}),
            ),
        ),
        PublishedSource(
            "ren_fcs",
            "ren_fcs",
            "the areas of buildings, on undulating terrain and beside vegetation",
            {"ground": "contours", "detect": "contours", "outline": "alpha_shape"},
            "0",
            (
                PublishedStep("closed contours: length", "ground", {"longest_outline": 1e6}),
                PublishedStep("open contours: end distance", "ground", {"end_distance": 1e-3}),
                PublishedStep("iteration of the DTM", "ground", {"rounds": 1}),
                PublishedStep("low objects go", "detect", {"min_height": 0.0}),
                PublishedStep("edge information (Sobel)", "detect", {"min_edge": 0.0}),
                PublishedStep("quadratic gradient", "detect", {"max_bend": 1e6}),
                PublishedStep("size", "detect", {"min_area": 0.0}),
                PublishedStep("final iteration", "detect", {"min_share": 1.0, "regrow": 0.0}),
            ),
        ),
        PublishedSource(
            "roof_attributes",
            "roof_attributes",
            "the points of buildings",
            {"ground": "adaptive_tin", "detect": "roof_attributes", "outline": "alpha_shape"},
            "0",
            (
                PublishedStep("gradient density", "detect", {"max_density": 1.0}),
                PublishedStep("surface roughness", "detect", {"max_roughness": 1e6}),
                PublishedStep("operator 1: like normals", "detect", {"like_neighbours": 0}),
                PublishedStep("operator 2: opening", "detect", {"min_area": 0.0, "min_width": 1e-3}),
                PublishedStep("operator 3: reconstruction", "detect", {"min_share": 1.0, "regrow": 0.0}),
            ),
        ),
        PublishedSource(
            "maas_vosselman",
            "maas_vosselman1999",
            "3D models: standard houses from moments, others from intersected faces",
            {
                "ground": "adaptive_tin",
                "detect": "height_texture",
                "outline": "ransac_lines",
                "roof": "tin_faces",
                "reconstruct": "maas_vosselman",
            },
            "2.2",
            (
                PublishedStep("height texture", "detect", {"max_texture": 1e6}),
                PublishedStep("opening", "detect", {"min_width": 1e-3}),
                PublishedStep("size", "detect", {"min_area": 0.0}),
                PublishedStep("height histogram", "detect", {"max_low": 1.0}),
            ),
        ),
    )
}
"""Name → source. What a document leaves open (an outline, a ground filter) takes what is nearest to it."""


def find_source(name: str) -> PublishedSource:
    """The source of a name.

    Parameters
    ----------
    name
        One of `SOURCES`.

    Returns
    -------
    Source

    Raises
    ------
    ValueError
        When there is none of that name; it lists those there are.

    Examples
    --------
    >>> from eaves.recipe.sources import find_source
    >>> find_source("xiao2014").methods["ground"]
    'smooth_region'
    """
    if name not in SOURCES:
        raise ValueError(f"unknown source '{name}'; choose one of: {', '.join(SOURCES)}")
    return SOURCES[name]


def with_source(name: str, methods: Mapping[str, MethodChoice] | None) -> dict[str, MethodChoice]:
    """The methods of a source by stage, under those that are given.

    Parameters
    ----------
    name
        One of `SOURCES`.
    methods
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
    >>> from eaves.recipe.sources import with_source
    >>> with_source("chen_sun", {"outline": "global_fit"})["outline"]
    'global_fit'
    """
    chosen: dict[str, MethodChoice] = dict(find_source(name).methods)
    for stage, choice in (methods or {}).items():
        own = chosen.get(stage)
        if isinstance(choice, Mapping) and "method" not in choice and isinstance(own, str):
            chosen[stage] = {"method": own, **choice}
        elif choice is not None:
            chosen[stage] = choice
    return chosen
