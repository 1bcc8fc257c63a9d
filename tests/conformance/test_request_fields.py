"""Every field that a client can send, by the catalogue: its type, whether it is needed, null."""

from collections.abc import Callable
from copy import deepcopy
from typing import Any

import pytest

from tests.conformance.catalogue import (
    Call,
    Place,
    catalogue,
    container,
    element,
    request_places,
    there,
)
from tests.conformance.conftest import MISSING
from tests.conformance.plant import GOOD, Plant

# what the readings of spec/m4.md §9 say otherwise than the "required" column
NOT_NEEDED = {"external-map-res-request[].reason": "C15: an absent reason is a blank one"}
NEEDED = {
    "robots-create.robotName": "C16: refuse an empty name",
    "robots-create-batch[].robotName": "C16",
    "robots-update-config.robotName": "C16",
}
# what a field may be absent beside, where the good request makes it needed
BESIDE: dict[str, dict[str, Any]] = {
    "orders-create.steps": {"stepFixed": False},
    "gwAuthId": {"connectionType": None},
    "gwAuthSecret": {"connectionType": None},
    "external-map-res-request[].spatialZones": {"pointNames": ["LM1"]},
}
ANYTHING = frozenset({"Object", "Any", "ComplexQuery"})
CALLS = {call.id: call for call in catalogue().calls}


def places(of: Callable[[Place], bool]) -> list[Any]:
    """Parametrise over the fields that a client can send."""
    if not there():
        return [pytest.param(None, marks=pytest.mark.skip(reason=MISSING))]
    return [pytest.param(place, id=place.name) for place in request_places() if of(place)]


def part_of(place: Place) -> str:
    """Say which part of the request holds the field: the first field on the way tells."""
    fields = {field.name: field.where for field in place.call.request}
    return fields.get(place.path[0], fields.get("(body)", ""))


def may_be_wrong(place: Place) -> bool:
    """Any JSON is right for some types, and everything in a URL is a text."""
    if element(place.field.type) in ANYTHING and container(place.field.type) is None:
        return False
    return part_of(place) not in ("path", "query") or place.field.type != "String"


def holder(request: dict[str, Any], place: Place) -> Any:
    """Find what holds the field: the first element, wherever there are several."""
    at = request[part_of(place)]
    for part in place.path[:-1]:
        at = at[0] if part == "[]" else at[part]
    return at


def wrong(place: Place) -> Any:
    """Give a value of another type than the field's."""
    type_ = place.field.type
    if container(type_) == "list":
        return {"not": "a list"}
    if container(type_) == "map":
        return ["not a map"]
    if type_ in catalogue().enums:
        return "Nonsense"
    if catalogue().fields_of(type_):
        return "not an object"
    return {"String": 7, "Boolean": "perhaps", "Int": "three", "Double": "wide"}[type_]


def sent(plant: Plant, call: Call, request: dict[str, Any]) -> int:
    answer = plant.send(call, request)
    assert answer.status in (200, 400), answer
    if answer.status == 400:
        assert {"code", "message", "args"} <= answer.body.keys()
        assert answer.body["message"]
    return answer.status


@pytest.mark.parametrize("call", [pytest.param(c, id=c.id) for c in catalogue().calls])
def test_a_good_request_with_every_field_is_taken(plant: Plant, call: Call) -> None:
    answer = plant.send(call, plant.good(call))
    assert answer.status == 200, answer.body


def test_there_is_a_good_request_for_every_call() -> None:
    if not there():
        pytest.skip(MISSING)
    assert GOOD.keys() == CALLS.keys()


@pytest.mark.parametrize("place", places(may_be_wrong))
def test_a_value_of_another_type_is_refused_by_the_name_of_its_field(
    plant: Plant, place: Place
) -> None:
    request = deepcopy(plant.good(place.call))
    holder(request, place)[place.path[-1]] = wrong(place)
    answer = plant.send(place.call, request)
    assert answer.status == 400, f"{place.name} took {wrong(place)!r}: {answer}"
    assert place.path[-1] in answer.body["message"], answer.body


@pytest.mark.parametrize("place", places(lambda place: part_of(place) != "path"))
def test_what_is_required_is_demanded_and_the_rest_may_be_absent_or_null(
    plant: Plant, place: Place
) -> None:
    needed = place.name in NEEDED or (place.field.required and place.name not in NOT_NEEDED)
    beside = BESIDE.get(place.name, BESIDE.get(place.path[-1], {}))
    request = deepcopy(plant.good(place.call))
    holder(request, place).update(beside)
    del holder(request, place)[place.path[-1]]
    answer = plant.send(place.call, request)
    if needed:
        assert answer.status == 400, f"{place.name} is required: {answer}"
        assert place.path[-1] in answer.body["message"], answer.body
        return
    assert answer.status == 200, f"{place.name} is optional: {answer}"
    if part_of(place) in ("body", "content"):
        request = deepcopy(plant.good(place.call))
        holder(request, place).update(beside | {place.path[-1]: None})
        answer = plant.send(place.call, request)
        assert answer.status == 200, f"{place.name} may be null: {answer}"


@pytest.mark.parametrize("place", places(lambda place: place.field.type == "String"))
def test_an_unknown_scene_robot_or_order_is_refused_not_failed(plant: Plant, place: Place) -> None:
    for strange in ("", "nobody", "\ud800", "\0", "x" * 5_000):
        request = deepcopy(plant.good(place.call))
        if part_of(place) == "path" and strange in ("", "\ud800"):
            continue  # another path, or none that can be sent
        if part_of(place) == "query" and strange == "\ud800":
            continue
        holder(request, place)[place.path[-1]] = strange
        if part_of(place) == "path" and strange == "\0":
            holder(request, place)[place.path[-1]] = "%00"
        sent(plant, place.call, request)
