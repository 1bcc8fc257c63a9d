"""Every call that changes something takes an Idempotency-Key, and none is forgotten."""

import asyncio
from collections.abc import Iterator, Sequence
from typing import Any

import msgspec
import pytest

from ledger.events import CommandAnswered
from ledger.ids import UnitId
from tests.commands.api.application import Site, site
from tests.commands.site import ORDER, R1, SCENE, created, opened, task
from tests.strategies import grid

KEY = "Idempotency-Key"
OF_SCENE, OF_ROBOTS = f"/api/fleet/scenes/{SCENE}", f"/api/fleet/robots/{SCENE}"
ORDERS, ROBOTS, SCENES = "/api/fleet/orders", "/api/fleet/robots", "/api/fleet/scenes"
DEVICES, GROUND = "/api/fleet/devices", "/api/fleet/external-map-res"
MORE = [{"location": "AP125"}]
ROBOT = {"robotName": "R9", "groupId": 1, "vendor": "Seer", "selfBinNum": 1, "simulated": True}
NAMED = {"sceneId": SCENE, "robotNames": [R1]}
BODIES: dict[str, Any] = {
    f"{ORDERS}/create": {"sceneId": SCENE, "keyLocations": ["AP110"]},
    f"{ORDERS}/add-steps": {"orderId": ORDER, "steps": MORE},
    f"{ORDERS}/update-steps": {"orderId": ORDER, "steps": [{"stepIndex": 0, "location": "AP125"}]},
    f"{ORDERS}/delete-steps": {"orderId": ORDER, "stepIds": ["none"]},
    f"{ORDERS}/complete-order": {"orderId": ORDER},
    f"{ORDERS}/complete-order-batch": {"orderIds": [ORDER]},
    f"{ORDERS}/cancel": {"sceneId": SCENE, "orderId": ORDER},
    f"{ORDERS}/cancel-batch": {"orderIds": [ORDER]},
    f"{ORDERS}/cancel-all": {"sceneId": SCENE},
    f"{ORDERS}/update-priority-batch": {"orderIds": [ORDER], "priority": 7},
    f"{ORDERS}/retry-failed-orders": {"orderIds": [ORDER]},
    f"{ORDERS}/set-suspended": {"orderIds": [ORDER]},
    f"{ORDERS}/unset-suspended": {"orderIds": [ORDER]},
    f"{OF_SCENE}/robot/create": ROBOT,
    f"{OF_SCENE}/robot/create/batch": [ROBOT],
    f"{OF_SCENE}/robot/create/auto-batch": {**ROBOT, "robotNamePrefix": "N", "count": 2},
    f"{OF_SCENE}/robot/remove": {"robotNames": [R1]},
    f"{OF_SCENE}/robot/update/config": {**ROBOT, "robotName": R1},
    f"{OF_SCENE}/robot/update/config/batch": {"robotNames": [R1], "config": {"remark": "new"}},
    f"{OF_ROBOTS}/disabled": {"robotNames": [R1], "disabled": True},
    f"{ROBOTS}/off-duty": {**NAMED, "offDuty": True},
    f"{OF_ROBOTS}/clear-bins": {"robotNames": [R1]},
    f"{ROBOTS}/reconnect": NAMED,
    f"{ROBOTS}/master": {**NAMED, "on": True},
    f"{ROBOTS}/cancel-nav": NAMED,
    f"{ROBOTS}/pause-nav": NAMED,
    f"{ROBOTS}/resume-nav": NAMED,
    f"{OF_ROBOTS}/clear-alarm": {"robotNames": [R1]},
    f"{OF_ROBOTS}/set-soft-emc": {"robotNames": [R1], "enable": True},
    f"{OF_ROBOTS}/auto-recovery": {"robotNames": [R1]},
    f"{DEVICES}/doors/open-batch": {"sceneId": SCENE, "ids": [1]},
    f"{DEVICES}/doors/close-batch": {"sceneId": SCENE, "ids": [1]},
    f"{DEVICES}/doors/keep-open": {"sceneId": SCENE, "ids": [1]},
    f"{DEVICES}/lifts/keep-open": {"sceneId": SCENE, "liftId": 1, "toAreaId": 1},
    f"{DEVICES}/lifts/cancel-open": {"sceneId": SCENE, "liftId": 1},
    f"{GROUND}/request": [{"unitId": "u1", "owner": "WMS", "pointNames": ["AP110"]}],
    f"{GROUND}/release": ["u1"],
    f"{GROUND}/release-by-owner": {"owner": "WMS"},
    f"{GROUND}/release-all": None,
    f"{SCENES}/import": msgspec.to_builtins(grid()),
    f"{SCENES}/create": {"name": "another"},
    f"{SCENES}/remove": {"ids": [SCENE]},
    f"{OF_SCENE}/basic/patch": {"name": "renamed"},
    f"{OF_SCENE}/disable": {"disabled": True},
    f"{OF_SCENE}/dispatch-pause": {"paused": True},
    f"{OF_SCENE}/config": {},
    f"{OF_SCENE}/config/patch": {},
}


def there() -> Site:
    return site(*opened(R1), created(ORDER, task(), sealed=False))


def routes() -> Iterator[str]:
    for path, item in there().app.openapi()["paths"].items():
        if "post" in item:
            yield path.replace("{sceneId}", SCENE)


def test_every_call_that_changes_something_is_looked_at_here() -> None:
    assert set(routes()) == set(BODIES)


@pytest.mark.parametrize("path", BODIES)
async def test_a_repetition_gets_the_first_bytes_and_nothing_happens(path: str) -> None:
    where = there()
    before = where.ledger.position
    call: dict[str, Any] = {"headers": {KEY: "k"}}
    first = await where.post(path, BODIES[path], **call)
    assert first.json() is not None if first.content else first.status_code == 200
    answers = [e for e in where.ledger.read(before) if isinstance(e, CommandAnswered)]
    assert len(answers) == 1, f"{first.status_code} {first.text}"
    newest = where.ledger.position
    again = await where.post(path, BODIES[path], **call)
    assert (again.status_code, again.content) == (first.status_code, first.content)
    assert again.headers.get("content-type") == first.headers.get("content-type")
    assert where.ledger.position == newest


async def test_a_repetition_of_a_call_that_answers_late_waits_for_that_answer() -> None:
    where = there()
    asked, may_end = asyncio.Event(), asyncio.Event()
    waits = 0

    async def watch(units: Sequence[UnitId]) -> bool:
        nonlocal waits
        waits += 1
        asked.set()
        await may_end.wait()
        return False

    where.watch = watch
    path = f"{GROUND}/request"
    call: dict[str, Any] = {"headers": {KEY: "k"}}
    first = asyncio.create_task(where.post(path, BODIES[path], **call))
    await asked.wait()
    others = [asyncio.create_task(where.post(path, BODIES[path], **call)) for _ in range(3)]
    await asyncio.sleep(0)
    may_end.set()
    answers = await asyncio.gather(first, *others)
    assert len({answer.content for answer in answers}) == 1
    assert waits == 1
    assert sum(isinstance(e, CommandAnswered) for e in where.ledger.read(0)) == 1
