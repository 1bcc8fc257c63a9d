import msgspec
from hypothesis import given

from ledger.canonical import canonical_json
from ledger.scene_config import ChargingConfig, ChargingLevels, SceneConfig
from ledger.state import Fleet
from tests.strategies import values


def grouped(*groups: int) -> SceneConfig:
    return SceneConfig(charging=ChargingConfig(by_group={g: ChargingLevels() for g in groups}))


def test_the_order_in_which_maps_were_filled_does_not_show() -> None:
    assert canonical_json({"a": 1, "b": 2}) == canonical_json({"b": 2, "a": 1})
    assert canonical_json(grouped(1, 2, 10)) == canonical_json(grouped(10, 2, 1))
    assert canonical_json(grouped(1)) != canonical_json(grouped(2))


@given(values(Fleet))
def test_every_state_has_canonical_bytes_that_mean_it(fleet: Fleet) -> None:
    raw = fleet.canonical()
    assert msgspec.json.decode(raw, type=Fleet) == fleet
    assert fleet.copy().canonical() == raw
