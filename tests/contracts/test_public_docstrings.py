"""Every public name is documented: parameters, returns, errors and an example; methods with their paper."""

from __future__ import annotations

import inspect
import re
from dataclasses import fields, is_dataclass
from importlib import import_module
from typing import Any

import pytest

from eaves.methods import REGISTRY, Method, method_class, methods_of

MODULES = (
    *("eaves", "eaves.formats", "eaves.evaluate", "eaves.simulate", "eaves.validate", "eaves.model"),
    *("eaves.methods", "eaves.recipe.recipe"),
)
NEVER_RAISE = {"ignore", "is_named"}
"""Functions without a way to fail."""
HEADING = re.compile(r"^(\w[\w ]*)\n-{3,}$", re.MULTILINE)


def names_of(module: Any) -> list[str]:
    """The public names of a module: `__all__`, or what it defines itself."""
    own = [name for name in vars(module) if getattr(vars(module)[name], "__module__", "") == module.__name__]
    return sorted(getattr(module, "__all__", own))


PUBLIC = {
    f"{thing.__module__}.{thing.__qualname__}": thing
    for name in MODULES
    for module in [import_module(name)]
    for thing in (getattr(module, public) for public in names_of(module))
    if (inspect.isclass(thing) or inspect.isfunction(thing)) and not thing.__name__.startswith("_")
}
FUNCTIONS = [name for name, thing in PUBLIC.items() if inspect.isfunction(thing)]
METHODS = [method_class(stage, name) for stage in REGISTRY for name in methods_of(stage)]
CLASSES = [name for name, thing in PUBLIC.items() if inspect.isclass(thing) and thing not in METHODS]


def sections_of(thing: Any) -> dict[str, str]:
    """Heading → text of a numpydoc docstring; the first part under an empty heading."""
    pieces = HEADING.split(inspect.cleandoc(thing.__doc__ or ""))
    return dict(zip(["", *pieces[1::2]], (piece.strip() for piece in pieces[::2]), strict=True))


def documented(sections: dict[str, str]) -> dict[str, str]:
    """Parameter → type of the section Parameters."""
    found = {}
    for line in sections.get("Parameters", "").splitlines():
        if line and not line.startswith(" "):
            names, _, kind = line.partition(" : ")
            found |= {name.strip().lstrip("*"): kind.strip() for name in names.split(",")}
    return found


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_has_all_sections(name: str) -> None:
    thing = PUBLIC[name]
    sections, signature = sections_of(thing), inspect.signature(thing)
    assert sections[""], "the first sentence is missing"
    parameters = documented(sections)
    assert set(parameters) == set(signature.parameters)
    assert all(parameters.values()), "a parameter has no type"
    if signature.return_annotation not in (None, "None"):
        assert sections.get("Returns")
    if thing.__name__ not in NEVER_RAISE:
        assert sections.get("Raises")
    assert ">>>" in sections.get("Examples", "")


@pytest.mark.parametrize("name", CLASSES)
def test_a_class_has_its_fields_and_an_example(name: str) -> None:
    thing = PUBLIC[name]
    sections = sections_of(thing)
    assert sections[""], "the first sentence is missing"
    assert ">>>" in sections.get("Examples", "")
    if is_dataclass(thing):
        parameters = documented(sections)
        assert list(parameters) == [field.name for field in fields(thing) if field.init]
        assert all(parameters.values()), "a field has no type"


@pytest.mark.parametrize("method", METHODS, ids=lambda method: f"{method.stage}-{method.name}")
def test_a_method_is_documented_as_its_paper(method: type[Method]) -> None:
    """Parameters are written from their declarations (docs/reference/methods)."""
    sections = sections_of(method)
    assert list(sections) == ["", "Formula", "Fidelity", "Fails where", "Complexity", "References"]
    assert all(sections.values())
    assert f"[{method.paper}]" in "".join(sections.values())
