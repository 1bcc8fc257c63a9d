"""Scenes pushed over `/wsm`: numbered without a gap, made once, and nobody waits for the slow."""

import json
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from fastapi import APIRouter
from starlette.types import ASGIApp

import projections.api.wsm
from ledger.events import SceneRemoved, stamped
from ledger.ids import CommandId, RobotName, SceneId
from ledger.link import Report
from projections.api.m4_models import OrderQueryType, SceneDataAsked
from projections.api.m4_scene_query import SceneQueries
from projections.api.scene_changes import USUAL
from tests.projections.api.asking import application, asked_of
from tests.projections.api.follower import Follower
from tests.projections.api.sockets import Socket, opened
from tests.projections.past import Side, long_log
from tests.strategies import SCENE

LOG = long_log()
TICK_S = 0.01
SNAPSHOT, DELTA = "Fleetledger::Scene::Snapshot", "Fleetledger::Scene::Delta"
SUBSCRIBE = "Fleetledger::Scene::Subscribe"
OWN = ("sceneId", "seq", "position", "rTime")  # of every pushed frame


@pytest.fixture
async def side(tmp_path: Path) -> AsyncIterator[Side]:
    side = Side(tmp_path, LOG, 500)
    yield side
    side.close()


@pytest.fixture
def queries(side: Side) -> SceneQueries:
    return asked_of(side)


@pytest.fixture
def service(queries: SceneQueries) -> projections.api.wsm.Service:
    return projections.api.wsm.Service(queries, TICK_S)


@pytest.fixture
def app(side: Side, service: projections.api.wsm.Service) -> ASGIApp:
    router = APIRouter()
    router.add_websocket_route("/wsm", service.serve)
    return application(side, router)


def parts(content: dict[str, Any]) -> dict[str, bytes]:
    return {name: json.dumps(v).encode() for name, v in content.items() if name not in OWN}


def drive(side: Side, at_ms: int) -> None:
    """Let every robot report that it is elsewhere."""
    for robot in side.live.fleet.robots.values():
        side.live.observe(
            Report(
                scene=SCENE, robot=RobotName(robot.name), number=1, at_ms=at_ms, area=0,
                x_m=at_ms % 1000 / 10, y_m=0.0, heading_rad=0.0,
            )
        )  # fmt: skip


async def subscribed(socket: Socket, **more: Any) -> Any:
    """Subscribe; gives the snapshot's content."""
    reply = await socket.answer(SUBSCRIBE, {"sceneId": SCENE} | more)
    assert reply["action"] == f"{SUBSCRIBE}::Reply", reply
    return (await socket.next_of(SNAPSHOT))["content"]


async def test_who_follows_sees_what_a_query_shows(
    app: ASGIApp, side: Side, queries: SceneQueries
) -> None:
    asked = SceneDataAsked(order_query_type=OrderQueryType.UNFINISHED)
    async with opened(app) as socket:
        first = await subscribed(socket)
        assert first.keys() == {*OWN, *USUAL}
        follower, seq = Follower(parts(first), first["rTime"]), first["seq"]
        for number in range(20):
            side.go_on(min(side.live.position + 5, 600))
            drive(side, LOG.events[-1].at_ms + number * 100)
            while True:
                content = (await socket.next_of(DELTA))["content"]
                assert content["seq"] == seq + 1
                seq = content["seq"]
                follower.apply(parts(content), content["rTime"])
                newest = max(report.at_ms for report in side.live.reports.values())
                if content["position"] == side.live.position and content["rTime"] == newest:
                    break
            reply, _ = await queries.answer(SCENE, asked, None, USUAL)
            assert follower.scene() == json.loads(msgspec.json.encode(reply))


async def test_only_what_a_client_asked_for_is_pushed(app: ASGIApp, side: Side) -> None:
    async with opened(app) as socket, opened(app) as other:
        content = await subscribed(socket, fields=["robots", "sceneConfig"])
        assert content.keys() == {*OWN, "robots", "sceneConfig"}
        await subscribed(other)
        drive(side, LOG.events[-1].at_ms)
        content = (await socket.next_of(DELTA))["content"]
        while "robots" not in content:
            content = (await socket.next_of(DELTA))["content"]
        assert content.keys() == {*OWN, "robots"}


