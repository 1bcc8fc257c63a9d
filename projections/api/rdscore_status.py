"""The whole answer of `robotsStatus`, and its bytes: a robot that has not changed is not encoded
again (spec/rdscore.md §2).
"""

import hashlib
from collections.abc import Collection, Mapping
from datetime import UTC, datetime
from typing import Protocol

import msgspec

from ledger.ids import RobotKey, robot_key
from ledger.link import Plan, Report
from ledger.scene import PointKind, Scene, Value
from ledger.state import Fleet, Order, OrderStatus, Robot
from projections.api.m4_scene_query import PlansAt, ReportsAt
from projections.api.rdscore_rbk import Known, alarms_of, legacy
from projections.api.rdscore_report import missing_kinds, vehicle
from projections.fields import Row
from projections.find import Find

DEVICES = ("doors", "lifts", "terminals")
WAITS = 52107  # "X waits for Y"
CODES = {PointKind.CHARGING: (52101, "charge"), PointKind.PARKING: (52103, "park")}


class Shown(Protocol):
    """What is shown: the live view, or a past moment."""

    @property
    def fleet(self) -> Fleet:
        """The state."""

    @property
    def reports(self) -> Mapping[RobotKey, Report]:
        """What robots said last."""

    @property
    def plans(self) -> Mapping[RobotKey, Plan]:
        """What traffic intends with them."""


class Past(Value, frozen=True, kw_only=True):
    """A past moment, as far as it was written."""

    fleet: Fleet
    reports: Mapping[RobotKey, Report]
    plans: Mapping[RobotKey, Plan]


async def past_of(find: Find, reports_at: ReportsAt, plans_at: PlansAt, at_ms: int) -> Past:
    """Look a moment up: the state, and the telemetry of all its scenes."""
    fleet = await find.fleet(at_ms)

    def read() -> Past:
        reports = {(s, name): r for s in fleet.scenes for name, r in reports_at(s, at_ms).items()}
        plans = {(s, name): p for s in fleet.scenes for name, p in plans_at(s, at_ms).items()}
        return Past(
            fleet=fleet,
            reports={robot_key(*key): report for key, report in reports.items()},
            plans={robot_key(*key): plan for key, plan in plans.items()},
        )

    return await find.beside(read)


class Status:
    """Makes answers from what is shown; keeps the encoded robots."""

    def __init__(self, live: Shown, since_ms: int) -> None:
        self._live = live
        self._encoded: dict[RobotKey, tuple[Known, bytes]] = {}
        self._since_s = since_ms // 1000  # when the alarms of the core began, for all we know

    def whole(self, now_ms: int, devices: Collection[str], names: Collection[str] | None) -> Row:
        """Give the complete answer as an object, to be filtered; `names` None = all robots."""
        report = [vehicle(known) for known in self._robots(names)]
        return self._frame(now_ms, devices) | {"report": report}

    def encoded(
        self, now_ms: int, devices: Collection[str] = (), names: Collection[str] | None = None
    ) -> bytes:
        """Give the complete answer as bytes, keys in alphabetical order."""
        report = b"[" + b",".join(self._fragment(k) for k in self._robots(names)) + b"]"
        frame = self._frame(now_ms, devices) | {"report": msgspec.Raw(report)}
        return msgspec.json.encode(frame, order="sorted")

    def _fragment(self, known: Known) -> bytes:
        kept = self._encoded.get(known.key)
        if kept is not None and _same(kept[0], known):
            return kept[1]
        fragment = msgspec.json.encode(vehicle(known), order="sorted")
        self._encoded[known.key] = (known, fragment)
        return fragment

    def _robots(self, names: Collection[str] | None) -> list[Known]:
        live = self._live
        if len(self._encoded) > 2 * len(live.fleet.robots):
            self._encoded.clear()  # of robots that have left
        robots = live.fleet.robots.values()
        return [self._known(r) for r in robots if names is None or r.name in names]

    def _known(self, robot: Robot) -> Known:
        live = self._live
        key = robot_key(robot.scene, robot.name)
        return Known(
            key=key,
            robot=robot,
            scene=live.fleet.scenes[robot.scene],
            report=live.reports.get(key),
            plan=live.plans.get(key),
            order=_current([live.fleet.orders[id_] for id_ in robot.orders]),
        )

    def _scenes(self) -> list[Scene]:
        return [scene for scene in self._live.fleet.scenes.values() if not scene.removed]

    def _frame(self, now_ms: int, devices: Collection[str]) -> Row:
        scenes = self._scenes()
        core = self._alarms()
        digests = [scene.digest for scene in scenes]
        models = [scene.groups for scene in scenes]
        return {
            **envelope(0, "ok", now_ms),
            **{name: [] for name in devices},  # we drive none yet
            "alarms": core,
            "disable_paths": [],
            "disable_points": [],
            "dynamic_obstacle": {},
            "errors": legacy(core["errors"]),
            "fatals": [],
            "is_error": False,
            "model_md5": _md5(msgspec.json.encode(models)),
            "notices": [],
            "scene_md5": _md5("".join(digests).encode()),
            "warnings": [],
        }

    def _alarms(self) -> dict[str, list[Row]]:
        """Say which robots have nowhere to charge or to park, and which cannot get on."""
        alarms = alarms_of(())
        live = self._live
        for scene in self._scenes():
            names = [r.name for r in live.fleet.robots.values() if r.scene == scene.id]
            for kind in missing_kinds(scene) if names else ():
                code, word = CODES[kind]
                alarms["errors"].append(
                    {
                        "code": code,
                        "desc": f"{','.join(names)}, have no {word} point in map.",
                        "times": 1,
                        "timestamp": self._since_s,
                    }
                )
        for plan in live.plans.values():
            if plan.alarm is not None:
                alarms["errors"].append(
                    {
                        "code": WAITS,
                        "desc": plan.alarm.message,
                        "times": plan.alarm.times,
                        "timestamp": plan.alarm.at_ms // 1000,
                    }
                )
        return alarms


def envelope(code: int, message: str, now_ms: int) -> Row:
    """Give what every answer has: code, message, and when it was made (ISO text, R1)."""
    moment = datetime.fromtimestamp(now_ms // 1000, UTC)
    return {
        "code": code,
        "create_on": f"{moment:%Y-%m-%dT%H:%M:%S}.{now_ms % 1000:03}Z",
        "msg": message,
    }


def _current(orders: list[Order]) -> Order | None:
    executing = (order for order in orders if order.status is OrderStatus.EXECUTING)
    return next(executing, orders[0] if orders else None)


def _same(one: Known, other: Known) -> bool:
    """Values are replaced and never changed, so the same objects look the same."""
    names = ("robot", "scene", "report", "plan", "order")
    return all(getattr(one, name) is getattr(other, name) for name in names)


def _md5(content: bytes) -> str:
    return hashlib.md5(content, usedforsecurity=False).hexdigest()


def parsed(text: str | None) -> list[str]:
    """Read a list of names separated by commas."""
    return [] if text is None else [part for raw in text.split(",") if (part := raw.strip())]
