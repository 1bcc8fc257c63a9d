from typing import Any

import pytest

from ledger.events import (
    AnyEvent,
    OrderFaulted,
    RobotAlarmsCleared,
    RobotControlReleased,
    RobotControlTaken,
    RobotDisconnected,
    RobotPaused,
    RobotReconnectAsked,
    RobotResumed,
    RobotSoftStopLifted,
    RobotSoftStopped,
    RobotTrafficReset,
)
from ledger.ids import RobotName
from tests.commands.api.application import Site, site
from tests.commands.site import ORDER, R1, R2, SCENE, assigned, created, opened, started, task
from tests.golden import example

OF_ROBOTS = "/api/fleet/robots"
GOOD = {"ok": True, "result": {}, "errMsg": None}


def news(there: Site, before: int) -> list[AnyEvent]:
    return list(there.ledger.read(before))


EXAMPLES: list[tuple[str, str, bool, list[type]]] = [
    ("robots-reconnect", "reconnect", True, []),
    ("robots-master", "master", True, [RobotControlTaken]),
    ("robots-clear-alarm", f"{SCENE}/clear-alarm", False, [RobotAlarmsCleared]),
    ("robots-set-soft-emc", f"{SCENE}/set-soft-emc", False, [RobotSoftStopped]),
    (
        "robots-auto-recovery",
        f"{SCENE}/auto-recovery",
        False,
        [RobotControlTaken, RobotTrafficReset, RobotAlarmsCleared],
    ),
]


@pytest.mark.parametrize(("name", "path", "scene_in_body", "events"), EXAMPLES)
async def test_the_example_is_taken_and_answered_for_each_robot(
    name: str, path: str, scene_in_body: bool, events: list[type]
) -> None:
    body = example("m4", f"{name}.request")
    there = site(*opened(*map(RobotName, body["robotNames"])))
    before = there.handler.fleet.position
    answer = await there.post(
        f"{OF_ROBOTS}/{path}", body | {"sceneId": SCENE} if scene_in_body else body
    )
    assert (answer.status_code, answer.json()) == (200, dict.fromkeys(body["robotNames"], GOOD))
    assert list(answer.json()) == body["robotNames"]
    assert [type(e) for e in news(there, before)] == events * len(body["robotNames"])


CALLS: list[tuple[str, dict[str, Any], type]] = [
    ("master", {"sceneId": SCENE, "on": True}, RobotControlTaken),
    ("master", {"sceneId": SCENE, "on": False}, RobotControlReleased),
    ("master", {"sceneId": SCENE, "on": None}, RobotControlReleased),
    ("master", {"sceneId": SCENE}, RobotControlReleased),
    ("pause-nav", {"sceneId": SCENE}, RobotPaused),
    ("resume-nav", {"sceneId": SCENE}, RobotResumed),
    (f"{SCENE}/set-soft-emc", {"enable": True}, RobotSoftStopped),
    (f"{SCENE}/set-soft-emc", {"enable": False}, RobotSoftStopLifted),
    (f"{SCENE}/clear-alarm", {}, RobotAlarmsCleared),
]


@pytest.mark.parametrize(("path", "fields", "event"), CALLS)
async def test_one_robot_that_fails_fails_alone(
    path: str, fields: dict[str, Any], event: type
) -> None:
    there = site(*opened(R1, R2), RobotDisconnected(scene=SCENE, robot=R2))
    before = there.handler.fleet.position
    names = ["nobody", R2, R1, R2]
    answer = await there.post(f"{OF_ROBOTS}/{path}", {"robotNames": names, **fields})
    assert answer.status_code == 200
    assert list(answer.json()) == ["nobody", R2, R1]
    assert answer.json()[R1] == GOOD
    for name, word in (("nobody", "no robot 'nobody'"), (R2, "does not answer")):
        entry = answer.json()[name]
        assert (entry["ok"], entry["result"]) == (False, {})
        assert word in entry["errMsg"]
    assert [(type(e), e.robot) for e in news(there, before)] == [(event, R1)]


