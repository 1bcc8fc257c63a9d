"""The golden examples of the specification, which lies beside the repository and may be missing.

Those of M4 are in the repository too, so that their tests never skip.
"""

import json
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "../shared/spec/examples"
KEPT = {"m4": ROOT / "fleetledger" / "examples"}  # the same, for the document that is served


def folder(dialect: str) -> Path:
    """Find the examples of a dialect, or our copy of them, or skip the test."""
    found = EXAMPLES / dialect
    if not found.is_dir():
        found = KEPT.get(dialect, found)
    if not found.is_dir():
        pytest.skip(f"no examples of {dialect} beside the repository (../shared/spec/examples)")
    return found


def example(dialect: str, name: str) -> Any:
    """Read one example: `example("m4", "orders-create.request")`."""
    return json.loads((folder(dialect) / f"{name}.json").read_text())


def same_form(expected: Any, actual: Any, where: str = "") -> None:
    """Same keys and same JSON types, all the way down; null fits anything."""
    if expected is None or actual is None:
        return
    assert type(expected) is type(actual), f"{where}: {expected!r} against {actual!r}"
    if isinstance(expected, dict):
        assert expected.keys() == actual.keys(), where
        for key in expected:
            same_form(expected[key], actual[key], f"{where}.{key}")
    if isinstance(expected, list) and expected:
        for index, item in enumerate(actual):
            same_form(expected[0], item, f"{where}[{index}]")
