"""A small plant with a scripted past: what happened and what robots reported, minute by minute.

R1 carries an order from B1 to B4 again and again; R2 stands and charges; R3 is offline. A second
order waits throughout, because no robot can take it. Time is the script's own.
"""

import asyncio
import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from msgspec.structs import replace

from ledger.events import (
    AnyEvent,
    AssignmentRejected,
    OrderAssigned,
    OrderCreated,
    OrderFinished,
    RobotAdded,
    RobotConnected,
    SceneImported,
    StepFinished,
    StepStarted,
    stamped,
)
from ledger.evolve import evolve
from ledger.ids import CommandId, OrderId, PathKey, PointName, RobotKey, RobotName, SceneId
from ledger.ids import robot_key as key
from ledger.link import EXTERNAL, Load, Plan, Report, Space
from ledger.state import Candidate, Fleet, Order, StepTask
from ledger.store import FileLedger
from ledger.telemetry import TelemetryLog
from ledger.waits import Wait, WaitReason
from replay.moment import Moments
from replay.source import Source
from tests.strategies import grid

SCENE = SceneId("5f0c1e9a2b3c4d5e6f708192")
START_MS = 1_795_343_400_000  # 2026-11-22 10:30 UTC
R1, R2, R3 = RobotName("R1"), RobotName("R2"), RobotName("R3")
WAITING = OrderId("TO20261122-000001")
TURN_MS = 40_000  # one order from B1 to B4 and the way back
SPEED_MPS = 1.0
COLUMNS, PITCH_M = 6, 3.0
FAR_M = (COLUMNS - 1) * PITCH_M
CHAIN_MS, CHAIN_FORMS_MS, CHAIN_GROWS_MS = 8_000, 2_000, 4_000  # again and again


def carried(turn: int) -> OrderId:
    """The order of one turn."""
    return OrderId(f"TO20261122-{turn + 2:06}")


def script() -> Iterator[tuple[int, AnyEvent]]:
    """Blank events with their times, for ever."""
    file = grid(columns=COLUMNS, rows=4, robots=3, pitch_m=PITCH_M)
    yield (
        0,
        SceneImported(
            scene=SCENE, name="Hall 1", digest="d" * 64, areas=file.areas, groups=file.groups
        ),
    )
    for config in file.robots:
        yield 0, RobotAdded(scene=SCENE, config=config)
    yield 100, RobotConnected(scene=SCENE, robot=R1)
    yield 100, RobotConnected(scene=SCENE, robot=R2)
    last = StepTask(location="B2", unloads=True)
    yield 1_000, OrderCreated(scene=SCENE, order=WAITING, tasks=(last,), wanted_robots=(R3,))
    why = {R1: "RobotNotWanted", R2: "RobotNotWanted", R3: "RobotOffline"}
    yield (
        1_200,
        AssignmentRejected(scene=SCENE, order=WAITING, code="AllRobotUnDispatchable", robots=why),
    )
    turn = 0
    while True:
        at_ms, order = 2_000 + turn * TURN_MS, carried(turn)
        tasks = (StepTask(location="B1", loads=True), StepTask(location="B6", unloads=True))
        yield (
            at_ms,
            OrderCreated(scene=SCENE, order=order, tasks=tasks, sealed=True, container=f"C{turn}"),
        )
        candidates = (Candidate(robot=R1, cost_s=2.5), Candidate(robot=R2, reason="Charging"))
        yield (
            at_ms + 400,
            OrderAssigned(
                scene=SCENE, order=order, robot=R1, bin=0, cost_s=2.5, candidates=candidates
            ),
        )
        yield at_ms + 500, StepStarted(scene=SCENE, order=order, step=0, robot=R1)
        yield at_ms + 2_000, StepFinished(scene=SCENE, order=order, step=0, robot=R1)
        yield at_ms + 2_100, StepStarted(scene=SCENE, order=order, step=1, robot=R1)
        yield at_ms + 19_000, StepFinished(scene=SCENE, order=order, step=1, robot=R1)
        yield at_ms + 19_000, OrderFinished(scene=SCENE, order=order)
        turn += 1


def reports(at_ms: int) -> list[Report]:
    """What the two connected robots report at a time of the script."""
    in_turn = (at_ms - START_MS - 4_000) % TURN_MS / 1000
    loaded = 0 <= in_turn < 16
    along_m = min(in_turn, FAR_M) if in_turn < 18 else max(0.0, FAR_M - (in_turn - 18))
    moving = 0 < along_m < FAR_M
    common = {"scene": SCENE, "number": at_ms, "at_ms": at_ms, "area": 0}
    return [
        Report(
            **common,
            robot=R1,
            x_m=along_m,
            y_m=0.0,
            heading_rad=0.0 if in_turn < 18 else math.pi,
            speed_mps=SPEED_MPS if moving else 0.0,
            battery_ratio=0.72,
            loads=(Load(bin=0, container="C"),) if loaded else (),
        ),
        Report(
            **common,
            robot=R2,
            x_m=0.0,
            y_m=3 * PITCH_M,
            heading_rad=math.pi / 2,
            point=PointName("CP19"),
            battery_ratio=0.31,
            charging=True,
        ),
    ]


