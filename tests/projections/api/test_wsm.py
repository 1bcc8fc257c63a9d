"""`/wsm` in process: questions, refusals, limits."""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from starlette.types import ASGIApp

import projections.api.m4
import projections.api.wsm
from fleetledger.access.callers import Caller, Headers
from fleetledger.api import build
from ledger.link import Plan, Report
from projections.api.m4_scene_query import FIELDS, SEED_FIELDS
from projections.api.wsm_frames import FRAME_CHARS_MAX
from tests.golden import example
from tests.projections.api.asking import application, asked_of
from tests.projections.api.sockets import Socket, opened
from tests.projections.past import Side, all_orders, long_log
from tests.strategies import SCENE

LOG = long_log()
ORDER = sorted(all_orders(LOG))[3]
ACTIONS = {
    "Fleet::OrderDetail::Query": {"orderId": ORDER},
    "Fleet::OrderDetail": {"orderId": ORDER},
    "Fleet::Scene::Query": {"sceneId": SCENE},
    "Fleet::Scene": {"sceneId": SCENE},
    "Fleet3::AllRobotsUiReports::Query": {"sceneId": SCENE},
    "Fleet3::RobotsPositionOnly::Query": {"sceneId": SCENE},
}


@pytest.fixture
async def side(tmp_path: Path) -> AsyncIterator[Side]:
    side = Side(tmp_path, LOG, 550)
    side.go_on(600)
    for robot in side.live.fleet.robots.values():
        report = Report(
            scene=SCENE, robot=robot.name, number=1, at_ms=LOG.events[-1].at_ms, area=0, x_m=1.0,
            y_m=2.0, heading_rad=0.5,
        )  # fmt: skip
        side.live.observe(report)
        side.live.intend(Plan(scene=SCENE, robot=robot.name, at_ms=report.at_ms, ready=True))
    yield side
    side.close()


@pytest.fixture
def app(side: Side) -> ASGIApp:
    return application(side, projections.api.wsm.router(asked_of(side), tick_s=0.01))


@pytest.fixture
async def socket(app: ASGIApp) -> AsyncIterator[Socket]:
    async with opened(app) as socket:
        yield socket


async def test_the_golden_question_gets_the_golden_reply(socket: Socket) -> None:
    asked = example("m4", "ws-order-detail.request")
    asked["content"] = json.dumps({"orderId": ORDER})  # that of the example is of another plant
    socket.say(json.dumps(asked))
    reply = json.loads(await socket.text())
    expected = example("m4", "ws-order-detail.response")
    assert reply["action"] == expected["action"]
    assert {key: type(reply[key]) for key in expected} == {k: type(v) for k, v in expected.items()}
    detail = example("m4", "orders-query-detail.response")
    assert json.loads(reply["content"]).keys() == detail.keys()


async def test_replies_are_what_http_answers(socket: Socket, side: Side) -> None:
    found = (await socket.answer("Fleet::OrderDetail", {"orderId": ORDER}))["content"]
    row, _ = await projections.api.m4.detail_of(side.find, ORDER, None)
    assert found == row
    found = (await socket.answer("Fleet::Scene", {"sceneId": SCENE}))["content"]
    assert list(found) == list(FIELDS)
    found = (await socket.answer("Fleet::Scene::Query", {"sceneId": SCENE}))["content"]
    assert list(found) == list(SEED_FIELDS)
    reports = (await socket.answer("Fleet3::AllRobotsUiReports::Query", {"sceneId": SCENE}))[
        "content"
    ]
    assert reports == found["robots"]


async def test_positions_alone_have_their_fields(socket: Socket) -> None:
    reply = await socket.answer("Fleet3::RobotsPositionOnly::Query", {"sceneId": SCENE})
    assert reply["content"].keys() == {"robots", "replyTimestamp"}
    wanted = {"x", "y", "d", "loads", "travelled", "unTravelled", "remainingPaths", "spaces"}
    assert reply["content"]["robots"]
    for row in reply["content"]["robots"].values():
        assert wanted <= row.keys() <= wanted | {"targetPoint"}


@pytest.mark.parametrize("naming", ["", "naming=seed", "naming=appended"])
async def test_replies_are_named_as_the_client_wants(app: ASGIApp, naming: str) -> None:
    of_seed = {
        "Fleet::OrderDetail::Query": "Fleet::OrderDetail::Reply",
        "Fleet::Scene::Query": "Fleet::Scene::Query",
    }
    async with opened(app, naming) as socket:
        for number, (action, content) in enumerate(ACTIONS.items()):
            reply = await socket.answer(action, content, id=f"q{number}")
            appended = f"{action}::Reply"
            seed = of_seed.get(action, appended)
            assert reply["action"] == (appended if naming == "naming=appended" else seed)
            assert (reply["replyToId"], reply["id"], reply["userIds"]) == (f"q{number}", "", None)


