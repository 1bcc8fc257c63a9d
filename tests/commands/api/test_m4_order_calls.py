from collections.abc import Iterable

import pytest

from ledger.events import AnyEvent, OrderFaulted
from ledger.ids import OrderId
from tests.commands.api.application import Site, site
from tests.commands.site import BINS, ORDER, SCENE, created, opened, task
from tests.golden import example, same_form

BASE = "/api/fleet/orders"


def seen(numbers: Iterable[int], *, sealed: bool = True) -> list[AnyEvent]:
    """Orders with the ids of the examples: all numbers up to the last of them were given out."""
    return [created(OrderId(f"TO20250806-{n:06}"), *[task()] * 6, sealed=sealed) for n in numbers]


async def test_the_example_of_creation_is_answered_in_its_form() -> None:
    there = site()
    answer = await there.post(f"{BASE}/create", example("m4", "orders-create.request"))
    assert answer.status_code == 200
    same_form(example("m4", "orders-create.response"), answer.json())
    assert answer.json() == {"orderId": ORDER, "externalId": None}
    order = there.handler.fleet.orders[ORDER]
    assert order.key_locations == BINS
    assert order.container == f"container-{ORDER}"
    assert order.created_by == "alice"
    assert [s.task.arguments for s in order.steps] == ['{"binTask":"Load"}', '{"binTask":"Unload"}']
    assert [s.task.withdrawable for s in order.steps] == [True, False]


async def test_an_answer_waits_for_the_disk_and_names_its_position() -> None:
    there = site()
    answer = await there.post(f"{BASE}/create", {"sceneId": SCENE, "keyLocations": ["AP110"]})
    assert there.waited == [2]
    assert answer.headers["X-Ledger-Position"] == "2"


@pytest.mark.parametrize(
    ("call", "name", "sealed"),
    [
        ("add-steps", "orders-add-steps", False),
        ("update-steps", "orders-update-steps", True),
        ("complete-order", "orders-complete", False),
        ("cancel", "orders-cancel", True),
        ("cancel-all", "orders-cancel-all", True),
        ("update-priority-batch", "orders-update-priority-batch", True),
    ],
)
async def test_examples_without_an_answer_are_answered_by_nothing(
    call: str, name: str, sealed: bool
) -> None:
    body = example("m4", f"{name}.request")
    there = site(*opened(), *seen(range(1, 32), sealed=sealed))
    if call == "cancel-all":
        body |= {"sceneId": SCENE}
    before = there.handler.fleet.position
    answer = await there.post(f"{BASE}/{call}", body)
    assert (answer.status_code, answer.content) == (200, b"")
    assert there.handler.fleet.position > before


async def test_the_example_of_deletion_says_which_step_is_unknown() -> None:
    there = site(*opened(), *seen(range(1, 32)))
    body = example("m4", "orders-delete-steps.request")
    answer = await there.post(f"{BASE}/delete-steps", body)
    assert answer.status_code == 400  # its ids are of the vendor's own making (C10)
    assert answer.json()["code"] == "errStepNotFound"
    body |= {"stepIds": ["TO20250806-000030-Step3"]}
    answer = await there.post(f"{BASE}/delete-steps", body)
    assert (answer.status_code, answer.content) == (200, b"")


@pytest.mark.parametrize(
    ("call", "name"),
    [
        ("complete-order-batch", "orders-complete-batch"),
        ("cancel-batch", "orders-cancel-batch"),
        ("retry-failed-orders", "orders-retry-failed"),
    ],
)
async def test_batches_answer_for_every_order(call: str, name: str) -> None:
    body = example("m4", f"{name}.request")
    past = [*opened(), *seen(range(1, 35), sealed=False)]
    past += [OrderFaulted(scene=SCENE, order=OrderId(id_), reason="x") for id_ in body["orderIds"]]
    answer = await site(*past).post(f"{BASE}/{call}", body)
    assert answer.status_code == 200
    assert answer.json() == {
        id_: {"ok": True, "result": {}, "errMsg": None} for id_ in body["orderIds"]
    }
    form = example("m4", "orders-complete-batch.response")
    same_form(next(iter(form.values())), answer.json()[body["orderIds"][0]])


async def test_a_batch_goes_on_after_an_entry_that_fails() -> None:
    there = site(*opened(), created(ORDER, task(), sealed=False))
    answer = await there.post(f"{BASE}/complete-order-batch", {"orderIds": ["nope", ORDER]})
    assert answer.status_code == 200
    results = answer.json()
    assert results[ORDER] == {"ok": True, "result": {}, "errMsg": None}
    assert not results["nope"]["ok"]
    assert "nope" in results["nope"]["errMsg"]
    assert there.handler.fleet.orders[ORDER].sealed


@pytest.mark.parametrize(
    ("body", "code", "word"),
    [
        (b"{", "errBadJson", "JSON"),
        ({}, "errFieldMissing", "sceneId"),
        ({"sceneId": ""}, "errSceneIdBlank", "sceneId"),
        ({"sceneId": "S"}, "errSceneNotFound", "S"),
        ({"sceneId": SCENE, "priority": "3"}, "errFieldInvalid", "priority"),
        ({"sceneId": SCENE, "priority": 2**31}, "errFieldInvalid", "priority"),
        ({"sceneId": SCENE, "priority": True}, "errFieldInvalid", "priority"),
        ({"sceneId": SCENE, "stepFixed": 1}, "errFieldInvalid", "stepFixed"),
        ({"sceneId": SCENE, "steps": [{}]}, "errFieldMissing", "steps.0.location"),
        (
            {"sceneId": SCENE, "steps": [{"location": "AP110", "rbkArgs": {"n": "x" * 100_000}}]},
            "errFieldInvalid",
            "rbkArgs",
        ),
        ({"sceneId": SCENE, "externalId": "x" * 51}, "errExternalIdTooLong", "externalId"),
        ({"sceneId": SCENE}, "errOrderWithoutGoal", "keyLocations"),
    ],
)
async def test_bad_input_is_refused_in_words_that_name_the_field(
    body: object, code: str, word: str
) -> None:
    there = site()
    answer = await there.post(f"{BASE}/create", body)
    assert answer.status_code == 400
    assert answer.json()["code"] == code
    assert word in answer.json()["message"]
    assert isinstance(answer.json()["args"], list)
    assert not there.handler.fleet.orders


