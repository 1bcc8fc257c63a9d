"""Ground in time: what the routes that are planned already leave to the others.

The rules are those of the execution layer, so that a plan taken in the order of its departures can
be committed: a move departs only while nobody else is at a place that it needs. On top of that come
the times at which moves are over the same ground.
"""

from collections.abc import Sequence
from typing import TypeAlias

import msgspec

from scheduler.traffic.pockets import DEEPER_M
from scheduler.traffic.timetable import Kind, Timetable
from scheduler.traffic.world import World

EVER = float("inf")
# Nobody knows when work at a goal ends: for so long others plan around it. (With 12 s aisles where
# work takes 10 s did 615 orders an hour instead of 360, and the full lattice lost a sixth.)
DWELL_S = 5.0
Interval: TypeAlias = tuple[float, float, int]  # from, to, whose


class Step(msgspec.Struct, frozen=True, kw_only=True):
    """One move of a route; seconds from now."""

    move: int
    needs: tuple[int, ...]  # places that must be empty when it is committed
    commit_s: float  # its turn in place begins
    drive_s: float
    arrive_s: float


class Route(msgspec.Struct, frozen=True, kw_only=True):
    """What one robot does within the window: it stands at `place` and then drives `steps`."""

    robot: int  # as in `World.agents`
    place: int
    steps: tuple[Step, ...]
    end: int  # place where it stands afterwards
    until_s: float = EVER  # and for how long, as far as is known
    cost_s: float = 0.0  # until it is at its goal
    least_s: float = 0.0  # which no route could do under the same rules


class Bookings:
    """The routes so far. `shut` and `calls` bind who comes after, and so does `stays`."""

    def __init__(self, world: World, times: Timetable, kinds: Sequence[Kind]) -> None:
        """`kinds` of the agents, in their order."""
        self.world, self.times, self.kinds = world, times, kinds
        self.all_kinds = sorted(set(kinds), key=repr)
        # kind -> move -> departures that are taken
        self.shut: dict[Kind, dict[int, list[Interval]]] = {kind: {} for kind in self.all_kinds}
        self.stays: dict[int, list[Interval]] = {}  # place -> when somebody is there
        self.calls: dict[int, list[tuple[float, int]]] = {}  # place -> when it must be empty
        self.inside: dict[int, list[tuple[float, float, int, float]]] = {}  # pocket -> and goal's m

    def copy(self) -> "Bookings":
        """The same, to be added to."""
        found = Bookings(self.world, self.times, self.kinds)
        for kind, shut in self.shut.items():
            found.shut[kind] = {move: list(taken) for move, taken in shut.items()}
        found.stays = {place: list(stays) for place, stays in self.stays.items()}
        found.calls = {place: list(calls) for place, calls in self.calls.items()}
        found.inside = {pocket: list(inside) for pocket, inside in self.inside.items()}
        return found

    def hold(self, robot: int, held: Sequence[tuple[int, float]]) -> None:
        """Ground of what is committed already; shapes that are no cells close moves elsewhere."""
        cells = self.world.roadmap.cells.count
        for kind in self.all_kinds:
            shut = self.shut[kind]
            for cell, until_s in (item for item in held if item[0] < cells):
                for move, after_s in self.times.over(cell, kind):
                    shut.setdefault(move, []).append((-EVER, until_s + after_s, robot))

    def stay(self, robot: int, place: int, from_s: float, to_s: float) -> None:
        """Somebody is at a place, or will be as soon as it gets there."""
        self.stays.setdefault(place, []).append((from_s, to_s, robot))
        pockets, goal = self.world.roadmap.pockets, self.world.agents[robot].goal
        pocket = pockets.pocket[place]
        if pocket >= 0:
            goal = place if goal is None else goal
            deep = pockets.depth_m[goal] if pockets.pocket[goal] == pocket else -EVER
            self.inside.setdefault(pocket, []).append((from_s, to_s, robot, deep))

    def book(self, route: Route) -> None:
        """Take a route in."""
        robot, kind = route.robot, self.kinds[route.robot]
        place, since = route.place, -EVER
        ends = self.world.roadmap.moves.end
        for step in route.steps:
            self.stay(robot, place, since, step.commit_s)
            place, since = ends[step.move], step.commit_s
            for need in step.needs:
                self.calls.setdefault(need, []).append((step.commit_s, robot))
            for other in self.all_kinds:
                shut, at = self.shut[other], step.drive_s
                for move, low, high in self.times.clashes(kind, step.move, other):
                    shut.setdefault(move, []).append((at + low, at + high, robot))
        self.stay(robot, place, since, route.until_s)

    def token_s(self, robot: int, move: int, at_s: float) -> float:
        """When the robot may enter the dead end that this move leads into, at the earliest."""
        pockets, agent = self.world.roadmap.pockets, self.world.agents[robot]
        moves = self.world.roadmap.moves
        pocket = pockets.pocket[moves.end[move]]
        if pocket < 0 or pocket == pockets.pocket[moves.start[move]]:
            return at_s
        goal = agent.goal
        own = goal is not None and pockets.pocket[goal] == pocket
        least = pockets.depth_m[goal] + DEEPER_M if own and goal is not None else EVER
        again = True
        while again:
            again = False
            for from_s, to_s, other, deep in self.inside.get(pocket, ()):
                if other != robot and deep <= least and from_s <= at_s < to_s:
                    at_s, again = to_s, to_s < EVER
        return at_s
