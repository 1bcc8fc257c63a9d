"""Every field that a client can be answered, by the catalogue: no other key, the right types."""

from typing import Any

import pytest

from tests.conformance.catalogue import (
    ASKED_ONLY,
    LEFT_OUT,
    NEVER_ANSWERED,
    Call,
    catalogue,
    there,
)
from tests.conformance.conftest import MISSING
from tests.conformance.form import conforms
from tests.conformance.full import full_answers
from tests.conformance.plant import Plant

CALLS = [pytest.param(call, id=call.id) for call in catalogue().calls]


def answer_form(call: Call, body: Any, seen: set[str]) -> None:
    """Check an answer; one that the source says is none has no body."""
    if call.id == "entity-find-one":  # spec/protocols.md 1.2 wraps it
        assert body.keys() == {"entityValue"}
        body = body["entityValue"]
    if call.response:
        types = {field.name: field.type for field in call.response}
        assert body.keys() <= types.keys(), body.keys() - types.keys()
        for name, value in body.items():
            seen.add(f"{call.id}.{name}")
            type_ = "List<TransportOrder>" if types[name] == "List<EntityValue>" else types[name]
            conforms(value, type_, name, seen)
    elif call.response_type is None:
        assert body is None, body
    else:
        conforms(body, call.response_type, call.id, seen)


@pytest.mark.parametrize("call", CALLS)
def test_a_real_answer_has_documented_fields_only_of_the_right_types(
    plant: Plant, call: Call
) -> None:
    seen: set[str] = set()
    answer = plant.send(call, plant.good(call))
    assert answer.status == 200, answer.body
    answer_form(call, answer.body, seen)
    missing = {f"{call.id}.{field.name}" for field in call.response} - seen
    assert not missing, missing


def test_every_field_of_every_answered_type_is_given_when_it_has_a_value(plant: Plant) -> None:
    if not there():
        pytest.skip(MISSING)
    seen: set[str] = set()
    for type_, value in full_answers():
        conforms(value, type_, type_, seen)
    (asking,) = (c for c in catalogue().calls if c.response_type == "MapResourceReply")
    conforms(plant.send(asking, plant.good(asking)).body, "MapResourceReply", asking.id, seen)
    wanted = {
        f"{name}.{field.name}"
        for name in catalogue().types.keys() - NEVER_ANSWERED - ASKED_ONLY
        for field in catalogue().fields_of(name)
    }
    assert not wanted - seen - LEFT_OUT, sorted(wanted - seen - LEFT_OUT)


def test_the_types_that_no_call_answers_are_named_here() -> None:
    if not there():
        pytest.skip(MISSING)
    assert catalogue().types.keys() >= NEVER_ANSWERED | ASKED_ONLY
