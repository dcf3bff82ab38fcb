"""Imports point one way: the contract in pyproject.toml, held by import-linter."""

from __future__ import annotations

from importlinter.api import read_configuration
from importlinter.application import use_cases


def test_imports_point_inward() -> None:
    assert read_configuration()["contracts_options"], "the contract is missing from pyproject.toml"
    report = use_cases.create_report(use_cases.read_user_options())
    broken = [contract.name for contract, check in report.get_contracts_and_checks() if not check.kept]
    assert not broken