async def test_an_unknown_naming_is_refused(app: ASGIApp) -> None:
    async with opened(app, "naming=other") as socket:
        reply = await socket.frame()
        assert (reply["action"], reply["content"]["code"]) == ("::Error", "errFieldInvalid")
        assert (await socket.message())["type"] == "websocket.close"


@pytest.mark.parametrize(
    ("text", "action", "code"),
    [
        ("", "::Error", "errBadJson"),
        ("{", "::Error", "errBadJson"),
        ("[" * 50_000, "::Error", "errBadJson"),
        ('{"action":"\\ud800"}', "::Error", "errBadJson"),
        ("[]", "::Error", "errBadFrame"),
        ("{}", "::Error", "errFieldInvalid"),
        ('{"action":3}', "::Error", "errFieldInvalid"),
        ('{"action":""}', "::Error", "errFieldInvalid"),
        (json.dumps({"action": "x" * 201}), "::Error", "errFieldInvalid"),
        ('{"action":"Nope"}', "Nope::Error", "errActionUnknown"),
        ('{"action":"Fleet::Scene"}', "Fleet::Scene::Error", "errFieldMissing"),
        ('{"action":"Fleet::Scene","content":null}', "Fleet::Scene::Error", "errFieldMissing"),
        ('{"action":"Fleet::Scene","content":{}}', "Fleet::Scene::Error", "errFieldInvalid"),
        ('{"action":"Fleet::Scene","content":"{"}', "Fleet::Scene::Error", "errBadJson"),
        ('{"action":"Fleet::Scene","content":"[]"}', "Fleet::Scene::Error", "errFieldInvalid"),
        ('{"action":"Fleet::Scene","id":[]}', "Fleet::Scene::Error", "errFieldInvalid"),
        ("x" * (FRAME_CHARS_MAX + 1), "::Error", "errFrameTooLarge"),
    ],
)
async def test_a_bad_frame_is_refused_and_the_next_one_answered(
    socket: Socket, text: str, action: str, code: str
) -> None:
    socket.say(text)
    reply = await socket.frame()
    assert (reply["action"], reply["content"]["code"]) == (action, code)
    assert reply["content"].keys() == {"error", "code", "message", "args"}
    assert reply["content"]["error"] == 400
    good = await socket.answer("Fleet::OrderDetail", {"orderId": ORDER})
    assert good["action"] == "Fleet::OrderDetail::Reply"


@pytest.mark.parametrize(
    ("action", "content", "code"),
    [
        ("Fleet::Scene", {"sceneId": "x"}, "errSceneNotFound"),
        ("Fleet::Scene", {"sceneId": 3}, "errFieldInvalid"),
        ("Fleet::Scene", {"sceneId": ""}, "errFieldInvalid"),
        ("Fleet::Scene", {"sceneId": "x" * 201}, "errFieldInvalid"),
        ("Fleet::Scene", {"sceneId": SCENE, "orderQueryType": "x"}, "errFieldInvalid"),
        ("Fleet::Scene", {"sceneId": SCENE, "excluded": "robots"}, "errFieldInvalid"),
        ("Fleet::Scene", {"sceneId": SCENE, "excluded": ["x"] * 101}, "errFieldInvalid"),
        ("Fleet::Scene", {"sceneId": SCENE, "asOf": "yesterday"}, "errFieldInvalid"),
        ("Fleet::Scene", {"sceneId": SCENE, "asOf": 9**50}, "errFieldInvalid"),
        ("Fleet::OrderDetail", {"orderId": "TO1"}, "errOrderNotFound"),
        ("Fleet::OrderDetail", {"orderId": "\ud800"}, "errBadJson"),
        ("Fleetledger::Scene::Subscribe", {"sceneId": "x"}, "errSceneNotFound"),
        ("Fleetledger::Scene::Subscribe", {"sceneId": SCENE, "fields": ["x"]}, "errFieldUnknown"),
        (
            "Fleetledger::Scene::Subscribe",
            {"sceneId": SCENE, "fields": ["replyTimestamp"]},
            "errFieldInvalid",
        ),
        ("Fleetledger::Scene::Unsubscribe", {"sceneId": SCENE}, "errNotSubscribed"),
        ("Fleetledger::Scene::Resync", {"sceneId": SCENE}, "errNotSubscribed"),
    ],
)
async def test_a_question_that_cannot_be_answered_is_refused(
    socket: Socket, action: str, content: Any, code: str
) -> None:
    reply = await socket.answer(action, content, id=7)
    assert (reply["action"], reply["replyToId"]) == (f"{action}::Error", 7)
    assert (reply["content"]["error"], reply["content"]["code"]) == (400, code)


