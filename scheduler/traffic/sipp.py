"""One robot's way through what is booked: safe-interval path planning over compiled moves.

A state is a place, a heading, and the interval in which nobody calls for the place (Phillips and
Likhachev, ICRA 2011). The robot leaves as early as the bookings let it, or just after somebody has
called for the place that it goes to. Among ways that cost at most `low_w` times the least it takes
the one with the fewest conflicts with the routes of others (focal search, as in ECBS: Barer et
al., SoCS 2014).
"""

import heapq
from collections.abc import Iterator
from typing import NamedTuple

from scheduler.traffic.bookings import DWELL_S, EVER, Bookings, Route, Step
from scheduler.traffic.costs import INFINITE, Way, places_in
from scheduler.traffic.geometry import turn_rad
from scheduler.traffic.world import World, turning_room

NEXT_S = 0.01  # who comes after somebody departs so much later: the order is that of departures
EXPANDED_MAX = 400  # states of one search; half the searches on a full lattice take under 20
SHIFTS_MAX = 60  # bookings that one departure is put off by
LATER_MAX = 2  # calls after which it is tried once more
IDLE_GOAL_S = 8.0  # an idle robot rather does not stop where somebody wants to go
IDLE_POCKET_S = 15.0  # nor in a dead end


class _Node(NamedTuple):
    cost_s: float  # of the whole way at the least
    conflicts: int
    number: int
    at_s: float
    place: int
    heading_rad: float
    state: int  # of `Costs`; -1 = as it stands now
    called_s: float  # it must have left before
    before: "_Node | None" = None
    step: Step | None = None
    ended: bool = False
    extra_s: float = 0.0  # of its cost: what guidance adds to the time


class Sipp:
    """Searches in one world; `expanded` counts what they have cost."""

    def __init__(self, world: World, window_s: float) -> None:
        """Routes end beyond the window, or at their goals."""
        self.world, self.window_s = world, window_s
        self.wanted = {agent.goal for agent in world.agents}
        self.expanded = 0

    def route(
        self,
        robot: int,
        free_s: float,
        booked: Bookings,
        low_w: float = 1.0,
        others: Bookings | None = None,
    ) -> Route | None:
        """The best way within what is booked; None if there is none, or it takes too long to find.
        `others` are routes that it should rather not meet.
        """
        search = _Search(self, robot, booked, others)
        found = search.run(free_s, low_w)
        self.expanded += search.count
        return found

    def met(self, route: Route, others: Bookings) -> set[int]:
        """Robots whose routes this one meets."""
        robot, kind, found = route.robot, others.kinds[route.robot], set[int]()
        place, since = route.place, -EVER
        for step in route.steps:
            for low, high, other in others.shut[kind].get(step.move, ()):
                if low < step.drive_s < high:
                    found.add(other)
            for need in step.needs:
                for low, high, other in others.stays.get(need, ()):
                    if low <= step.commit_s < high + NEXT_S:
                        found.add(other)
            for at_s, other in others.calls.get(place, ()):
                if since < at_s < step.commit_s + NEXT_S:
                    found.add(other)
            place, since = self.world.roadmap.moves.end[step.move], step.commit_s
        found.update(o for at, o in others.calls.get(place, ()) if since < at < route.until_s)
        return found - {robot}


