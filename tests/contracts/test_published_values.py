"""Every published value stands in its paper, in the words of the document, or switches off a step of ours."""

from __future__ import annotations

from typing import Any

import pytest

from eaves.methods import REGISTRY, Method, method_class, methods_of, parameter
from eaves.recipe.recipe import make_recipe, sources

QUOTES: dict[tuple[str, str], str] = {
    ("planar_patches", "cell"): "the grid size is set to 1.5 m by 1.5 m",
    ("planar_patches", "max_rmse"): "is less than a threshold of 0.1 m",
    ("planar_patches", "min_height"): "at least 2 m higher than local average DTM",
    ("planar_patches", "max_distance"): "to the plane is less than 0.1 m",
    ("planar_patches", "join_points"): "more than a threshold (10 points or",
    ("planar_patches", "join_share"): "or 40% of the total in our case",
    ("planar_patches", "min_cells"): "planes consist of less than 3 grids",
    ("planar_patches", "min_points"): "or planes with less than 10 points",
    ("planar_patches", "alpha"): "a large value (in our case 2.4 m)",
    ("planar_patches", "min_hole"): "Inner boundaries of a building with an area of less than 50 m²",
    ("alpha_shape", "alpha"): "a large value (in our case 2.4 m)",
    ("alpha_shape", "min_hole"): "Inner boundaries of a building with an area of less than 50 m²",
}
"""The words in which each number is printed: `references.bib` of the method's paper, at `printed_in`."""
NUMBERS_OF_STEPS = {
    "planar_patches": "fit_points",
    "smooth_region": "neighbours smooth_angle area_cell",
    "normal_echo": "neighbours wall_angle max_later smooth_angle noise_area join curved on_roof",
    "ransac_lines": "alpha near skip shortest tolerance corner_reach",
    "region_growing": "min_area neighbours max_curvature normal_threshold distance_share gap_share max_slope "
    "fewest_neighbours most_neighbours normal_error curved_share line_neighbours noise_sample "
    "calm_share",
    "plane_intersection": "extension level_jump clutter_reach clutter_step smallest",
    "contours": "cell_least interval tolerance rise window storey max_step cell edge_height",
    "roof_attributes": "min_height window storey max_step cell steep like_normal",
    "height_texture": "min_height window storey max_step cell",
    "tin_faces": "min_area cell least_cell finish",
    "maas_vosselman": "least_fill smallest_primitive houses faces",
}
"""Parameters without which a step could not run, or that nothing reads when its rule is off."""
OF_SOURCES = sorted({step for source in sources().values() for step in source.methods.items()})
PUBLISHED = [
    (stage, name, key, field.json_schema_extra)
    for stage, names in ((stage, methods_of(stage)) for stage in REGISTRY)
    for name in names
    for key, field in method_class(stage, name).model_fields.items()
    if isinstance(field.json_schema_extra, dict) and field.json_schema_extra.get("published") is not None
]


def test_no_quote_is_left_over() -> None:
    assert {(name, key) for _, name, key, _ in PUBLISHED} == set(QUOTES)


@pytest.mark.parametrize(("stage", "name", "key", "extra"), PUBLISHED)
def test_a_published_value_is_printed(stage: str, name: str, key: str, extra: dict[str, Any]) -> None:
    value = float(extra["published"])
    assert extra["printed_in"]
    words = QUOTES[name, key]
    assert f"{value:g} " in words or f"{value:.0%}" in words


@pytest.mark.parametrize("stage", REGISTRY)
def test_what_is_not_printed_keeps_our_default__and_what_the_paper_has_not_is_off(stage: str) -> None:
    for name in methods_of(stage):
        cls = method_class(stage, name)
        default, published = cls().model_dump(), cls.as_published().model_dump()
        changed = {key for key in default if default[key] != published[key]}
        ours = {k: note for k, note in cls.declared().items() if note["published"] is None}
        off = {k for k, note in ours.items() if note["off"] is not None and note["step"] is None}
        assert off <= changed <= off | {key for _, other, key, _ in PUBLISHED if other == name}


@pytest.mark.parametrize(("stage", "name"), [one for one in OF_SOURCES if one[1] != "adaptive_tin"])
def test_every_parameter_of_a_source_is_printed_or_can_be_off_or_is_the_number_of_a_step(
    stage: str, name: str
) -> None:
    notes = method_class(stage, name).declared()
    needed = {key for key, note in notes.items() if note["published"] is None and note["off"] is None}
    assert needed <= set(NUMBERS_OF_STEPS.get(name, "").split())


@pytest.mark.parametrize("source", sources())
def test_as_published_prints_come_from_the_sources_paper__and_ours_is_off(source: str) -> None:
    ours, published = make_recipe(source=source), make_recipe(source=source, published=True)
    assert (published.vegetation, published.marks_others, published.units) == (None, False, None)
    for stage in sources()[source].methods:
        method, default = getattr(published, stage), getattr(ours, stage)
        for key, note in method.declared().items():
            value = getattr(method, key)
            if note["published"] is not None and method.paper == sources()[source].paper:
                assert value == note["published"]
            elif note["off"] is not None and note["step"] is None:
                assert value == note["off"]
            elif isinstance(value, Method):
                paper = sources()[source].paper
                assert value == value.model_copy(update=value.published_values(paper))
            else:
                assert value == getattr(default, key)


def test_a_published_value_without_its_place_is_refused() -> None:
    with pytest.raises(ValueError, match="go together"):
        parameter(1.0, "A number.", published=2.0)


@pytest.mark.parametrize("published", [False, True])
def test_a_parameter_of_a_nested_method_changes_that_alone(published: bool) -> None:
    table = {"reconstruct": {"houses": {"ground_plan": False}}}
    recipe = make_recipe(table, source="maas_vosselman", published=published)
    plain = make_recipe(source="maas_vosselman", published=published)
    houses = {**plain.reconstruct.model_dump()["houses"], "ground_plan": False}
    assert recipe.reconstruct.model_dump() == {**plain.reconstruct.model_dump(), "houses": houses}
