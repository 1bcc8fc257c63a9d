"""Phase *assign*: which robot does which order, and for every pair that is not made, why not.

Orders go by class: higher priority first, then those that have waited longer than
dispatch_wait_s_max; or as dispatch_sort says, and then whoever has waited too long comes before
everybody. Each class is matched on what the classes before it have left, so a cheaper way never
overtakes a higher priority; within a class the method (KM or Greedy) decides.
Orders that lead into a full single-lane corridor wait (see crowding).
"""

from collections.abc import Sequence
from itertools import groupby
from typing import TypeAlias

import numpy as np

from ledger.ids import OrderId, RobotName
from ledger.proposals import AnyProposal, AssignOrder, WithdrawOrder
from ledger.scene import Value
from ledger.scene_config import DispatchMethod
from ledger.state import Candidate, Order
from scheduler.dispatch.costs import ORDER_IN_HAND_S, Costs, first_place, in_hand
from scheduler.dispatch.crowding import Crowding
from scheduler.dispatch.eligibility import free_bins, standing_reason, wants
from scheduler.dispatch.matching import FORBIDDEN, Table, match_greedy, match_km
from scheduler.dispatch.reasons import NotAssigned, Why
from scheduler.dispatch.refusals import refusals
from scheduler.dispatch.withdraw import is_withdrawable
from scheduler.places import Place
from scheduler.urgency import Urgency, rank, urgency
from scheduler.view import RobotView, View

ROWS_MAX = 200  # orders in one matching; the rest of the class gets what it leaves
PASS_ROWS_MAX = 2 * ROWS_MAX  # in one pass; the rest has its turn in the next one
CANDIDATES_MAX = 50  # robots named in one assignment, the cheapest first
KEEP = 1e6  # outweighs all real costs of a matching, and is far below FORBIDDEN
REALLOCATED = "Reallocated"

Demand: TypeAlias = tuple[tuple[RobotName, ...], tuple[str, ...]]  # wanted robots, wanted groups


class Slot(Value, frozen=True, kw_only=True):
    """A bin that can get an order; `holder` = the order that has it and could go elsewhere."""

    robot: RobotView
    bin: int
    extra_s: float = 0.0
    holder: Order | None = None


def assign(view: View, so_far: tuple[AnyProposal, ...], now_ms: int) -> list[AnyProposal]:
    """Match what waits with what is free, and give every order left over its reasons."""
    if view.scene.disabled:
        return refusals(view, view.waiting, NotAssigned.SCENE_DISABLED, lambda _: {}, now_ms)
    if view.scene.dispatch_paused:
        return refusals(view, view.waiting, NotAssigned.DISPATCH_PAUSED, lambda _: {}, now_ms)
    if not view.robots:
        return refusals(view, view.waiting, NotAssigned.NO_ROBOT, lambda _: {}, now_ms)
    withdrawn = {p.order for p in so_far if isinstance(p, WithdrawOrder)}
    return _Assignment(view, now_ms, withdrawn).run()