class _Search:
    def __init__(self, sipp: Sipp, robot: int, booked: Bookings, others: Bookings | None) -> None:
        self.sipp, self.world = sipp, sipp.world
        self.robot, self.agent = robot, sipp.world.agents[robot]
        self.booked, self.others = booked, others
        self.shut = booked.shut[booked.kinds[robot]]
        self.lasts_s = booked.times.lasts_s(booked.kinds[robot])
        self.count, self.number = 0, 0
        costs, goal, here = self.agent.costs, self.agent.goal, self.agent.place
        if goal is not None and costs.cost_s(here, self.agent.heading_rad, goal) == INFINITE:
            goal = None  # it makes way, as one without a goal does
        self.goal = goal

    def run(self, free_s: float, low_w: float) -> Route | None:
        agent, onward = self.agent, 0.0
        if self.goal is not None:
            onward = agent.costs.cost_s(agent.place, agent.heading_rad, self.goal)
        begin = free_s if self.goal is not None else 0.0
        called = self._called_s(agent.place, -EVER)
        root = _Node(begin + onward, 0, 0, free_s, agent.place, agent.heading_rad, -1, called)
        every, focal, rest = [root], [(0, root)], list[_Node]()
        bound, best, done = root.cost_s * low_w, dict[tuple[int, int, float], float](), set[int]()
        while every:
            while every and every[0].number in done:
                heapq.heappop(every)
            if not every:
                return None
            bound = max(bound, every[0].cost_s * low_w)
            while rest and rest[0].cost_s <= bound:
                node = heapq.heappop(rest)
                heapq.heappush(focal, (node.conflicts, node))
            _, node = heapq.heappop(focal)
            done.add(node.number)
            if node.ended:
                return self._route(node, every[0].cost_s if every else node.cost_s)
            key = node.place, node.state, node.called_s
            if best.get(key, EVER) <= node.at_s and not node.conflicts:
                continue
            best[key] = min(node.at_s, best.get(key, EVER))
            self.count += 1
            if self.count > EXPANDED_MAX:
                return None
            for after in self._after(node):
                heapq.heappush(every, after)
                if after.cost_s <= bound:
                    heapq.heappush(focal, (after.conflicts, after))
                else:
                    heapq.heappush(rest, after)
        return None

    def _after(self, node: _Node) -> Iterator[_Node]:
        end_s = self._end_s(node)
        if end_s is not None:
            self.number += 1
            yield node._replace(cost_s=end_s, number=self.number, ended=True)
        heading_end, state = self.world.roadmap.heading_end, self.agent.costs.state
        for value, seconds, move, end, needs in self._ways(node.place, node.heading_rad):
            at_s, later = node.at_s, 0
            turn_s = seconds - self.lasts_s[move]
            extra_s = node.extra_s + self.agent.costs.move_s[move] - self.lasts_s[move]
            while later <= LATER_MAX:
                commit_s = self._departure_s(move, turn_s, needs, at_s, node.called_s)
                if commit_s is None:
                    break
                called, arrive = self._called_s(end, commit_s), commit_s + seconds
                later += 1
                if arrive < called:
                    step = Step(
                        move=move,
                        needs=needs,
                        commit_s=commit_s,
                        drive_s=commit_s + turn_s,
                        arrive_s=arrive,
                    )
                    begin = node.cost_s if self.goal is None else commit_s + node.extra_s
                    self.number += 1
                    yield _Node(
                        begin + value,
                        node.conflicts + (self._conflicts(step, end) if self.others else 0),
                        self.number,
                        arrive,
                        end,
                        heading_end[move],
                        state[move],
                        called,
                        node,
                        step,
                        extra_s=extra_s,
                    )
                at_s = called + NEXT_S

    def _ways(
        self, place: int, heading: float
    ) -> Iterator[tuple[float, float, int, int, tuple[int, ...]]]:
        """Cost with what follows, seconds, move, end, and the places that must be empty."""
        world, costs = self.world, self.agent.costs
        if self.goal is not None:
            ways: list[Way] = costs.candidates(place, heading, self.goal)
            found = [
                (value, costs.departure_s(place, heading, move) + self.lasts_s[move], move, end, n)
                for value, move, end, n in ways
            ]
        else:
            stops = world.roadmap.places.stops
            found = [
                (s, s - costs.move_s[move] + self.lasts_s[move], move, end, needs)
                for s, move, end, _, needs in costs.departures(place, heading)
                if end < stops and not costs.trap[move]
            ]
        plain = not (world.closed_moves or world.closed_turns or world.closed_places)
        if plain and not (world.more_need or world.more_turning):
            return iter(found)
        return self._as_it_stands(place, heading, found)

    def _as_it_stands(
        self,
        place: int,
        heading: float,
        ways: list[tuple[float, float, int, int, tuple[int, ...]]],
    ) -> Iterator[tuple[float, float, int, int, tuple[int, ...]]]:
        """Without what is closed just now, and with what else must be empty."""
        world, roadmap = self.world, self.world.roadmap
        for value, seconds, move, end, needs in ways:
            turns = turn_rad(heading, roadmap.heading_start[move])
            if move in world.closed_moves:
                continue
            if turns and roadmap.places.point[place] in world.closed_turns:
                continue
            bits = world.more_need.get(move, 0)
            bits |= turning_room(world, place) if turns else 0
            final = end == self.goal and roadmap.final_turn_rad(end, roadmap.heading_end[move])
            bits |= turning_room(world, end) if final else 0
            wanted = {*needs, *places_in(bits & ~(1 << place))}
            if not any(world.closed_places >> need & 1 for need in wanted):
                yield value, seconds, move, end, tuple(sorted(wanted))

    def _departure_s(
        self, move: int, turn_s: float, needs: tuple[int, ...], at_s: float, called_s: float
    ) -> float | None:
        """The first moment from `at_s` on at which nothing booked is in the way."""
        robot, stays, shut = self.robot, self.booked.stays, self.shut.get(move, ())
        for _ in range(SHIFTS_MAX):
            before, drive_s = at_s, at_s + turn_s
            for low, high, other in shut:
                if low < drive_s < high and other != robot:
                    drive_s = high
            at_s = drive_s - turn_s
            for need in needs:
                for low, high, other in stays.get(need, ()):
                    if low <= at_s < high + NEXT_S and other != robot:
                        at_s = high + NEXT_S
            if self.booked.inside:
                at_s = self.booked.token_s(robot, move, at_s)
            if at_s > called_s - NEXT_S or at_s == EVER:
                return None
            if at_s == before:
                return at_s
        return None

    def _called_s(self, place: int, after_s: float) -> float:
        robot = self.robot
        calls = self.booked.calls.get(place, ())
        return min((at for at, other in calls if at > after_s and other != robot), default=EVER)

    def _end_s(self, node: _Node) -> float | None:
        """The cost if the robot stays where it is; None if it may not."""
        if self.goal is None:
            if node.called_s < EVER:
                return None
            cost = node.cost_s
            if node.step is not None:
                cost += IDLE_GOAL_S if node.place in self.sipp.wanted else 0.0
                pocket = self.world.roadmap.pockets.pocket
                deeper = pocket[node.place] not in (-1, pocket[self.agent.place])
                cost += IDLE_POCKET_S if deeper else 0.0
            return cost
        onward_s = node.cost_s - node.extra_s - node.at_s
        if node.place == self.goal:
            left_s = node.at_s + onward_s + DWELL_S
            return node.cost_s if node.called_s >= left_s else None
        if node.called_s < EVER or node.place >= self.world.roadmap.places.stops:
            return None
        return max(node.at_s, self.sipp.window_s) + node.extra_s + onward_s

    def _conflicts(self, step: Step, end: int) -> int:
        assert self.others is not None
        robot, found, kind = self.robot, 0, self.booked.kinds[self.robot]
        for low, high, other in self.others.shut[kind].get(step.move, ()):
            found += low < step.drive_s < high and other != robot
        for need in step.needs:
            for low, high, other in self.others.stays.get(need, ()):
                found += low <= step.commit_s < high and other != robot
        for at, other in self.others.calls.get(end, ()):
            found += step.commit_s < at < step.arrive_s and other != robot
        return found

    def _route(self, node: _Node, least_s: float) -> Route:
        steps: list[Step] = []
        end, until, back = node.place, EVER, node
        if self.goal is not None and end == self.goal:
            until = node.cost_s - node.extra_s + DWELL_S
        while back.before is not None:
            assert back.step is not None
            steps.append(back.step)
            back = back.before
        return Route(
            robot=self.robot,
            place=self.agent.place,
            steps=tuple(reversed(steps)),
            end=end,
            until_s=until,
            cost_s=node.cost_s,
            least_s=min(least_s, node.cost_s),
        )
