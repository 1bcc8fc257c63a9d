"""What `Fleet::Scene::Query` and its HTTP twin answer: all that moves in a scene (spec/m4.md §6).

Readings where the source is silent:
- `traffic` among the excluded stands for `trafficConditions` and the robots' ground and ways;
- `dispatchProfile`, whose type is not described, counts the unfinished orders by status;
- `trafficDebug` counts the robots that traffic knows, moves, and holds back;
- orders are neither made at random nor replayed here, so those three fields say so;
- the congestion of a path is the number of robots that are on it or have it as their next;
- `occupied` and `container` of a place for bins are null: no stock is kept.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any, TypeAlias

import msgspec

from ledger.errors import Refused
from ledger.ids import RobotKey, RobotName, SceneId
from ledger.link import Plan, Report
from ledger.scene import Scene, Value
from ledger.scene_config import SceneConfig
from ledger.state import Fleet, Order, OrderStatus, Robot
from projections.api.m4_models import OrderQueryType, SceneDataAsked
from projections.api.m4_order_rows import (
    UNFINISHED_MAX,
    EncodedOrders,
    dispatch_profile,
    newest,
    record,
    shown_orders,
    unfinished,
)
from projections.api.m4_robots import Seen, ui_report
from projections.api.m4_scenes import scene_asked
from projections.api.m4_seen import robots_of, seen_now, seen_then
from projections.fields import Row
from projections.find import Find
from projections.live import Live
from projections.shared import Shared

# the reply of the seed, and what newer clients find beside it (spec/protocols.md §1.5)
SEED_FIELDS = (
    "status",
    "robots",
    "orders",
    "goingCount",
    "faultCount",
    "ordersRecords",
    "dispatchProfile",
    "trafficDebug",
    "sceneConfig",
    "trafficConditions",
    "keepOrderNum",
    "randomOrdersOn",
    "replayOrdersStop",
    "doors",
    "lifts",
)
FIELDS = (*SEED_FIELDS, "pauseStatus", "externalMapRes", "fleetBins", "replyTimestamp")
TRAFFIC = "traffic"  # among the excluded: more than one field
TRAFFIC_OF_ROBOTS = ("unTravelled", "spaces")
PLAN_FIELDS = frozenset({"status", "trafficDebug", "trafficConditions"})

ReportsAt: TypeAlias = Callable[[SceneId, int], Mapping[RobotName, Report]]
PlansAt: TypeAlias = Callable[[SceneId, int], Mapping[RobotName, Plan]]
PlansOfRobots: TypeAlias = tuple[tuple[Robot, Plan | None], ...]


class Beside(Value, frozen=True, kw_only=True):
    """What others know of a scene, each as it is on the wire."""

    config: Callable[[SceneConfig], Row]
    # the devices of a past state have not reported: then there is no live view
    doors: Callable[[Live | None, Fleet, Scene], Row]
    lifts: Callable[[Live | None, Fleet, Scene], Row]
    map_resources: Callable[[Fleet, Scene], Any]


class Look(Value, frozen=True, kw_only=True):
    """A scene as it is, or as it was."""

    fleet: Fleet
    scene: Scene
    live: Live | None  # None = the past
    plans: PlansOfRobots  # of the enabled robots
    orders: tuple[Order, ...]  # unfinished
    at_ms: int


class SceneQueries:
    """Answers scene queries, of now and of any moment."""

    def __init__(
        self,
        find: Find,
        reports_at: ReportsAt,
        plans_at: PlansAt,
        beside: Beside,
        shared: Shared | None = None,
    ) -> None:
        """Take the orders, what robots reported and traffic intended (slow), and the rest.

        With `shared`, who asks what others are asking gets their answer.
        """
        self.find = find
        self.shared = shared
        self.beside = beside
        self.encoded = EncodedOrders()
        self._reports_at = reports_at
        self._plans_at = plans_at

    async def seen(self, fleet: Fleet, scene: Scene, at_ms: int | None) -> tuple[Seen, ...]:
        """See the enabled robots of a scene, at one instant."""
        if at_ms is None:
            return tuple(seen_now(self.find.live, scene))
        reports, plans = await self.find.beside(
            lambda: (self._reports_at(scene.id, at_ms), self._plans_at(scene.id, at_ms))
        )
        return tuple(seen_then(fleet, scene, reports, plans, at_ms))

    async def reports(self, scene: SceneId, at_ms: int) -> Mapping[RobotName, Report]:
        """Give what each robot had last reported at a past moment."""
        return await self.find.beside(lambda: self._reports_at(scene, at_ms))

    async def plans(self, fleet: Fleet, scene: Scene, at_ms: int | None) -> PlansOfRobots:
        """Give what traffic intends, or intended, with each enabled robot of a scene."""
        if at_ms is None:
            return plans_now(self.find.live, scene)
        plans = await self.find.beside(lambda: self._plans_at(scene.id, at_ms))
        return tuple((robot, plans.get(robot.name)) for robot in enabled(fleet, scene).values())

    async def answer(
        self, scene_id: str, asked: SceneDataAsked, at_ms: int | None, fields: Iterable[str]
    ) -> tuple[Row, int]:
        """Give the reply, and the position at which it is so; builds nothing that is excluded."""
        excluded = set(asked.excluded or ())
        if TRAFFIC in excluded:
            excluded.add("trafficConditions")
        wanted = [field for field in fields if field not in excluded]
        fleet = await self.find.fleet(at_ms)
        scene = scene_asked(fleet, scene_id, None)
        robots = await self.seen(fleet, scene, at_ms) if "robots" in wanted else ()
        needed = not PLAN_FIELDS.isdisjoint(wanted)
        plans = await self.plans(fleet, scene, at_ms) if needed else ()
        # of the present nothing above has waited, so all that is shown is of one state
        position = fleet.position
        look = Look(
            fleet=fleet,
            scene=scene,
            live=self.find.live if at_ms is None else None,
            plans=plans,
            orders=tuple(unfinished(fleet, scene)),
            at_ms=self.find.now_ms() if at_ms is None else at_ms,
        )
        reply: Row = {}
        for field in wanted:
            if field == "robots":
                reply[field] = robot_rows(robots, asked)
            elif field != "orders":
                reply[field] = field_value(field, look, self.beside)
        if "orders" in wanted:  # may wait for the history
            kind = asked.order_query_type or OrderQueryType.ALL
            shown = await shown_orders(self.find, list(look.orders), scene, kind, at_ms)
            reply["orders"] = self.encoded.rows(shown, scene)
        return {field: reply[field] for field in wanted}, position


def enabled(fleet: Fleet, scene: Scene) -> dict[RobotKey, Robot]:
    """Give the robots of a scene that clients see."""
    robots = robots_of(fleet, scene)
    return {key: robot for key, robot in robots.items() if not robot.config.disabled}


def plans_now(live: Live, scene: Scene) -> PlansOfRobots:
    """Give what traffic intends with each enabled robot."""
    return plans_of(live, enabled(live.fleet, scene))


def plans_of(live: Live, robots: Mapping[RobotKey, Robot]) -> PlansOfRobots:
    """Give what traffic intends with each of these robots."""
    return tuple([(robot, live.plans.get(key)) for key, robot in robots.items()])


def robot_rows(robots: Iterable[Seen], asked: SceneDataAsked) -> Row:
    """Give the UiRobotReports of a scene query, by name."""
    raw = bool(asked.with_raw or asked.raw_all or asked.raw_fields)
    rows: Row = {s.robot.name: ui_report(s, raw=raw, raw_fields=asked.raw_fields) for s in robots}
    if TRAFFIC in (asked.excluded or ()):
        for row in rows.values():
            for field in TRAFFIC_OF_ROBOTS:
                del row[field]
    return rows


def field_value(field: str, look: Look, beside: Beside) -> Any:
    """Give one top-level field but robots and orders."""
    match field:
        case "status":
            return status(look.scene, look.plans)
        case "goingCount":
            return sum(order.status is OrderStatus.EXECUTING for order in look.orders)
        case "faultCount":
            return sum(order.fault_reason is not None for order in look.orders)
        case "ordersRecords":
            return {o.id: record(o) for o in newest(look.orders, UNFINISHED_MAX)}
        case "dispatchProfile":
            return dispatch_profile(look.orders)
        case "trafficDebug":
            return traffic_debug(look.plans)
        case "trafficConditions":
            return congestion(look.plans)
        case "doors":
            return beside.doors(look.live, look.fleet, look.scene)
        case "lifts":
            return beside.lifts(look.live, look.fleet, look.scene)
        case "externalMapRes":
            return beside.map_resources(look.fleet, look.scene)
        case "replyTimestamp":
            return look.at_ms
        case _:
            return scene_field(field, look.scene, beside)


def scene_field(field: str, scene: Scene, beside: Beside) -> Any:
    """Give a top-level field that comes from the scene alone."""
    match field:
        case "sceneConfig":
            return beside.config(scene.config)
        case "keepOrderNum":
            return 0
        case "randomOrdersOn":
            return False
        case "replayOrdersStop":
            return True
        case "pauseStatus":
            return scene.dispatch_paused
        case "fleetBins":
            return bins_of(scene)
        case _:
            raise AssertionError(field)


def status(scene: Scene, plans: PlansOfRobots) -> str:
    """Give the SceneStatus: initialising until traffic has spoken of a robot that answers."""
    if scene.removed:
        return "Disposed"
    if scene.disabled:
        return "Disabled"
    online = [plan for robot, plan in plans if robot.online]
    known = not online or any(plan is not None for plan in online)
    return "Initialized" if known else "Initializing"


def congestion(plans: PlansOfRobots) -> Row:
    """Count the robots on each path or before it; paths without any are left out."""
    ways = [plan.untravelled for _, plan in plans if plan is not None]
    return dict(Counter([way[0] for way in ways if way]))


def traffic_debug(plans: PlansOfRobots) -> Row:
    """Count robots by what traffic does with them, and say who waits for whom."""
    known = [plan for _, plan in plans if plan is not None]
    return {
        "ready": sum(plan.ready for plan in known),
        "moving": sum(plan.moving for plan in known),
        "blocked": sum(bool(plan.blocked_by) for plan in known),
        "waits": [
            {
                "robot": plan.wait.robot,
                "reason": plan.wait.reason.value,
                "since": plan.wait.since_ms,
                "blockers": list(plan.wait.blockers),
                "place": plan.wait.place,
            }
            for plan in known
            if plan.wait is not None
        ],
    }


def bins_of(scene: Scene) -> list[Row]:
    """Give the places for bins in use."""
    return [
        {"binName": bin_.name, "areaId": area.id, "occupied": None, "container": None}
        for area in scene.areas
        if not area.disabled
        for bin_ in area.bins
    ]


def fields_asked(names: Collection[str] | None, default: tuple[str, ...]) -> tuple[str, ...]:
    """Check the names of fields that a client wants; gives them in the order of the reply."""
    if names is None:
        return default
    for name in names:
        if name not in FIELDS:
            words = f"Field 'fields': there is no '{name[:100]}'; there are {', '.join(FIELDS)}."
            raise Refused("errFieldUnknown", words, name[:100])
    return tuple(field for field in FIELDS if field in names)


def encoded(reply: Row) -> bytes:
    """Give the JSON of a reply, parts of which are JSON already."""
    return msgspec.json.encode(reply)
