"""What queries see of the present: the fold over all durable events, and what robots report."""

import asyncio
import heapq
from collections import deque
from collections.abc import Mapping, Sequence
from itertools import count
from threading import Lock
from types import MappingProxyType

from ledger.events import (
    AnyEvent,
    OrderCancelled,
    OrderCreated,
    OrderFinished,
    RobotRemoved,
    SceneRemoved,
    SceneRenamed,
)
from ledger.evolve import evolve
from ledger.evolve_order import order_after
from ledger.ids import OrderId, RobotKey, RobotName, SceneId, robot_key
from ledger.link import Plan, Report
from ledger.scene import Value
from ledger.state import Fleet, Order
from projections.devices import DevicesSeen

WAIT_S = 5.0  # for a position, then the caller is told that it did not come
WAITERS_MAX = 10_000
NEWEST_KEPT = 1_000  # ended orders kept for default pages
FINISHED_MAX = 20_000  # ended orders kept for DuckDB: 60 MB, 20 s of 1,000 orders/s
FINISHED_LESS = 1_000  # forgotten at once where there are more
REPORTS_KEPT = 32  # of each robot, so that all can be shown at one instant


class Moment(Value, frozen=True, kw_only=True):
    """One consistent view: these orders, and of DuckDB's the rows up to `history_position`.

    DuckDB may not have got so far yet: whoever opens a cursor names it as what he needs.
    """

    position: int
    at_ms: int
    history_position: int  # every order that ended later is in `orders`
    orders: tuple[Order, ...]  # live, in order of creation if `in_order`
    ended: tuple[Order, ...]  # done or cancelled, and not yet to be found in DuckDB
    newest: tuple[Order, ...]  # newest created of those in DuckDB, the newest first
    newest_are_all: bool  # DuckDB has no other
    in_order: bool  # creation times never fall along `orders`
    scene_names: dict[SceneId, str]
    # of orders that ended under another name of their scene than it has now
    names_at_end: Mapping[OrderId, str] = MappingProxyType({})

    def scene_name(self, order: Order) -> str:
        """Name of the order's scene: of a live one the present, of an ended one that at its end."""
        name = self.names_at_end.get(order.id) if order.terminal else None
        return name or self.scene_names.get(order.scene, "")


