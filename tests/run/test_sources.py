"""Recipes by source: each published system's chain, and what goes before it."""

from __future__ import annotations

from pathlib import Path

import pytest

from eaves.methods import DEFAULTS, method_class
from eaves.recipe.recipe import make_recipe
from eaves.recipe.sources import SOURCES

BIBLIOGRAPHY = (Path(__file__).parents[2] / "references.bib").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", SOURCES)
def test_a_source_names_its_methods_and_its_paper(name: str) -> None:
    source = SOURCES[name]
    recipe = make_recipe(source=name)
    assert recipe.lod == source.lod
    for stage in DEFAULTS:
        method = getattr(recipe, stage)
        if method is None:  # beyond what the source delivers
            assert stage not in source.methods
            continue
        assert method.name == source.methods.get(stage, DEFAULTS[stage])
    assert f"{{{source.paper}," in BIBLIOGRAPHY
    assert method_class("detect", source.methods["detect"]).paper == source.paper


def test_what_is_given_goes_before_the_source() -> None:
    recipe = make_recipe({"outline": "global_fit", "detect": {"curved": 0.05}}, source="xiao2014", lod="1.2")
    assert recipe.outline.name == "global_fit"
    assert recipe.detect is not None and recipe.detect.name == "normal_echo"
    assert recipe.detect.model_dump()["curved"] == 0.05
    assert recipe.ground.name == "smooth_region"
    assert recipe.lod == "1.2"


def test_an_unknown_source_is_refused_with_those_there_are() -> None:
    with pytest.raises(ValueError, match="unknown source 'xiao'; choose one of: chen_sun"):
        make_recipe(source="xiao")
