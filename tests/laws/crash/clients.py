"""Clients of the simulated core: what they ask for, each thing under a key of its own."""

import hashlib
import json
from random import Random
from typing import Any

from commands.command import Decision
from commands.handle import Reply
from commands.instructions import PauseRobots, SoftStopRobots
from commands.orders import CancelOrder, CreateOrder, PrioritiseOrders, SealOrder
from commands.rejected import Rejected
from commands.resources import ReleaseMapResources, RequestMapResources, UnitAsked
from commands.robot_duty import SendRobotsOffDuty
from commands.scene_config import ConfigureScene
from commands.steps import AddSteps
from ledger.ids import CommandId, OrderId, SceneId
from ledger.scene import SceneFile, Value
from ledger.scene_config import SceneConfig
from ledger.state import StepTask
from tests.laws.onlooker import bins_of, load, unload

SCENE = SceneId("0" * 23 + "A")


class Request(Value, frozen=True, kw_only=True):
    """What a client wants, however often it has to say so."""

    key: CommandId
    kind: type
    fields: dict[str, Any]

    def command(self, at_ms: int) -> Any:
        """The command as of now."""
        return self.kind(id=self.key, by="client", at_ms=at_ms, **self.fields)

    @property
    def digest(self) -> str:
        """Tells requests apart."""
        return hashlib.sha256(repr((self.kind.__name__, self.fields)).encode()).hexdigest()


def answer(outcome: Decision | Rejected) -> Reply:
    """Put a decision into words, as a dialect does."""
    if isinstance(outcome, Rejected):
        return Reply(status=400, body=json.dumps({"code": outcome.code}))
    refused = sorted(outcome.refused)
    return Reply(status=200, body=json.dumps({"made": outcome.made, "refused": refused}))


class Clients:
    """Draws requests; knows of the orders only what it was told."""

    def __init__(self, rng: Random, file: SceneFile, orders: list[OrderId]) -> None:
        self.orders = orders  # acknowledged, the newest last
        self._rng = rng
        self._bins = bins_of(file)
        self._points = file.areas[0].points
        self._robots = tuple(robot.name for robot in file.robots)
        self._asked = 0

    def request(self) -> Request:
        """Draw the next request."""
        rng = self._rng
        draw = rng.choices(
            (
                self._carry,
                self._promise,
                self._add_steps,
                self._seal,
                self._cancel,
                self._prioritise,
                self._configure,
                self._instruct,
                self._reserve,
                self._give_back,
                self._nonsense,
            ),
            (8, 3, 4, 2, 2, 3, 1, 2, 2, 1, 1),
        )[0]
        kind, fields = draw()
        self._asked += 1
        key = CommandId(f"client/{self._asked}-{rng.getrandbits(32):08x}")
        return Request(key=key, kind=kind, fields=fields)

    def _order(self) -> OrderId:
        if not self.orders or self._rng.random() < 0.05:
            return OrderId("TO-none")
        return self._rng.choice(self.orders[-8:])

    def _carry(self) -> tuple[type, dict[str, Any]]:
        source, target = self._rng.sample(self._bins, 2)
        tasks = (load(source), unload(target))
        priority = self._rng.choice((0, 0, 5))
        return CreateOrder, {"scene": SCENE, "sealed": True, "tasks": tasks, "priority": priority}

    def _promise(self) -> tuple[type, dict[str, Any]]:
        places = (self._rng.choice(self._bins),)
        return CreateOrder, {"scene": SCENE, "sealed": False, "key_locations": places}

    def _add_steps(self) -> tuple[type, dict[str, Any]]:
        count = self._rng.choice((1, 1, 2, 40))
        tasks = tuple(StepTask(location=self._rng.choice(self._bins)) for _ in range(count))
        return AddSteps, {"order": self._order(), "tasks": tasks}

    def _seal(self) -> tuple[type, dict[str, Any]]:
        return SealOrder, {"order": self._order()}

    def _cancel(self) -> tuple[type, dict[str, Any]]:
        return CancelOrder, {"scene": SCENE, "order": self._order()}

    def _prioritise(self) -> tuple[type, dict[str, Any]]:
        return PrioritiseOrders, {
            "orders": (self._order(),),
            "priority": self._rng.randrange(-5, 100),
        }

    def _configure(self) -> tuple[type, dict[str, Any]]:
        config = SceneConfig(reallocation_off=self._rng.random() < 0.5)
        return ConfigureScene, {"scene": SCENE, "config": config}

    def _instruct(self) -> tuple[type, dict[str, Any]]:
        kind, field = self._rng.choice(
            ((PauseRobots, "paused"), (SoftStopRobots, "stopped"), (SendRobotsOffDuty, "off_duty"))
        )
        robots = (self._rng.choice(self._robots),)
        return kind, {"scene": SCENE, "robots": robots, field: self._rng.random() < 0.4}

    def _reserve(self) -> tuple[type, dict[str, Any]]:
        point, wide = self._rng.choice(self._points), self._rng.uniform(0.1, 3.0)
        x, y = point.x_m - wide / 3, point.y_m - wide / 4
        zone = ((x, y), (x + wide, y), (x + wide, y + wide), (x, y + wide))
        owner = self._rng.choice(("WMS", "MES"))
        unit = UnitAsked(id=f"u{self._rng.randrange(4)}", owner=owner, zones=(zone,))
        return RequestMapResources, {"units": (unit,)}

    def _give_back(self) -> tuple[type, dict[str, Any]]:
        return ReleaseMapResources, {"units": (f"u{self._rng.randrange(4)}",)}

    def _nonsense(self) -> tuple[type, dict[str, Any]]:
        tasks = (StepTask(location="nowhere"),)
        return CreateOrder, {"scene": SCENE, "sealed": True, "tasks": tasks}
