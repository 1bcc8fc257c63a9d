"""Any moment back: live, restored by a snapshot and folded from the first event on, the state is
the same bytes, at whatever moment one looks; and so are the answers to questions.

`stage` does it at hundreds of moments of longer shifts.
"""

import hashlib
import re
import tempfile
from bisect import bisect_right
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Any

import httpx
import pytest

from commands.devices import KeepDoorsOpen
from commands.order_suspension import SuspendOrders
from commands.orders import CancelOrder, PrioritiseOrders
from commands.rejected import Rejected
from commands.resources import ReleaseAllMapResources, RequestMapResources, UnitAsked
from commands.robot_duty import ClearRobotBins, DisableRobots, SendRobotsOffDuty
from commands.scene_life import PauseDispatch, RenameScene
from commands.steps import DeleteSteps
from fleetledger.http import ThinRoute
from fleetledger.shift import Shift
from ledger.disk import Disk
from ledger.evolve import fold
from ledger.moment import At
from ledger.scan import read_folder
from ledger.seal import seal_folder
from ledger.snapshot import restore, save
from ledger.state import Fleet
from ledger.store import FileLedger
from projections.api.m4 import router
from replay.moment import Moments
from sim.faults import FaultMix
from sim.warehouses import generate
from tests.histories import history
from tests.laws.onlooker import ask, bins_of, load, unload
from tests.projections.api.asking import application, asked_of
from tests.projections.past import Log, Side
from tests.strategies import SCENE

STEPS = 50  # of two seconds
MOMENTS = 40
SOAK_STEPS = 300
SOAK_MOMENTS = 400
COLD_MAX = 40  # folds from the first event, of one run


def digest(fleet: Fleet) -> str:
    return hashlib.sha256(fleet.canonical()).hexdigest()


class Told:
    """A shift into which somebody meddles, and the state's digest after each step of it."""

    def __init__(self, data: Path, seed: int) -> None:
        self.chance = Random(seed)
        self.data = data
        file = generate(aisles=2, bays=2, robots=3, seed=seed)
        ledger = FileLedger.open(data / "ledger", segment_chunks_max=200)
        faults = FaultMix(late_ratio=0.2, late_mean_s=3.0)
        self.shift = Shift(file, seed=seed, faults=faults, ledger=ledger)
        self.bins = bins_of(file)
        self.point = file.areas[0].points[0]
        self.digests: dict[int, str] = {0: digest(Fleet())}  # by position
        self.times: dict[int, int] = {0: 0}

    def meddle(self) -> None:
        """Do something that a client may do; what is refused changes nothing."""
        shift, chance = self.shift, self.chance
        fleet = shift.fleet
        robots = (chance.choice([robot.name for robot in fleet.robots.values()]),)
        order = chance.choice(sorted(fleet.orders)) if fleet.orders else ""
        steps = tuple(s.id for s in fleet.orders[order].steps[-1:]) if order else ()  # type: ignore[index]
        x, y = self.point.x_m, self.point.y_m
        zone = ((x, y), (x + 1.0, y), (x + 1.0, y + 1.0))
        unit = UnitAsked(id=f"u{chance.randrange(3)}", owner="WMS", zones=(zone,))
        on = chance.random() < 0.5
        of_scene: dict[str, Any] = {"scene": shift.scene}
        deeds: list[tuple[type, dict[str, Any]]] = [
            (CancelOrder, {**of_scene, "order": order}),
            (PrioritiseOrders, {"orders": (order,), "priority": chance.randrange(9)}),
            (SuspendOrders, {"orders": (order,), "suspended": on}),
            (DeleteSteps, {"order": order, "steps": steps}),
            (SendRobotsOffDuty, {**of_scene, "robots": robots, "off_duty": on}),
            (DisableRobots, {**of_scene, "robots": robots, "disabled": on}),
            (ClearRobotBins, {**of_scene, "robots": robots}),
            (RequestMapResources, {"units": (unit,)}),
            (ReleaseAllMapResources, {}),
            (RenameScene, {**of_scene, "name": f"Hall {chance.randrange(9)}", "display_order": 1}),
            (PauseDispatch, {**of_scene, "paused": on}),
            (KeepDoorsOpen, {**of_scene, "doors": (1,), "open": on, "remark": ""}),
        ]
        kind, fields = chance.choice(deeds)
        known = {name: value for name, value in fields.items() if name in kind.__struct_fields__}  # type: ignore[attr-defined]
        try:
            shift.handler.handle(ask(shift, kind, **known))
        except (Rejected, TypeError):
            return

    def go(self, steps: int) -> None:
        for _ in range(steps):
            if len(self.shift.fleet.orders) < 6:
                source, target = self.chance.sample(self.bins, 2)
                self.shift.order(load(source), unload(target))
            self.meddle()
            if self.chance.random() < 0.1:
                self.shift.restart_scheduler()
            self.shift.run(2.0, self.note)
            if self.chance.random() < 0.15:
                self.shift.ledger.wait(self.shift.fleet.position, 30)
                save(self.data / "snapshots", self.shift.fleet, kept_max=5)
        self.shift.ledger.close()

    def note(self) -> None:
        fleet = self.shift.fleet
        if fleet.position not in self.digests:
            self.digests[fleet.position] = digest(fleet)
            self.times[fleet.position] = fleet.at_ms

    def look_back(self, moments: int) -> None:
        """Compare every way back with what was then, in any order."""
        ledger, snapshots = self.data / "ledger", self.data / "snapshots"
        list(seal_folder(Disk(), ledger))
        kept = Moments(self.data)
        positions = sorted(self.digests)
        looks = [self.chance.choice(positions) for _ in range(moments)]
        for number, position in enumerate(looks):
            then = self.digests[position]
            assert digest(restore(ledger, snapshots, position=position)) == then
            assert digest(kept.fleet(At(position=position))) == then
            if number < COLD_MAX:
                assert digest(restore(ledger, Path("none"), position=position)) == then
        events = list(read_folder(ledger))
        times = [event.at_ms for event in events]
        for _ in range(moments):
            at_ms = self.chance.randrange(times[0] - 1, times[-1] + 2)
            position = bisect_right(times, at_ms)
            by_time = digest(restore(ledger, snapshots, at_ms=at_ms))
            assert by_time == digest(kept.fleet(At(at_ms=at_ms)))
            if position in self.digests:
                assert by_time == self.digests[position]