class Live:
    """Live orders, robots and scenes, and ended orders until DuckDB has committed them.

    While DuckDB falls behind, or is built anew, only the newest of the ended ones are kept: a
    `Moment` then asks DuckDB for more than it has, and `History.cursor` refuses.
    `apply` runs where queries are answered, before the events are acknowledged: whoever got an
    answer finds what it says. `forget` may come from the projector's thread.
    """

    def __init__(self, fleet: Fleet) -> None:
        """Take the state to begin with; orders that ended in it must be in the history."""
        self.fleet = fleet
        self.finished: dict[OrderId, Order] = {}
        self.reports: dict[RobotKey, Report] = {}
        self.plans: dict[RobotKey, Plan] = {}
        self.recent: dict[RobotKey, deque[Report]] = {}
        self.devices = DevicesSeen()
        self._ended_at: deque[tuple[int, OrderId]] = deque()  # position of the last event, order
        self.history_position = fleet.position  # what ended until then is DuckDB's to know
        self._newest: tuple[Order, ...] = ()
        self._names_at_end: dict[OrderId, str] = {}  # replaced, never changed: moments share it
        self._newest_are_all = True  # of those that ended since the start
        self._seeded = fleet.position == 0  # nothing had ended before
        created = [order.created_ms for order in fleet.orders.values()]
        self._in_order = created == sorted(created)
        self._newest_created_ms = max(created, default=0)
        self._lock = Lock()
        self._waiters: list[tuple[int, int, asyncio.Future[None]]] = []
        self._number = count()

    @property
    def position(self) -> int:
        """Position up to which queries see."""
        return self.fleet.position

    def apply(self, events: Sequence[AnyEvent]) -> None:
        """Take in durable events, in order."""
        with self._lock:
            for event in events:
                if isinstance(event, OrderFinished | OrderCancelled):
                    self._end(event)
                elif isinstance(event, OrderCreated):
                    self._in_order = self._in_order and event.at_ms >= self._newest_created_ms
                    self._newest_created_ms = max(self._newest_created_ms, event.at_ms)
                elif isinstance(event, RobotRemoved | SceneRemoved):
                    self._drop(event)
                elif isinstance(event, SceneRenamed):
                    self._keep_name(event.scene)
                evolve(self.fleet, event)
        while self._waiters and self._waiters[0][0] <= self.fleet.position:
            _, _, waiter = heapq.heappop(self._waiters)
            if not waiter.done():
                waiter.set_result(None)

    def _drop(self, event: RobotRemoved | SceneRemoved) -> None:
        """Forget what robots that have left said: one with the same name may come."""
        gone = (
            [robot_key(event.scene, event.robot)]
            if isinstance(event, RobotRemoved)
            else [key for key, robot in self.fleet.robots.items() if robot.scene == event.scene]
        )
        for key in gone:
            for said in (self.reports, self.plans, self.recent):
                said.pop(key, None)

    def _keep_name(self, scene: SceneId) -> None:
        """The scene gets another name: what ended in it keeps the one that DuckDB has."""
        known = {order.id: order for order in (*self._newest, *self.finished.values())}
        names = {id_: name for id_, name in self._names_at_end.items() if id_ in known}
        before = self.fleet.scenes[scene].name
        for id_, order in known.items():
            if order.scene == scene:
                names.setdefault(id_, before)
        self._names_at_end = names

    def _end(self, event: OrderFinished | OrderCancelled) -> None:
        ended = order_after(self.fleet.orders[event.order], event)
        if event.position <= self.history_position:  # the projector read it before we heard
            self._remember([ended])
            return
        self.finished[ended.id] = ended
        self._ended_at.append((event.position, ended.id))
        if len(self._ended_at) > FINISHED_MAX:
            self._forget(self._ended_at[FINISHED_LESS - 1][0])

    def forget(self, position: int) -> None:
        """Drop ended orders up to a position: DuckDB has them now."""
        with self._lock:
            self._forget(position)

    def _forget(self, position: int) -> None:
        gone = []
        while self._ended_at and self._ended_at[0][0] <= position:
            gone.append(self.finished.pop(self._ended_at.popleft()[1]))
        self._remember(gone)
        self.history_position = max(self.history_position, position)

    def seed(self, newest: Sequence[tuple[Order, str]], *, are_all: bool) -> None:
        """Take the newest created of all orders that had ended when this began, each with the name
        that its scene had.
        """
        with self._lock:
            self._newest_are_all = self._newest_are_all and are_all
            self._remember([order for order, _ in newest])
            scenes = self.fleet.scenes
            odd = {o.id: name for o, name in newest if scenes[o.scene].name != name}
            self._names_at_end = {**odd, **self._names_at_end}
            self._seeded = True

    def _remember(self, orders: Sequence[Order]) -> None:
        """Keep the newest created: every order in DuckDB that is not kept is older than these."""
        if orders:
            known = sorted((*self._newest, *orders), key=lambda o: (-o.created_ms, o.id))
            self._newest_are_all = self._newest_are_all and len(known) <= NEWEST_KEPT
            self._newest = tuple(known[:NEWEST_KEPT])

    def order(self, id_: OrderId) -> Order | None:
        """Give an order that is live or has ended lately."""
        with self._lock:
            return self.fleet.orders.get(id_) or self.finished.get(id_)

    def ended_order(self, id_: OrderId, until: int) -> Order | None:
        """Give an order that ended lately, at this position or before."""
        with self._lock:
            known = any(id_ == ended and at <= until for at, ended in self._ended_at)
            return self.finished.get(id_) if known else None

    def ended_by(self, position: int) -> tuple[Order, ...]:
        """Give the orders that DuckDB may not have yet and that had ended by a position."""
        with self._lock:
            return self._ended(position)

    def _ended(self, position: int) -> tuple[Order, ...]:
        return tuple(self.finished[id_] for at, id_ in self._ended_at if at <= position)

    def now(self) -> Moment:
        """View the present."""
        with self._lock:
            return self._view(self.fleet, tuple(self.finished.values()), self._in_order)

    def past(self, fleet: Fleet) -> Moment:
        """View a past state: it has the live orders, here and DuckDB have those ended by then."""
        with self._lock:
            return self._view(fleet, self._ended(fleet.position), in_order=False)

    def _view(self, fleet: Fleet, ended: tuple[Order, ...], in_order: bool) -> Moment:
        remembered = self._seeded and fleet is self.fleet
        return Moment(
            position=fleet.position,
            at_ms=fleet.at_ms,
            history_position=min(self.history_position, fleet.position),
            orders=tuple(fleet.orders.values()),
            ended=ended,
            newest=self._newest if remembered else (),
            newest_are_all=self._newest_are_all and remembered,
            in_order=in_order,
            scene_names={id_: scene.name for id_, scene in fleet.scenes.items()},
            names_at_end=self._names_at_end,
        )

    async def wait(self, position: int, timeout_s: float = WAIT_S) -> bool:
        """Wait until queries see this position; False if it does not come in time."""
        if self.fleet.position >= position:
            return True
        if len(self._waiters) >= WAITERS_MAX:
            return False
        waiter = asyncio.get_running_loop().create_future()
        entry = (position, next(self._number), waiter)
        heapq.heappush(self._waiters, entry)
        try:
            async with asyncio.timeout(timeout_s):
                await waiter
        except TimeoutError:
            if entry in self._waiters:
                self._waiters.remove(entry)
                heapq.heapify(self._waiters)
        return self.fleet.position >= position

    def last(self) -> list[tuple[Report, Plan]]:
        """Give the newest of each robot, for a new scheduler; called on any thread."""
        reports, plans = self.reports.copy(), self.plans.copy()
        return [(reports[key], plan) for key, plan in plans.items() if key in reports]

    def recall(self, reports: Mapping[RobotName, Report], plans: Mapping[RobotName, Plan]) -> None:
        """Take what a scene's robots said before the start, of those that are still there."""
        for name in reports.keys() & plans.keys():
            if robot_key(reports[name].scene, name) in self.fleet.robots:
                self.observe(reports[name])
                self.intend(plans[name])

    def observe(self, report: Report) -> None:
        """Take in what a robot reports; one that was overtaken on its way is dropped."""
        key = robot_key(report.scene, report.robot)
        known = self.reports.get(key)
        if known is not None and report.at_ms < known.at_ms:
            return
        self.reports[key] = report
        if (recent := self.recent.get(key)) is None:
            recent = self.recent[key] = deque(maxlen=REPORTS_KEPT)
        recent.append(report)

    def intend(self, plan: Plan) -> None:
        """Take in what traffic intends with a robot."""
        self.plans[robot_key(plan.scene, plan.robot)] = plan
