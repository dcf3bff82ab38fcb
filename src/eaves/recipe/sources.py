"""Published systems: each one's whole chain, from points to what it delivers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from eaves.extensions import SOURCES, imported, installed
from eaves.methods import MethodChoice, method_class


@dataclass(frozen=True)
class PublishedSource:
    """One published system: the method of each stage, and the level of detail it ends at."""

    name: str
    paper: str
    """Key in references.bib."""
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
    name
        One of `sources()`.

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
    if name not in sources():
        raise ValueError(f"unknown source '{name}'; choose one of: {', '.join(sources())}")
    return sources()[name]


def with_source(name: str, methods: Mapping[str, MethodChoice] | None) -> dict[str, MethodChoice]:
    """The methods of a source by stage, under those that are given.

    Parameters
    ----------
    name
        One of `sources()`.
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
        method = chosen.get(stage)
        if isinstance(choice, Mapping) and "method" not in choice and isinstance(method, str):
            chosen[stage] = {"method": method, **choice}
        elif choice is not None:
            chosen[stage] = choice
    return chosen