async def test_null_is_absent_and_unknown_fields_are_ignored() -> None:
    there = site()
    body = {
        "sceneId": SCENE,
        "externalId": None,
        "priority": None,
        "expectedRobotNames": None,
        "containerId": "",
        "stepFixed": None,
        "steps": [{"location": "AP110", "rbkArgs": {}, "forLoad": None, "novelty": 1}],
        "taskBatch": "x",
    }
    answer = await there.post(f"{BASE}/create", body)
    assert answer.status_code == 200
    step = there.handler.fleet.orders[ORDER].steps[0]
    assert step.task.arguments is None


async def test_an_update_tells_null_from_empty_arguments() -> None:
    step = task(BINS[0], arguments='{"binTask":"Load"}', loads=True)
    there = site(*opened(), created(ORDER, step, step))
    steps = [
        {"stepIndex": 0, "rbkArgs": None, "forLoad": False},
        {"stepIndex": 1, "rbkArgs": {}, "location": "AP125"},
    ]
    answer = await there.post(f"{BASE}/update-steps", {"orderId": ORDER, "steps": steps})
    assert answer.status_code == 200
    first, second = (s.task for s in there.handler.fleet.orders[ORDER].steps)
    assert (first.arguments, first.loads, first.location) == (step.arguments, False, BINS[0])
    assert (second.arguments, second.loads, second.location) == (None, True, "AP125")
    assert second.arguments is None


async def made_twice(there: Site, key: str = "k", **headers: str) -> list[tuple[int, str]]:
    body = {"sceneId": SCENE, "keyLocations": ["AP110"]}
    answers = [
        await there.post(f"{BASE}/create", body, headers={"Idempotency-Key": key, **headers})
        for _ in range(2)
    ]
    return [(answer.status_code, answer.text) for answer in answers]


async def test_a_repeated_key_gets_the_first_answer() -> None:
    there = site()
    first, again = await made_twice(there)
    assert first == again
    assert first[0] == 200
    assert len(there.handler.fleet.orders) == 1
    assert there.waited == [3, 3]
    assert next(iter(there.handler.fleet.answers)) == "alice/k"


async def test_a_key_belongs_to_its_caller_and_to_one_request() -> None:
    there = site()
    await made_twice(there)
    await made_twice(there, user="bob")
    assert len(there.handler.fleet.orders) == 2
    answer = await there.post(
        f"{BASE}/cancel-all", {"sceneId": SCENE}, headers={"Idempotency-Key": "k"}
    )
    assert (answer.status_code, answer.json()["code"]) == (400, "errIdempotencyKeyReused")
    assert len(there.handler.fleet.orders) == 2


async def test_a_refusal_is_repeated_although_it_could_be_accepted_by_now() -> None:
    there = site()
    call = {"headers": {"Idempotency-Key": "k"}}
    first = await there.post(f"{BASE}/complete-order", {"orderId": ORDER}, **call)
    await there.post(f"{BASE}/create", {"sceneId": SCENE, "steps": [{"location": "AP110"}]})
    again = await there.post(f"{BASE}/complete-order", {"orderId": ORDER}, **call)
    assert first.status_code == again.status_code == 400
    assert first.json() == again.json()
    assert not there.handler.fleet.orders[ORDER].sealed


async def test_an_empty_answer_is_repeated_empty() -> None:
    there = site(*opened(), created(ORDER, task(), sealed=False))
    for _ in range(2):
        answer = await there.post(
            f"{BASE}/complete-order", {"orderId": ORDER}, headers={"Idempotency-Key": "k"}
        )
        assert (answer.status_code, answer.content) == (200, b"")


@pytest.mark.parametrize("key", ["", "  ", "x" * 201])
async def test_a_key_has_limits(key: str) -> None:
    there = site()
    first, _ = await made_twice(there, key)
    assert first[0] == 400
    assert "errIdempotencyKeyInvalid" in first[1]


async def test_orders_are_held_up_and_let_go_each_on_its_own() -> None:
    there = site(*opened(), created(ORDER, task()))
    body = {"orderIds": ["nothing", ORDER]}
    good = {"ok": True, "result": {}, "errMsg": None}
    for call, suspended in (("set-suspended", True), ("unset-suspended", False)):
        for _ in range(2):
            answer = await there.post(f"{BASE}/{call}", body)
            assert (answer.status_code, list(answer.json())) == (200, body["orderIds"])
            assert answer.json()[ORDER] == good
            assert "nothing" in answer.json()["nothing"]["errMsg"]
            assert there.handler.fleet.orders[ORDER].suspended is suspended
    answer = await there.post(f"{BASE}/set-suspended", {})
    assert (answer.status_code, answer.json()["code"]) == (400, "errFieldMissing")


async def test_every_call_is_documented_with_its_key() -> None:
    paths = site().app.openapi()["paths"]
    calls = [path for path in paths if path.startswith(BASE)]
    assert len(calls) == 13
    for path in calls:
        operation = paths[path]["post"]
        assert operation["description"]
        assert "Idempotency-Key" in [p["name"] for p in operation["parameters"]]
        assert "requestBody" in operation
