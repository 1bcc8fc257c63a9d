"""What holds for every file of tests."""

import resource
from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, settings

# How fast a machine is, and what else it does, is no property of the product.
settings.register_profile("calm", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("calm")


@pytest.fixture(scope="module", autouse=True)
def limits_are_left_alone() -> Iterator[None]:
    """A limit set on this process would be every later test's, and its children's, for good.

    (The analyst's limit once was: Chromium, started after it, crashed with its first page.)
    """
    before = resource.getrlimit(resource.RLIMIT_DATA)
    yield
    assert resource.getrlimit(resource.RLIMIT_DATA) == before
