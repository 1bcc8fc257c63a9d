"""The table of conformance is fresh and full, and names tests that exist and look at the field."""

from fnmatch import fnmatchcase
from types import ModuleType
from typing import Any

import pytest

from tests.conformance import (
    test_ground_asked,
    test_order_meanings,
    test_orders_asked,
    test_robot_meanings,
    test_robots_asked,
    test_scene_meanings,
)
from tests.conformance.catalogue import there
from tests.conformance.conftest import MISSING
from tests.conformance.meaning import MEANING, held_by, pattern_of
from tests.conformance.page import PAGE, functions_in, names, page, unheld

TESTS = sorted({test for tests in MEANING.values() for test in tests})
# what a test with a line for each field looks at without a line of its own
SEEN_ALL_THE_SAME = (
    "orders-*.steps",  # the list that the fields are sent in
    "robots-*.robotName",  # by which the robot is found afterwards
    "robots-create-auto-batch.robotIpStart",  # robotIp, by its name there
    "external-map-res-request[[]].spatialZones[[]].points*",  # of `spatialZones`
    "ws-scene-query.doors",  # in which the device is found
    "ws-scene-query.lifts",
    "SceneConfig.chargingConfig",  # in which the level is found
    "SceneChargingConfig.*",
)
WITH_LINES: dict[str, ModuleType] = {
    f"{module.__name__.replace('.', '/')}.py": module
    for module in (
        test_ground_asked,
        test_order_meanings,
        test_orders_asked,
        test_robot_meanings,
        test_robots_asked,
        test_scene_meanings,
    )
}
_wants_catalogue = pytest.mark.skipif(not there(), reason=MISSING)


@pytest.mark.parametrize("named", TESTS)
def test_every_test_that_the_table_names_exists(named: str) -> None:
    path, _, function = named.partition("::")
    assert function in functions_in(path), named


@_wants_catalogue
def test_the_page_is_fresh() -> None:
    assert PAGE.read_text() == page(), "run `make docs`"


@_wants_catalogue
def test_every_call_and_every_field_has_a_test_of_its_meaning() -> None:
    assert not unheld()


@_wants_catalogue
def test_every_pattern_holds_something() -> None:
    assert {pattern_of(name) for name in names()} == MEANING.keys()


def lines_of(test: str) -> set[str] | None:
    """Give the fields that a test of this folder has a line for; None if it has no such table."""
    path, _, function = test.partition("::")
    if path not in WITH_LINES:
        return None
    for mark in getattr(getattr(WITH_LINES[path], function), "pytestmark", ()):
        if mark.name != "parametrize":
            continue
        keys: Any = mark.args[0]
        keys = [key.strip() for key in keys.split(",")] if isinstance(keys, str) else list(keys)
        if keys[0] in ("field", "name") and function.startswith("test_a_"):
            return {value if len(keys) == 1 else value[0] for value in mark.args[1]}
    return None


@_wants_catalogue
def test_a_test_with_a_line_for_each_field_has_one_for_each_that_it_is_named_for() -> None:
    missing = []
    for name in names():
        lines = lines_of(held_by(name)[0])
        exempt = any(fnmatchcase(name, pattern) for pattern in SEEN_ALL_THE_SAME)
        if lines is not None and not exempt and name.rpartition(".")[2] not in lines:
            missing.append(name)
    assert not missing