async def test_a_frame_is_made_once_for_all(app: ASGIApp, side: Side) -> None:
    async with opened(app) as one, opened(app) as other:
        await subscribed(one)
        await subscribed(other)
        drive(side, LOG.events[-1].at_ms)
        frames = {}
        for _ in range(8):
            text = await one.text()
            frames[json.loads(json.loads(text)["content"])["seq"]] = text
        for _ in range(8):
            text = await other.text()
            seq = json.loads(json.loads(text)["content"])["seq"]
            if seq in frames and json.loads(text)["action"] == DELTA:
                assert frames[seq] == text
                return
        raise AssertionError("they had no frame in common")


async def test_a_slow_client_is_passed_over_and_gets_a_snapshot(app: ASGIApp, side: Side) -> None:
    async with opened(app) as slow, opened(app) as quick:
        await subscribed(slow)
        await subscribed(quick)
        slow.flowing.clear()
        seq = 0
        for number in range(30):
            drive(side, LOG.events[-1].at_ms + number * 100)
            seq = (await quick.next_of(DELTA))["content"]["seq"]
            assert slow.waiting <= 1  # nothing is queued for it
        slow.flowing.set()
        frame = await slow.next_of(SNAPSHOT)
        assert frame["content"]["seq"] >= seq
        after = (await slow.next_of(DELTA))["content"]["seq"]
        assert after == frame["content"]["seq"] + 1


async def test_a_client_may_ask_for_a_snapshot(app: ASGIApp) -> None:
    async with opened(app) as socket:
        first = await subscribed(socket)
        socket.ask("Fleetledger::Scene::Resync", {"sceneId": SCENE})
        await socket.next_of("Fleetledger::Scene::Resync::Reply")
        again = (await socket.next_of(SNAPSHOT))["content"]
        assert again["seq"] > first["seq"]


async def test_who_unsubscribes_gets_nothing_more(
    app: ASGIApp, service: projections.api.wsm.Service, side: Side
) -> None:
    async with opened(app) as socket:
        await subscribed(socket)
        assert service.push.followed == 1
        socket.ask("Fleetledger::Scene::Unsubscribe", {"sceneId": SCENE})
        await socket.next_of("Fleetledger::Scene::Unsubscribe::Reply")
        assert service.push.followed == 0
        drive(side, LOG.events[-1].at_ms)
        while not socket.received.empty():
            assert (await socket.frame())["action"] == DELTA  # made before
        reply = await socket.answer("Nope")
        assert reply["action"] == "Nope::Error"


async def test_who_leaves_is_forgotten(app: ASGIApp, service: projections.api.wsm.Service) -> None:
    async with opened(app) as socket:
        await subscribed(socket)
        assert service.push.followed == 1
    assert service.push.followed == 0


async def test_a_client_follows_some_scenes_at_most(
    app: ASGIApp, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("projections.api.wsm.SUBSCRIPTIONS_MAX", 0)
    async with opened(app) as socket:
        reply = await socket.answer(SUBSCRIBE, {"sceneId": SCENE})
        assert reply["content"]["code"] == "errTooManyScenes"


async def test_when_the_scene_goes_its_followers_are_told(
    app: ASGIApp, side: Side, service: projections.api.wsm.Service
) -> None:
    async with opened(app) as socket:
        await subscribed(socket)
        gone = SceneRemoved(scene=SceneId(SCENE))
        at_ms = LOG.events[-1].at_ms
        side.live.apply([stamped(gone, side.live.position + 1, at_ms, "t", CommandId("c"))])
        frame = await socket.next_of(f"{SUBSCRIBE}::Error")
        assert frame["content"]["code"] == "errSceneNotFound"
        assert service.push.followed == 0
        socket.ask("Fleetledger::Scene::Unsubscribe", {"sceneId": SCENE})
        assert (await socket.frame())["content"]["code"] == "errNotSubscribed"


async def test_a_look_that_fails_stops_neither_the_push_nor_the_server(
    app: ASGIApp, monkeypatch: pytest.MonkeyPatch
) -> None:
    look: Callable[..., Any] = projections.api.wsm.SceneChanges.look
    fail = [True, False, True, False]

    def failing(*arguments: Any) -> Any:
        if fail and fail.pop():
            raise ZeroDivisionError
        return look(*arguments)

    monkeypatch.setattr("projections.api.wsm.SceneChanges.look", failing)
    async with opened(app) as socket:
        await subscribed(socket)
        await socket.next_of(DELTA)
