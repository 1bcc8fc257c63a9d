"""Changes applied to a snapshot give what a scene query shows, whatever happens meanwhile."""

import json
from pathlib import Path
from random import Random
from typing import Any

import msgspec
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ledger.ids import PathKey, PointName, RobotName
from ledger.link import (
    ActionPhase,
    ActionReport,
    Alarm,
    AlarmLevel,
    Load,
    Plan,
    Report,
    Space,
)
from ledger.waits import Wait, WaitReason
from projections.api.m4_models import OrderQueryType, SceneDataAsked
from projections.api.scene_changes import FOLLOWED, SceneChanges
from tests.histories import history
from tests.projections.api.asking import asked_of
from tests.projections.api.follower import Follower
from tests.projections.past import Log, Side
from tests.strategies import SCENE

UNFINISHED = SceneDataAsked(order_query_type=OrderQueryType.UNFINISHED)


def wait_of(robot: RobotName, since_ms: int) -> Wait:
    reason, blockers = WaitReason.BEHIND_ROBOT, (RobotName("R9"),)
    return Wait(robot=robot, since_ms=since_ms, reason=reason, blockers=blockers)


class Site:
    """A read side on which anything may happen: events, reports late and early, plans."""

    def __init__(self, folder: Path, seed: int, events: int) -> None:
        self.random = Random(seed)
        self.side = Side(folder, Log(history(seed, events)), 1)
        self.queries = asked_of(self.side)
        self.now_ms = self.side.log.events[0].at_ms
        self.poses: dict[str, tuple[float, float, float]] = {}

    def happen(self) -> None:
        self.now_ms += self.random.randrange(150)
        match self.random.randrange(4):
            case 0:
                position = self.side.live.position
                self.side.go_on(min(position + self.random.randrange(1, 6), self._last))
            case 1:
                self._plan()
            case _:
                for robot in self._robots():
                    if self.random.random() < 0.8:
                        self._report(robot)

    @property
    def _last(self) -> int:
        return self.side.log.events[-1].position

    def _robots(self) -> list[RobotName]:
        return [robot.name for robot in self.side.live.fleet.robots.values()]

    def _report(self, robot: RobotName) -> None:
        random = self.random
        x, y, heading = self.poses.get(robot, (0.0, 0.0, 0.0))
        if random.random() < 0.7:
            x, y = x + random.uniform(-1, 1), y + random.uniform(-1, 1)
            heading += random.uniform(-4, 4)
        self.poses[robot] = (x, y, heading)
        some = random.random() < 0.2
        alarm = Alarm(level=AlarmLevel.ERROR, code="1", message="m", at_ms=self.now_ms)
        self.side.live.observe(
            Report(
                scene=SCENE,
                robot=robot,
                number=1,
                at_ms=self.now_ms - random.choice((0, 0, 30, 2_000)),
                area=random.choice((0, 0, 0, 1)),
                x_m=x,
                y_m=y,
                heading_rad=heading,
                speed_mps=random.choice((0.0, 0.5, -0.0004)),
                turn_radps=random.choice((0.0, 1.0)),
                point=PointName("AP1") if some else None,
                battery_ratio=random.random(),
                paused=some,
                controller=random.choice(("fleetledger", "", "somebody")),
                blocked_reason=1 if some else None,
                alarms=(alarm,) if some else (),
                loads=(Load(bin=0, container="C1"),) if some else (),
                action=ActionReport(id="a", phase=ActionPhase.RUNNING) if some else None,
            )
        )

    def _plan(self) -> None:
        random = self.random
        stuck = Alarm(level=AlarmLevel.ERROR, code="TrafficStuck", message="m", at_ms=self.now_ms)
        for robot in self._robots():
            paths = tuple(PathKey(f"AP{n}->AP{n + 1}") for n in range(random.randrange(2)))
            self.side.live.intend(
                Plan(
                    scene=SCENE,
                    robot=robot,
                    at_ms=self.now_ms,
                    ready=random.random() < 0.9,
                    target=PointName("AP9") if random.random() < 0.5 else None,
                    untravelled=paths,
                    spaces=(
                        Space(points=((0.0, 0.0), (1.0, 0.0), (1.0, random.choice((0.5, 1.0))))),
                    ),
                    blocked_by=(RobotName("R1"),) if random.random() < 0.2 else (),
                    commit=random.randrange(3),
                    moving=random.random() < 0.5,
                    alarm=stuck if random.random() < 0.2 else None,
                    wait=wait_of(robot, self.now_ms) if random.random() < 0.2 else None,
                )
            )

    async def shown(self, fields: tuple[str, ...] = FOLLOWED) -> Any:
        reply, _ = await self.queries.answer(SCENE, UNFINISHED, None, fields)
        return json.loads(msgspec.json.encode(reply))


def changes_of(site: Site) -> SceneChanges:
    queries = site.queries
    return SceneChanges(site.side.live, SCENE, queries.beside, queries.encoded, lambda: 0)


@settings(
    max_examples=30,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(seed=st.integers(0, 2**16), steps=st.lists(st.integers(0, 4), min_size=1, max_size=40))
async def test_changes_applied_to_a_snapshot_give_what_a_query_shows(
    tmp_path_factory: Any, seed: int, steps: list[int]
) -> None:
    site = Site(tmp_path_factory.mktemp("site"), seed, 400)
    try:
        changes = changes_of(site)
        wanted = frozenset(FOLLOWED)
        changes.look(wanted)
        follower = Follower(changes.whole(FOLLOWED), changes.instant_ms)
        for number in steps:
            for _ in range(number):
                site.happen()
            follower.apply(changes.look(wanted), changes.instant_ms)
            shown = await site.shown()
            assert follower.scene() == shown
            again = Follower(changes.whole(FOLLOWED), changes.instant_ms)
            assert again.scene() == shown
    finally:
        site.side.close()


async def test_a_scene_in_which_nothing_happens_gives_no_changes(tmp_path: Path) -> None:
    site = Site(tmp_path, 24, 200)
    for _ in range(40):
        site.happen()
    changes = changes_of(site)
    wanted = frozenset(FOLLOWED)
    assert set(changes.look(wanted)) == set(FOLLOWED) - {"orders", "ordersRecords"} | {
        field for field in ("orders", "ordersRecords") if site.side.live.fleet.orders
    }
    assert changes.look(wanted) == {}
    site.side.close()


async def test_a_wait_alone_is_told_as_it_forms_and_dissolves(tmp_path: Path) -> None:
    site = Site(tmp_path, 24, 200)
    for _ in range(40):
        site.happen()
    changes = changes_of(site)
    wanted = frozenset({"trafficDebug"})
    changes.look(wanted)
    key, plan = next(iter(site.side.live.plans.items()))
    for wait in (wait_of(plan.robot, 1), wait_of(plan.robot, 2), None):
        site.side.live.intend(msgspec.structs.replace(plan, wait=wait))
        told = json.loads(changes.look(wanted)["trafficDebug"])["waits"]
        mine = [row["since"] for row in told if row["robot"] == plan.robot]
        assert mine == ([] if wait is None else [wait.since_ms]), key
    site.side.close()


async def test_only_wanted_fields_are_made(tmp_path: Path) -> None:
    site = Site(tmp_path, 7, 200)
    changes = changes_of(site)
    changes.look(frozenset({"robots"}))
    for _ in range(40):
        site.happen()
        assert changes.look(frozenset({"robots"})).keys() <= {"robots"}
    found = changes.look(frozenset({"robots", "goingCount"}))
    assert "goingCount" in found
    site.side.close()
