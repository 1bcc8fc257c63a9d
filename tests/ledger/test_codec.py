import msgspec
import pytest
from hypothesis import given

from ledger.codec import NAMES, Decoder, decode, encode, schema_of
from ledger.errors import LedgerNewer
from ledger.events import EVENTS, AnyEvent, Event, OrderPrioritised, RobotRemoved
from ledger.events.orders import OfOrder
from ledger.ids import OrderId, RobotName, SceneId
from tests.strategies import any_events


@given(any_events())
def test_every_event_says_what_every_reader_is_promised(event: AnyEvent) -> None:
    words = msgspec.json.decode(encode(event))
    assert words["type"] == type(event).__name__
    assert {"position", "at_ms", "scene", "by", "command"} <= words.keys()


@pytest.mark.parametrize("kind", EVENTS)
def test_every_event_has_a_schema_that_names_its_fields(kind: type[Event]) -> None:
    schema = msgspec.json.decode(schema_of(kind))
    assert schema["type"] == "object"
    assert set(schema["properties"]) == {"type", *kind.__struct_fields__}


class OrderUrgent(OfOrder, frozen=True, kw_only=True):
    """A retired shape: urgency was a number of its own."""

    urgency: int


def _prioritised(old: OrderUrgent) -> AnyEvent:
    return OrderPrioritised(
        position=old.position,
        at_ms=old.at_ms,
        scene=old.scene,
        by=old.by,
        command=old.command,
        order=old.order,
        priority=old.urgency * 10,
    )


OLD = OrderUrgent(position=3, at_ms=5, scene=SceneId("s"), order=OrderId("o"), urgency=4)


def test_a_retired_shape_is_read_in_todays_words() -> None:
    decoder = Decoder({OrderUrgent: _prioritised})
    event = decoder.decode(msgspec.json.encode(OLD))
    assert event == OrderPrioritised(
        position=3, at_ms=5, scene=SceneId("s"), order=OrderId("o"), priority=40
    )
    decoder.check("OrderUrgent", schema_of(OrderUrgent))


def test_an_unknown_event_comes_from_a_newer_program() -> None:
    with pytest.raises(LedgerNewer, match="OrderUrgent is an unknown type"):
        decode(msgspec.json.encode(OLD))
    with pytest.raises(LedgerNewer, match="OrderUrgent"):
        Decoder().check("OrderUrgent", schema_of(OrderUrgent))


def test_a_known_event_of_unknown_shape_comes_from_a_newer_program() -> None:
    with pytest.raises(LedgerNewer, match="RobotRemoved has an unknown shape"):
        decode(b'{"type":"RobotRemoved","scene":"s","robot":7}')


def test_our_own_schemas_are_accepted() -> None:
    for name, kind in NAMES.items():
        Decoder().check(name, schema_of(kind))


def test_a_schema_with_a_field_more_is_newer_and_with_one_less_is_not() -> None:
    schema = msgspec.json.decode(schema_of(RobotRemoved))
    del schema["properties"]["by"]
    Decoder().check("RobotRemoved", msgspec.json.encode(schema))
    schema["properties"]["reason"] = {"type": "string"}
    with pytest.raises(LedgerNewer, match="RobotRemoved has unknown reason"):
        Decoder().check("RobotRemoved", msgspec.json.encode(schema))


def test_unknown_fields_of_parts_are_noticed_too() -> None:
    schema = msgspec.json.decode(schema_of(NAMES["OrderCreated"]))
    schema["$defs"]["StepTask"]["properties"]["hurry"] = {"type": "boolean"}
    with pytest.raises(LedgerNewer, match="StepTask has unknown hurry"):
        Decoder().check("OrderCreated", msgspec.json.encode(schema))


def test_the_tag_stands_first_so_that_unions_decode_fast() -> None:
    event = RobotRemoved(scene=SceneId("s"), robot=RobotName("r"))
    assert encode(event).startswith(b'{"type":"RobotRemoved"')


def test_a_field_that_is_retired_is_neither_newer_nor_read() -> None:
    schema = msgspec.json.decode(schema_of(NAMES["RobotAdded"]))
    schema["$defs"]["RobotConfig"]["properties"]["gateway_secret"] = {"type": "string"}
    Decoder().check("RobotAdded", msgspec.json.encode(schema))
    old = b'{"type":"RobotAdded","scene":"s","config":{"name":"R","gateway_secret":"x"}}'
    assert b'"x"' not in encode(decode(old))
