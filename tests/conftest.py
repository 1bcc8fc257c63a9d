"""What holds for every file of tests."""

import resource
from collections.abc import Iterator

import pytest


@pytest.fixture(scope="module", autouse=True)
def limits_are_left_alone() -> Iterator[None]:
    """A limit set on this process would be every later test's, and its children's, for good.

    (The analyst's limit once was: Chromium, started after it, crashed with its first page.)
    """
    before = resource.getrlimit(resource.RLIMIT_DATA)
    yield
    assert resource.getrlimit(resource.RLIMIT_DATA) == before