async def test_frames_of_bytes_are_refused(socket: Socket) -> None:
    socket.say(None, bytes=b"{}")
    assert (await socket.frame())["content"]["code"] == "errBadFrame"


class Nobody:
    """Callers none of whom is known."""

    def caller(self, headers: Headers) -> Caller | None:
        return None

    def host_is_known(self, headers: Headers) -> bool:
        return True


async def test_a_bad_login_is_told_after_the_handshake(side: Side) -> None:
    app = build(
        [projections.api.wsm.router(asked_of(side))],
        callers=Nobody(),
        refused=lambda caller, address, call, code: None,
        position=lambda: side.live.position,
        wait=side.live.wait,
        when=lambda position, then: then(None),
    )
    async with opened(app) as socket:
        reply = await socket.frame()
        assert reply["action"] == "::Error"
        assert (reply["content"]["error"], reply["content"]["code"]) == (401, "errNotSignedIn")
        assert (await socket.message())["code"] == 1008


async def test_clients_are_limited(app: ASGIApp, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("projections.api.wsm.CLIENTS_MAX", 2)
    async with AsyncExitStack() as stack:
        for _ in range(2):
            await stack.enter_async_context(opened(app))
        one_too_many = await stack.enter_async_context(opened(app))
        assert (await one_too_many.frame())["content"]["code"] == "errTooManyClients"
        assert (await one_too_many.message())["code"] == 1013
    async with opened(app) as socket:  # the others have left
        assert (await socket.answer("Nope"))["action"] == "Nope::Error"


async def test_a_client_that_sends_too_fast_waits_for_its_answers(
    app: ASGIApp, monkeypatch: pytest.MonkeyPatch
) -> None:
    waited: list[float] = []
    sleep = asyncio.sleep

    async def watched(seconds: float) -> None:
        if seconds > 0.05:
            waited.append(seconds)
        await sleep(0)

    monkeypatch.setattr("projections.api.wsm.asyncio.sleep", watched)
    monkeypatch.setattr("projections.api.wsm.FRAMES_A_SECOND_MAX", 3)
    async with opened(app) as socket:
        for _ in range(4):
            assert (await socket.answer("Nope"))["action"] == "Nope::Error"
    assert len(waited) == 1


TEXTS = st.text(st.characters(exclude_categories=()), max_size=20)  # half characters too
JSONS = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | TEXTS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=9), inner),
    max_leaves=12,
)
NAMES = st.sampled_from(
    ["sceneId", "orderId", "excluded", "orderQueryType", "asOf", "fields", "withRawReport"]
)
CONTENTS = st.dictionaries(NAMES, JSONS | st.sampled_from([SCENE, ORDER, ["robots"], "AllOrders"]))
PUSHES = [f"Fleetledger::Scene::{what}" for what in ("Subscribe", "Unsubscribe", "Resync")]
FRAMES = st.one_of(
    st.text(),
    JSONS.map(json.dumps),
    st.fixed_dictionaries(
        {
            "action": st.sampled_from([*ACTIONS, *PUSHES]) | JSONS,
            "content": CONTENTS.map(json.dumps) | JSONS.map(json.dumps) | JSONS,
        },
        optional={"id": JSONS},
    ).map(json.dumps),
)


@settings(
    max_examples=150,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(texts=st.lists(FRAMES, min_size=1, max_size=5))
async def test_any_frame_gets_one_answer_and_never_a_bug(app: ASGIApp, texts: list[str]) -> None:
    async with opened(app) as socket:
        for text in texts:
            socket.say(text)
            while (frame := await socket.frame())["action"] in (
                "Fleetledger::Scene::Snapshot",
                "Fleetledger::Scene::Delta",
            ):
                pass
            assert frame.keys() == {"action", "content", "id", "replyToId", "userIds"}
            if frame["action"].endswith("::Error"):
                assert frame["content"]["error"] == 400, frame
            else:
                assert frame["action"] in REPLIES, frame


REPLIES = {f"{action}::Reply" for action in [*ACTIONS, *PUSHES]}
REPLIES |= {"Fleet::OrderDetail::Reply", "Fleet::Scene::Query"}