async def test_reconnecting_nobody_does_nothing() -> None:
    there = site(*opened(R1), RobotDisconnected(scene=SCENE, robot=R1))
    before = there.handler.fleet.position
    for body in ({"sceneId": SCENE}, {"sceneId": SCENE, "robotNames": None}):
        answer = await there.post(f"{OF_ROBOTS}/reconnect", body)
        assert (answer.status_code, answer.json()) == (200, {})
    assert news(there, before) == []
    answer = await there.post(f"{OF_ROBOTS}/reconnect", {"sceneId": SCENE, "robotNames": [R1]})
    assert answer.json() == {R1: GOOD}
    assert [type(e) for e in news(there, before)] == [RobotReconnectAsked]


async def test_cancelled_navigation_is_a_fault_that_a_retry_ends() -> None:
    there = site(*opened(R1, R2), created(ORDER, task()), assigned(), started())
    body = {"sceneId": SCENE, "robotNames": [R1, R2]}
    before = there.handler.fleet.position
    for _ in range(2):
        answer = await there.post(f"{OF_ROBOTS}/cancel-nav", body)
        assert answer.json() == {R1: GOOD, R2: GOOD}
    assert [type(e) for e in news(there, before)] == [OrderFaulted]
    assert there.handler.fleet.orders[ORDER].fault_reason == "NavigationCancelled"
    again = await there.post("/api/fleet/orders/retry-failed-orders", {"orderIds": [ORDER]})
    assert again.json() == {ORDER: GOOD}
    assert there.handler.fleet.orders[ORDER].fault_reason is None


@pytest.mark.parametrize(
    ("path", "body", "code", "word"),
    [
        ("reconnect", {"robotNames": [R1]}, "errFieldMissing", "sceneId"),
        ("reconnect", {"sceneId": "x"}, "errSceneNotFound", "x"),
        ("master", {"sceneId": "", "robotNames": []}, "errSceneIdBlank", "sceneId"),
        ("master", {"sceneId": SCENE}, "errFieldMissing", "robotNames"),
        ("master", {"sceneId": SCENE, "robotNames": [R1], "on": "true"}, "errFieldInvalid", "on"),
        ("pause-nav", {"sceneId": SCENE, "robotNames": None}, "errFieldInvalid", "robotNames"),
        (f"{SCENE}/set-soft-emc", {"robotNames": [R1]}, "errFieldMissing", "enable"),
        ("x/auto-recovery", {"robotNames": [R1]}, "errSceneNotFound", "x"),
    ],
)
async def test_what_cannot_be_understood_is_refused_whole(
    path: str, body: dict[str, Any], code: str, word: str
) -> None:
    there = site(*opened(R1))
    before = there.handler.fleet.position
    answer = await there.post(f"{OF_ROBOTS}/{path}", body)
    assert (answer.status_code, answer.json()["code"]) == (400, code)
    assert word in answer.json()["message"]
    assert news(there, before) == []


async def test_a_repeated_key_presses_no_button_twice() -> None:
    there = site(*opened(R1))
    path, body = f"{OF_ROBOTS}/{SCENE}/set-soft-emc", {"robotNames": [R1], "enable": True}
    before = there.handler.fleet.position
    answers = [
        await there.post(path, body, headers={"Idempotency-Key": "stop-1"}) for _ in range(2)
    ]
    assert answers[0].json() == answers[1].json() == {R1: GOOD}
    assert sum(isinstance(e, RobotSoftStopped) for e in news(there, before)) == 1


def test_every_call_is_documented_with_its_key_and_its_entries() -> None:
    paths = site().app.openapi()["paths"]
    for path, *_ in (*CALLS, ("reconnect",), ("cancel-nav",), (f"{SCENE}/auto-recovery",)):
        call = paths[f"{OF_ROBOTS}/{path.replace(SCENE, '{sceneId}')}"]["post"]
        assert call["description"] or call["summary"]
        named = [parameter["name"] for parameter in call["parameters"]]
        assert named == (["Idempotency-Key", "sceneId"] if SCENE in path else ["Idempotency-Key"])
        answer = call["responses"]["200"]["content"]["application/json"]["schema"]
        assert answer["additionalProperties"]["$ref"].endswith("/ParallelResult")
