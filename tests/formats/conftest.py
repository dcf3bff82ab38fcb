"""What the tests of formats share."""

from __future__ import annotations

import json
from types import ModuleType

import pytest


@pytest.fixture
def cjio(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module cjio.cityjson, without its rounding of every float the process writes as JSON.

    On import it replaces parts of `json.encoder`, after which PROJJSON loses digits and systems their code.
    """
    monkeypatch.setattr(json.encoder, "c_make_encoder", json.encoder.c_make_encoder)
    monkeypatch.setattr(json.encoder, "float", float, raising=False)
    module: ModuleType = pytest.importorskip("cjio.cityjson")
    return module
