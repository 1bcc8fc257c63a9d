"""Conflict-based search over one window: routes that meet are told apart, one meeting at a time.

Bounded suboptimal as ECBS is (Barer et al., SoCS 2014): of the nodes that cost at most `high_w`
times the least possible, that with the fewest meetings is looked at first. It begins with what
planning in turn has found, so that few meetings are left: those of the robots that found no way.
"""

import heapq
from collections.abc import Iterable, Sequence
from typing import NamedTuple, TypeAlias

import msgspec

from scheduler.traffic.bookings import EVER, Bookings, Route, Step
from scheduler.traffic.windows import Planning, Window

NODE_STATES = 60  # what counting meetings costs, in states of a search for one route (measured)
NODES_MAX = 2_000

# For a robot: (move, from, to) it may not depart, (place, from, to) it may not need empty, or
# (place, at) it may not be at.
Bar: TypeAlias = tuple[str, int, float, float]


class Meeting(NamedTuple):
    """Two robots that cannot both have their way, and what one of the two must be barred from."""

    at_s: float
    first: int
    first_bar: Bar
    second: int
    second_bar: Bar


class _Node(msgspec.Struct, kw_only=True):
    routes: dict[int, Route]
    bars: dict[int, tuple[Bar, ...]]
    meetings: int
    earliest: Meeting | None

    @property
    def cost_s(self) -> float:
        return sum(route.cost_s for route in self.routes.values())


class Search:
    """One search; its work is counted in the states of `Planning.sipp`."""

    def __init__(self, planning: Planning, high_w: float, low_w: float) -> None:
        """`high_w`, `low_w`: how much dearer than the least a plan and a route may be."""
        self.planning, self.high_w, self.low_w = planning, high_w, low_w

    def improve(self, window: Window, budget: int) -> Window:
        """Find a plan within the bound, beginning with this one; gives it back where it is within
        it, or there is no better one within the budget.
        """
        least_s = self.planning.least_s()
        if not window.failed and window.cost_s <= self.high_w * least_s:
            return window
        best_s = EVER if window.failed else window.cost_s
        root = self._root(window)
        dear, number = root.cost_s > self.high_w * least_s, 0
        heap = [(dear, root.meetings, root.cost_s, number, root)]
        while heap and self.planning.sipp.expanded < budget and number < NODES_MAX:
            *_, node = heapq.heappop(heap)
            if node.earliest is None:
                if node.cost_s < best_s:
                    routes = [route for _, route in sorted(node.routes.items())]
                    return Window(routes=routes, failed=[])
                continue
            meeting = node.earliest
            for robot, bar in (
                (meeting.first, meeting.first_bar),
                (meeting.second, meeting.second_bar),
            ):
                after = self._barred(node, robot, bar)
                if after is not None and after.cost_s < best_s:
                    number += 1
                    dear = after.cost_s > self.high_w * least_s
                    heapq.heappush(heap, (dear, after.meetings, after.cost_s, number, after))
        return window

    def _root(self, window: Window) -> _Node:
        routes = {route.robot: route for route in window.routes}
        booked = self._booked(routes.values())
        for k in window.failed:
            routes[k] = self._route(k, (), booked) or self.planning.standing(k)
            booked.book(routes[k])
        return self._node(routes, {}, booked)

    def _barred(self, node: _Node, robot: int, bar: Bar) -> _Node | None:
        """The node with one route that heeds one bar more."""
        if robot not in node.routes:
            return None
        bars = (*node.bars.get(robot, ()), bar)
        routes = dict(node.routes)
        del routes[robot]
        booked = self._booked(routes.values())
        found = self._route(robot, bars, booked)
        if found is None:
            return None
        routes[robot] = found
        booked.book(found)
        return self._node(routes, {**node.bars, robot: bars}, booked)

    def _route(self, robot: int, bars: Sequence[Bar], others: Bookings) -> Route | None:
        planning = self.planning
        booked = planning.base.copy() if bars else planning.base
        for kind, what, low, high in bars:
            if kind == "depart":
                for shut in booked.shut.values():
                    shut.setdefault(what, []).append((low, high, -1))
            elif kind == "need":
                booked.stays.setdefault(what, []).append((low, high, -1))
            else:
                booked.calls.setdefault(what, []).append((low, -1))
        free_s = planning.ahead[robot].free_s
        return planning.sipp.route(robot, free_s, booked, self.low_w, others)

    def _booked(self, routes: Iterable[Route]) -> Bookings:
        self.planning.sipp.expanded += NODE_STATES
        booked = self.planning.nothing()
        for route in routes:
            booked.book(route)
        return booked

    # -- meetings

    def _node(
        self, routes: dict[int, Route], bars: dict[int, tuple[Bar, ...]], booked: Bookings
    ) -> _Node:
        meetings, earliest = 0, None
        for robot, route in sorted(routes.items()):
            for step in route.steps:
                for meeting in self._meetings(robot, step, routes, booked):
                    meetings += 1
                    if earliest is None or meeting.at_s < earliest.at_s:
                        earliest = meeting
        return _Node(routes=routes, bars=bars, meetings=meetings, earliest=earliest)

    def _meetings(
        self, robot: int, step: Step, routes: dict[int, Route], booked: Bookings
    ) -> list[Meeting]:
        found: list[Meeting] = []
        for need in step.needs:
            for low, high, other in booked.stays.get(need, ()):
                if low <= step.commit_s < high and other != robot:
                    found.append(
                        Meeting(
                            step.commit_s,
                            robot,
                            ("need", need, low, high),
                            other,
                            ("be", need, step.commit_s, step.commit_s),
                        )
                    )
        kinds = booked.kinds
        for low, high, other in booked.shut[kinds[robot]].get(step.move, ()):
            if low < step.drive_s < high and robot < other:
                for theirs in routes[other].steps:
                    clashes = booked.times.clashes(kinds[other], theirs.move, kinds[robot])
                    for move, after, until in clashes:
                        if move == step.move and after < step.drive_s - theirs.drive_s < until:
                            found.append(
                                Meeting(
                                    min(step.drive_s, theirs.drive_s),
                                    robot,
                                    (
                                        "depart",
                                        move,
                                        theirs.drive_s + after,
                                        theirs.drive_s + until,
                                    ),
                                    other,
                                    (
                                        "depart",
                                        theirs.move,
                                        step.drive_s - until,
                                        step.drive_s - after,
                                    ),
                                )
                            )
        return found
