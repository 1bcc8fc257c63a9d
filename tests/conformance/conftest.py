"""One plant for all tests of conformance."""

from collections.abc import Iterator

import pytest

from tests.conformance.plant import Plant, plant_in

MISSING = "no catalogue beside the repository (../shared/spec/catalogue.yaml)"


@pytest.fixture(scope="package")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plant]:
    """A running server."""
    with plant_in(tmp_path_factory.mktemp("plant") / "data") as plant:
        yield plant