class _Assignment:
    """One pass: the slots that are left, and what is known of every robot."""

    def __init__(self, view: View, now_ms: int, withdrawn: set[OrderId]) -> None:
        self.view = view
        self.now_ms = now_ms
        self.withdrawn = withdrawn
        self.costs = Costs(view)
        self.rank = rank(view.scene.config.dispatch_sort)
        self.urgency = urgency(view.scene.config.dispatch_sort)
        robots = view.robots.values()
        self.standing = {r.name: standing_reason(view, r, now_ms) for r in robots}
        self.slots: list[Slot] = []
        for robot in robots:
            if self.standing[robot.name] is None:
                busy = in_hand(robot)
                self.slots.extend(
                    Slot(robot=robot, bin=b, extra_s=ORDER_IN_HAND_S * (busy + n))
                    for n, b in enumerate(free_bins(robot))
                )
        self.allowed: dict[Demand, frozenset[RobotName]] = {}
        self.reasons: dict[tuple[Demand, str | None, bool], dict[RobotName, str]] = {}
        self.refusing: dict[Demand, tuple[dict[RobotName, str], list[RobotView]]] = {}
        self.assigned: set[OrderId] = set()
        self.crowding = Crowding(view)
        self.crowded: set[OrderId] = set()  # lead into a full corridor
        self.skipped: set[OrderId] = set()  # could be done, but the pass had reached its limit

    def run(self) -> list[AnyProposal]:
        """Match class after class, then explain."""
        proposals: list[AnyProposal] = []
        tried = 0
        if self.slots:
            for _, orders in groupby(self._all_orders(), key=self._class):
                rows = list(orders)
                while rows and self.slots:
                    chunk, rows = self._feasible(rows)
                    if not chunk:
                        break
                    if tried + len(chunk) > PASS_ROWS_MAX:
                        self.skipped.update(o.id for o in chunk + rows)
                        self.crowding.leave(o for o in chunk if o.robot is None)
                        break
                    tried += len(chunk)
                    proposals.extend(self._match(chunk))
        waiting = [o for o in self.view.waiting if o.id not in self.assigned | self.skipped]
        held_up = [o for o in waiting if o.suspended]
        code = NotAssigned.ORDER_SUSPENDED
        proposals.extend(refusals(self.view, held_up, code, lambda _: {}, self.now_ms))
        left = [o for o in waiting if not o.suspended]
        code = NotAssigned.ALL_ROBOTS
        proposals.extend(refusals(self.view, left, code, self._reasons_for, self.now_ms))
        return proposals

    def _class(self, order: Order) -> Urgency:
        config = self.view.scene.config
        in_time = self.now_ms - order.created_ms <= config.dispatch_wait_s_max * 1000
        rank = self.rank(order)
        return (in_time, rank) if config.dispatch_sort else (rank, in_time)

    def _all_orders(self) -> list[Order]:
        orders = [order for order in self.view.waiting if not order.suspended]
        if self.view.reallocate:
            orders.extend(
                order
                for robot in self.view.robots.values()
                for order in robot.orders
                if order.id not in self.withdrawn
                and not order.suspended
                and is_withdrawable(self.view, robot, order)
            )
        return sorted(orders, key=lambda o: (self._class(o), self.urgency(o)))

    def _allowed(self, order: Order) -> frozenset[RobotName]:
        demand = (order.wanted_robots, order.wanted_groups)
        names = self.allowed.get(demand)
        if names is None:
            robots = self.view.robots.values()
            names = frozenset(r.name for r in robots if wants(self.view, order, r))
            self.allowed[demand] = names
        return names

    def _feasible(self, rows: Sequence[Order]) -> tuple[list[Order], list[Order]]:
        """Take the next orders that at least one slot could serve; return the rest too."""
        free = {slot.robot.name for slot in self.slots}
        chunk: list[Order] = []
        for n, order in enumerate(rows):
            if len(chunk) == ROWS_MAX:
                return chunk, list(rows[n:])
            waits = order.robot is None
            if waits and self.crowding.is_full(order):
                self.crowded.add(order.id)
                continue
            place = first_place(self.view, order)
            robots = (self.view.robots[name] for name in self._allowed(order) & free)
            if any(self.costs.cost_s(r, place) < FORBIDDEN for r in robots):
                chunk.append(order)
                if waits:
                    self.crowding.enter(order)
        return chunk, []

    def _match(self, orders: list[Order]) -> list[AnyProposal]:
        held = [self._held_slot(order) for order in orders if order.robot is not None]
        slots = held + self.slots
        costs = np.full((len(orders), len(slots)), FORBIDDEN)
        for row, order in enumerate(orders):
            self._fill(costs[row], order, slots)
        km = self.view.scene.config.dispatch_method is DispatchMethod.KM
        if not km:  # a running order keeps its bin unless it leaves it itself
            waiting_rows = [n for n, order in enumerate(orders) if order.robot is None]
            costs[np.ix_(waiting_rows, range(len(held)))] = FORBIDDEN
        pairs = (match_km if km else match_greedy)(costs)
        moved = [(orders[r], slots[c]) for r, c in pairs if slots[c].holder is not orders[r]]
        used = {id(slot) for _, slot in moved}
        self.slots = [slot for slot in self.slots if id(slot) not in used]
        scene = self.view.scene.id
        back = [o.id for o, _ in moved if o.robot is not None]
        proposals: list[AnyProposal] = [
            WithdrawOrder(scene=scene, order=o, reason=REALLOCATED) for o in back
        ]
        proposals.extend(self._assignment(order, slot) for order, slot in moved)
        self.assigned.update(order.id for order, _ in moved)
        left = (o for o in orders if o.robot is None and o.id not in self.assigned)
        self.crowding.leave(left)
        return proposals

    def _held_slot(self, order: Order) -> Slot:
        assert order.robot is not None and order.bin is not None
        return Slot(robot=self.view.robots[order.robot], bin=order.bin, holder=order)

    def _fill(self, row: Table, order: Order, slots: list[Slot]) -> None:
        """Price one order on every slot: the longest ways are still cheaper than FORBIDDEN."""
        allowed, place = self._allowed(order), first_place(self.view, order)
        for column, slot in enumerate(slots):
            name = slot.robot.name
            cost_s = self.costs.cost_s(slot.robot, place)
            if slot.holder is order:
                stay_s = cost_s - self.view.scene.config.withdrawn_cost_min
                row[column] = min(stay_s, KEEP / 1000) - KEEP
                continue
            if name not in allowed or cost_s >= FORBIDDEN or name == order.robot:
                continue
            if slot.holder is None or self.standing[name] is Why.ROBOT_NO_MORE_BIN:
                row[column] = cost_s + slot.extra_s - (0.0 if order.robot is None else KEEP)

    def _assignment(self, order: Order, slot: Slot) -> AssignOrder:
        place = first_place(self.view, order)
        cheap: list[tuple[float, RobotName]] = []
        others: list[Candidate] = []
        for name, robot in self.view.robots.items():
            if name == slot.robot.name:
                continue
            why = None if name == order.robot else self._reason(robot, order)
            cost_s = float("inf") if why is not None else self.costs.cost_s(robot, place)
            if why is None and cost_s < FORBIDDEN:
                cheap.append((cost_s, name))
            else:
                why = why or self._no_way(robot, place)
                others.append(Candidate(robot=name, reason=why.value))
        candidates = [
            Candidate(robot=name, cost_s=round(cost_s, 3)) for cost_s, name in sorted(cheap)
        ]
        return AssignOrder(
            scene=self.view.scene.id,
            order=order.id,
            robot=slot.robot.name,
            bin=slot.bin,
            cost_s=round(self.costs.cost_s(slot.robot, place), 3),
            candidates=tuple((candidates + others)[:CANDIDATES_MAX]),
        )

    def _reason(self, robot: RobotView, order: Order) -> Why | None:
        if robot.name not in self._allowed(order):
            return Why.ROBOT_NOT_WANTED
        return self.standing[robot.name]

    def _no_way(self, robot: RobotView, place: Place | None) -> Why:
        return Why.GROUND_RESERVED if self.view.reserved(robot, place) else Why.NO_ROUTE

    def _reasons_for(self, order: Order) -> dict[RobotName, str]:
        """Give every robot's reason; one dictionary for all orders that ask for the same."""
        place = first_place(self.view, order)
        demand = (order.wanted_robots, order.wanted_groups)
        crowded = order.id in self.crowded
        key = (demand, None if place is None else place.point.name, crowded)
        reasons = self.reasons.get(key)
        if reasons is None:
            everybody, open_ = self._refusing(order, demand)
            reasons = everybody.copy() if open_ else everybody
            for robot in open_:
                reachable = self.costs.cost_s(robot, place) < FORBIDDEN
                taken = Why.CORRIDOR_FULL if crowded else Why.ROBOT_TAKEN_BY_OTHER
                why = taken if reachable else self._no_way(robot, place)
                reasons[robot.name] = why.value
            self.reasons[key] = reasons
        return reasons

    def _refusing(
        self, order: Order, demand: Demand
    ) -> tuple[dict[RobotName, str], list[RobotView]]:
        """Give the reasons that are the same wherever an order leads, and the robots that have
        none: in their place stands an empty one.
        """
        found = self.refusing.get(demand)
        if found is None:
            why = {name: self._reason(r, order) for name, r in self.view.robots.items()}
            everybody = {name: "" if code is None else code.value for name, code in why.items()}
            found = everybody, [r for name, r in self.view.robots.items() if why[name] is None]
            self.refusing[demand] = found
        return found
