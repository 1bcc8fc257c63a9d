"""Golden examples through a whole server: what is sent comes back out of its queries.

The forms of both sides on their own are tested in tests/commands/api and tests/projections/api.
"""

from collections.abc import Iterator
from typing import Any

import msgspec
import pytest

from ledger.scene import SceneFile
from tests.fleetledger.server import Server, serving, small_file
from tests.golden import example, folder, same_form

ORDERS = "/api/fleet/orders"
OK = {"ok": True, "result": {}, "errMsg": None}


def golden_file() -> SceneFile:
    """A small warehouse whose bins have the names of the examples."""
    created = example("m4", "orders-create.request")
    names = [step["location"] for step in created["steps"]]
    names += [step["location"] for step in example("m4", "orders-add-steps.request")["steps"]]
    file = small_file(robots=1)
    area = file.areas[0]
    bins = [msgspec.structs.replace(b, name=n) for b, n in zip(area.bins, names, strict=False)]
    area = msgspec.structs.replace(area, bins=(*bins, *area.bins[len(bins) :]))
    return msgspec.structs.replace(file, areas=(area,))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server that was sent the scene and the example order, and has carried it out."""
    folder("m4")  # skips where there are none
    path = tmp_path_factory.mktemp("golden") / "data"
    with serving(path, "--auth", "none", "--simulate", "--speed", "20") as server:
        raw = msgspec.json.decode(msgspec.json.encode(golden_file()))
        scene = server.post("/api/fleet/scenes/import", raw)["id"]
        assert scene == server.scene
        made = server.post(
            f"{ORDERS}/create", example("m4", "orders-create.request") | {"sceneId": scene}
        )
        same_form(example("m4", "orders-create.response"), made)
        server.until_finished(made["orderId"])
        robots = {"sceneId": scene, "robotNames": ["AMB-01"], "offDuty": True}
        assert server.post("/api/fleet/robots/off-duty", robots) == {"AMB-01": OK}
        yield server


def opened(site: Server, steps: int = 6) -> str:
    """An order that waits for more steps; nobody takes it, for the robot is off duty."""
    step = example("m4", "orders-add-steps.request")["steps"][0]
    body = {"sceneId": site.scene, "stepFixed": False, "steps": [step | {"forLoad": False}] * steps}
    return str(site.post(f"{ORDERS}/create", body)["orderId"])


def detail(site: Server, order: str) -> dict[str, Any]:
    found = site.get(f"{ORDERS}/query-order-detail", orderId=order)
    assert isinstance(found, dict)
    return found


def send(site: Server, name: str, call: str, **fields: Any) -> Any:
    return site.post(f"{ORDERS}/{call}", example("m4", f"{name}.request") | fields)


@pytest.mark.parametrize("number", ["", ".2", ".3", ".4", ".5", ".6"])
def test_every_query_finds_the_example_order_in_the_golden_form(site: Server, number: str) -> None:
    asked = example("m4", f"entity-find-many{number}.request")
    everything = site.found()
    if (asked["query"] or {}).get("operator") == "In":
        asked["query"]["value"] = sorted(everything)
    if "fuzzy" in asked:
        asked["fuzzy"] = min(everything)[2:]
    rows = site.post("/api/entity/find/many", asked)
    assert rows
    same_form(example("m4", f"entity-find-many{number}.response")[:1], rows)


def test_a_page_is_of_the_golden_form(site: Server) -> None:
    found = site.post("/api/entity/find/page", example("m4", "entity-find-page.request"))
    expected = example("m4", "entity-find-page.response")
    expected["page"] = example("m4", "entity-find-many.response")[:1]
    same_form(expected, found)
    assert found["total"] == len(site.found())


def test_the_example_order_was_done_as_it_was_sent(site: Server) -> None:
    done = min(id_ for id_, row in site.found().items() if row["kind"] == "Business")
    found = detail(site, done)
    assert example("m4", "orders-query-detail.response").keys() == found.keys()
    sent = example("m4", "orders-create.request")["steps"]
    assert [s["location"] for s in found["steps"]] == [s["location"] for s in sent]
    assert {s["status"] for s in found["steps"]} == {"Done"}


def test_steps_are_added_changed_and_deleted(site: Server) -> None:
    order = opened(site, steps=5)
    assert send(site, "orders-add-steps", "add-steps", orderId=order) is None
    assert len(detail(site, order)["steps"]) == 6
    assert send(site, "orders-update-steps", "update-steps", orderId=order) is None
    changed = example("m4", "orders-update-steps.request")["steps"][0]
    steps = detail(site, order)["steps"]
    assert steps[changed["stepIndex"]]["location"] == changed["location"]
    gone = [steps[1]["id"], steps[3]["id"]]
    assert send(site, "orders-delete-steps", "delete-steps", orderId=order, stepIds=gone) is None
    left = [step["id"] for step in detail(site, order)["steps"]]
    assert left == [step["id"] for step in steps if step["id"] not in gone]


def test_orders_are_completed_prioritised_and_retried(site: Server) -> None:
    orders = [opened(site) for _ in range(3)]
    assert send(site, "orders-complete", "complete-order", orderId=orders[0]) is None
    results = send(
        site, "orders-complete-batch", "complete-order-batch", orderIds=[*orders[1:], "nope"]
    )
    same_form(example("m4", "orders-complete-batch.response").popitem()[1], results[orders[1]])
    assert [results[id_]["ok"] for id_ in (*orders[1:], "nope")] == [True, True, False]
    ids = {"orderIds": orders}
    assert send(site, "orders-update-priority-batch", "update-priority-batch", **ids) is None
    rows = site.found(*orders)
    assert {(row["stepFixed"], row["priority"]) for row in rows.values()} == {(True, 3)}
    retried = send(site, "orders-retry-failed", "retry-failed-orders", **ids)
    assert not any(result["ok"] for result in retried.values()), "none of them has a fault"


def test_orders_are_cancelled_one_by_one_together_and_all(site: Server) -> None:
    orders = [opened(site) for _ in range(4)]
    scene = {"sceneId": site.scene}
    assert send(site, "orders-cancel", "cancel", orderId=orders[0], **scene) is None
    results = send(site, "orders-cancel-batch", "cancel-batch", orderIds=orders[1:3])
    assert results == dict.fromkeys(orders[1:3], OK)
    status = {id_: row["status"] for id_, row in site.found(*orders).items()}
    assert [status[id_] for id_ in orders] == ["Cancelled"] * 3 + ["ToBeAllocated"]
    assert send(site, "orders-cancel-all", "cancel-all", **scene) is None
    business = [row for row in site.found().values() if row["kind"] == "Business"]
    assert {row["status"] for row in business} <= {"Done", "Cancelled"}
