"""Whatever the OpenAPI document allows, and much that it does not, sent by Schemathesis.

The answers must be of the documented statuses, types and shapes, and none may be a failure.
"""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import hypothesis
import pytest
import schemathesis
from hypothesis import HealthCheck, given, settings
from schemathesis import Case
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from tests.fleetledger.server import Server, serving, small_scene

EXAMPLES = 12  # of each operation
EXAMPLES_LONG = 30
SECONDS_MAX = 30.0
FOLLOWING = frozenset({"/api/ledger/events"})  # may stream for ever
CHECKS = [
    not_a_server_error,
    status_code_conformance,
    content_type_conformance,
    response_schema_conformance,
]


@contextmanager
def opened(folder: Path) -> Iterator[Server]:
    scene = ("--scene", str(small_scene(folder)))
    with serving(folder / "data", "--auth", "none", "--simulate", *scene) as server:
        yield server


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with opened(tmp_path_factory.mktemp("openapi")) as server:
        yield server


def held_to_the_document(server: Server, examples: int, seed: int = 0) -> None:
    """Draw cases for one operation after the other.

    Schemathesis' own parametrisation needs the document when tests are collected.
    """
    schema = schemathesis.openapi.from_url(f"{server.url}/openapi.json")
    for found in schema.get_all_operations():
        operation = found.ok()
        if operation.path in FOLLOWING:
            continue

        @hypothesis.seed(seed)
        @settings(max_examples=examples, deadline=None, suppress_health_check=list(HealthCheck))
        @given(case=operation.as_strategy())
        def holds(case: Case) -> None:
            case.call_and_validate(checks=CHECKS, timeout=SECONDS_MAX)

        holds()


def test_every_operation_keeps_to_the_document(server: Server) -> None:
    held_to_the_document(server, EXAMPLES)


def stage(seed: int) -> None:
    """For the soak: other cases each time."""
    with tempfile.TemporaryDirectory() as folder, opened(Path(folder)) as server:
        held_to_the_document(server, EXAMPLES_LONG, seed)
