"""Towns, roofs and scans of which everything is known."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_WHERE = {
    "DEVELOPMENT_SCENES": "standard",
    "JUDGING_SCENES": "standard",
    "ExactBuilding": "exact",
    "ExactFace": "exact",
    "ExactScene": "exact",
    "Flight": "flight",
    "Scanner": "scanner",
    "StandardScene": "standard",
    "Town": "town",
    "nine_roofs_on_a_slope": "roofs",
    "scan_town": "scanner",
    "simulate_town": "town",
    "town_of_model": "city_model",
    "write_simulation": "files",
}

__all__ = list(_WHERE)


def __getattr__(name: str) -> Any:
    """Public names load their module on first use, so that no command pays for what it does not do."""
    if name not in _WHERE:
        raise AttributeError(f"module 'eaves.simulate' has no attribute '{name}'")
    return getattr(import_module(f"eaves.simulate.{_WHERE[name]}"), name)
