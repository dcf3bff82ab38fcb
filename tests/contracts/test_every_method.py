"""The laws of every registered method, whatever its stage (docs/conventions.md, Laws)."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from eaves.methods import REGISTRY, method_class, methods_of, resolve_method
from eaves.simulate.objects.houses import ExactScene
from eaves.testing import LAWS

EVERY = [(stage, name) for stage in REGISTRY for name in methods_of(stage)]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
@pytest.mark.parametrize(("stage", "name"), EVERY)
def test_a_method_holds_a_law(
    stage: str, name: str, law: Callable[..., None], nine_roofs: ExactScene
) -> None:
    law(resolve_method(stage, name), nine_roofs)


@pytest.mark.parametrize(("stage", "name"), EVERY)
def test_as_published_it_is_a_value_too(stage: str, name: str, nine_roofs: ExactScene) -> None:
    cls = method_class(stage, name)
    LAWS[0](cls.as_published(), nine_roofs)
    assert (cls.name, cls.stage) == (name, stage)


@pytest.mark.parametrize(("stage", "name"), EVERY)
def test_its_paper_is_in_the_references(stage: str, name: str) -> None:
    keys = re.findall(r"@\w+\{([^,]+),", Path("references.bib").read_text(encoding="utf-8"))
    cls = method_class(stage, name)
    assert cls.paper in keys
    assert "Fidelity" in (cls.__doc__ or "")