def look_back(seed: int, steps: int, moments: int) -> Told:
    with tempfile.TemporaryDirectory() as name:
        told = Told(Path(name), seed)
        told.go(steps)
        told.look_back(moments)
    return told


def test_live_replayed_and_replayed_without_snapshots_are_the_same_bytes() -> None:
    told = look_back(seed=5, steps=STEPS, moments=MOMENTS)
    assert len(told.digests) > MOMENTS


def stage(seed: int) -> None:
    """Part of the soak."""
    look_back(seed, SOAK_STEPS, SOAK_MOMENTS)


ALL = {"entityName": "TransportOrder", "query": {"type": "All"}}
OF_SCENE = f"/api/fleet/scenes/{SCENE}"
ORDER = "/api/fleet/orders/query-order-detail"
# what is of the moment of asking: which instant is shown, by what is reported or by asOf
FIELDS_OF_NOW = re.compile(rb'"(rTime|replyTimestamp|uTime)":[0-9]+,?')
# rows of ended orders have the name that the scene had at their end, or has at the moment asked of
NAME = re.compile(rb'"sceneName":"[^"]*",')


def questions(orders: list[str]) -> list[tuple[str, str, dict[str, Any]]]:
    sorted_ = {**ALL, "sort": ["-createdOn", "id"]}
    return [
        ("POST", "/api/entity/find/many", {**ALL, "sort": ["-priority", "id"]}),
        ("POST", "/api/entity/find/page", {**sorted_, "pageNo": 1, "pageSize": 7}),
        ("POST", "/api/entity/find/page", {**sorted_, "pageNo": 2, "pageSize": 7}),
        ("POST", "/api/entity/find/one", {**ALL, "sort": ["-modifiedOn", "id"]}),
        ("POST", "/api/entity/find/count", ALL),
        ("POST", "/api/entity/find/batch", {"": [{"type": "Many", "req": ALL}]}),
        *(("GET", ORDER, {"orderId": order}) for order in orders),
        ("GET", "/api/fleet/robots/all-all", {"sceneId": SCENE}),
        ("GET", "/api/fleet/scenes/list", {}),
        ("GET", f"/api/fleet/scenes/schema/{SCENE}", {}),
        ("GET", f"{OF_SCENE}/map", {}),
        ("GET", f"{OF_SCENE}/list-points-bins", {}),
        ("GET", f"{OF_SCENE}/ready-status", {}),
        ("GET", f"{OF_SCENE}/door", {}),
        ("GET", f"{OF_SCENE}/lift", {}),
        ("POST", f"{OF_SCENE}/query-all", {}),
    ]


async def answers(
    client: httpx.AsyncClient, orders: list[str], at_ms: int | None
) -> list[tuple[int, bytes]]:
    given = []
    for method, path, fields in questions(orders):
        when = {} if at_ms is None else {"asOf": str(at_ms)}
        if method == "GET":
            answer = await client.get(path, params={**fields, **when})
        else:
            answer = await client.post(path, params=when, json=fields.get("", fields))
        content = FIELDS_OF_NOW.sub(b"", answer.content)
        if method == "POST":
            content = NAME.sub(b"", content)
        given.append((answer.status_code, content))
    return given


@pytest.mark.parametrize("seed", [3, 4, 5])
async def test_answers_of_a_past_moment_are_those_that_were_given_then(
    seed: int, tmp_path: Path
) -> None:
    """Orders that have ended since, robots and scenes changed since: all as it was."""
    log = Log(history(seed, 500))
    chance = Random(seed)
    orders = sorted({e.order for e in log.events if hasattr(e, "order")})
    orders = chance.sample(orders, 6)
    quiet = [a.position for a, b in pairwise(log.events) if b.at_ms > a.at_ms and a.position > 10]
    moments = sorted(chance.sample(quiet, 12))
    side = Side(tmp_path, log, 10)
    made: Callable[..., Any] = router
    app = application(side, made(asked_of(side), ThinRoute))
    try:
        async with httpx.AsyncClient(
            transport=httpx.ASGITransport(app), base_url="http://site"
        ) as client:
            given = {}
            for position in moments:
                side.go_on(position)
                given[position] = await answers(client, orders, None)
            side.go_on(len(log.events))
            side.reach(len(log.events))
            for position in chance.sample(moments, len(moments)):
                later = await answers(client, orders, log.events[position - 1].at_ms)
                for question, then, now in zip(
                    questions(orders), given[position], later, strict=True
                ):
                    assert now == then, (position, question)
    finally:
        side.close()


def test_the_log_of_the_answers_is_one_that_changes() -> None:
    """Else the law above would say little."""
    fleets = [fold(Fleet(), history(3, count)) for count in (20, 500)]
    assert fleets[0].orders.keys() != fleets[1].orders.keys()