def plans(at_ms: int) -> list[Plan]:
    """What traffic intends with R1: the rest of the way, and the ground around it."""
    robot = reports(at_ms)[0]
    there = robot.heading_rad == 0.0
    column = int(robot.x_m // PITCH_M)
    names = [f"AP{n + 1}" for n in range(COLUMNS)]
    left = names[column:] if there else names[: column + 1][::-1]
    behind_m, ahead_m = (-0.7, 2.2) if there else (0.7, -2.2)
    corners = ((behind_m, -0.5), (ahead_m, -0.5), (ahead_m, 0.5), (behind_m, 0.5))
    ground = tuple((robot.x_m + x, y) for x, y in corners)
    pairs = pairwise(left)
    plan = Plan(
        scene=SCENE,
        robot=R1,
        at_ms=at_ms,
        ready=True,
        target=PointName(left[-1]),
        untravelled=tuple(PathKey(f"{a}->{b}") for a, b in pairs),
        spaces=(Space(points=ground),),
        moving=robot.speed_mps > 0,
    )
    waits = {wait.robot: wait for wait in waits_at(at_ms)}
    other = Plan(scene=SCENE, robot=R2, at_ms=at_ms, ready=True, wait=waits.get(R2))
    return [replace(plan, wait=waits.get(R1)), other]


def waits_at(at_ms: int) -> list[Wait]:
    """A chain that forms and dissolves: first R2 waits for R1, then R1 for reserved ground."""
    begun_ms = at_ms - (at_ms - START_MS) % CHAIN_MS
    found = []
    if at_ms >= begun_ms + CHAIN_FORMS_MS:
        first = {"since_ms": begun_ms + CHAIN_FORMS_MS, "reason": WaitReason.BEHIND_ROBOT}
        found.append(Wait(robot=R2, blockers=(R1,), place=PointName("AP13"), **first))
    if at_ms >= begun_ms + CHAIN_GROWS_MS:
        then = {"since_ms": begun_ms + CHAIN_GROWS_MS, "reason": WaitReason.RESERVED_GROUND}
        found.append(Wait(robot=R1, blockers=(RobotName(f"{EXTERNAL}lift maintenance"),), **then))
    return found


class Site:
    """The plant up to some time: its ledger, its telemetry, and what a server would hand on."""

    def __init__(self, data: Path) -> None:
        self.data = data
        self.now_ms = START_MS
        self.ledger = FileLedger.open(data / "ledger")
        self.telemetry = TelemetryLog(data / "telemetry")
        self.fleet = Fleet()
        self.finished: dict[OrderId, Order] = {}
        self.reports: dict[RobotKey, Report] = {}
        self.plans: dict[RobotKey, Plan] = {}
        self._script = script()
        self._next = next(self._script)
        self.source = Source(
            data,
            Moments(data, read=self.ledger.read),
            now_ms=lambda: self.now_ms,
            live=lambda: self.fleet,
            comes=self._comes,
            reports=self.reports,
            plans=self.plans,
        )

    def run(self, seconds: float) -> None:
        """Let time pass, in steps of 100 ms."""
        for _ in range(round(seconds * 10)):
            self.now_ms += 100
            events = []
            while START_MS + self._next[0] <= self.now_ms:
                at_ms, blank = self._next
                position = self.ledger.position + len(events) + 1
                events.append(
                    stamped(blank, position, START_MS + at_ms, "alice", CommandId(f"c{position}"))
                )
                self._next = next(self._script)
            if events:
                position = self.ledger.append(events, self.ledger.position)
                assert self.ledger.wait(position, 10)
            for event in events:
                evolve(self.fleet, event)
            for report in reports(self.now_ms):
                self.reports[key(SCENE, report.robot)] = report
            for plan in plans(self.now_ms):
                self.plans[key(SCENE, plan.robot)] = plan
            self.telemetry.write(reports(self.now_ms))
            self.telemetry.write_plans(plans(self.now_ms))
        self.telemetry.flush()

    async def _comes(self, position: int) -> bool:
        """Wait as a server does, but not for long."""
        for _ in range(20):
            if self.fleet.position >= position:
                return True
            await asyncio.sleep(0)
        return False

    def close(self) -> None:
        """Finish the files."""
        self.ledger.close()
        self.telemetry.close()
