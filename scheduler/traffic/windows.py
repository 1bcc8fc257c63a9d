"""Routes for all robots for the next seconds, one after the other in the order of their ranks.

Who finds no way through what the others have booked takes one that meets few of them, and these
plan anew: prioritised planning with repair (after Li et al., MAPF-LNS2, AAAI 2022).
"""

from collections import Counter
from collections.abc import Mapping, Sequence

import msgspec

from scheduler.traffic.ahead import Ahead
from scheduler.traffic.bookings import DWELL_S, EVER, Bookings, Route
from scheduler.traffic.sipp import Sipp
from scheduler.traffic.timetable import Timetable
from scheduler.traffic.world import World

WINDOW_S = 30.0
TAKEN_BACK_MAX = 4  # times that one robot's route gives way to that of another


class Window(msgspec.Struct, kw_only=True):
    """What was found for one world; seconds count from then."""

    routes: list[Route]  # by robot, those that stand included
    failed: list[int]  # robots without one

    @property
    def cost_s(self) -> float:
        """Of all robots together."""
        return sum(route.cost_s for route in self.routes)


class Planning:
    """The search for one window."""

    def __init__(self, world: World, ahead: Mapping[str, Ahead], times: Timetable) -> None:
        """Book what stands already: what is committed, and who does not move."""
        self.world, self.ahead = world, [ahead[agent.name] for agent in world.agents]
        self.sipp = Sipp(world, WINDOW_S)
        kinds = [(look.footprint, look.limits) for look in self.ahead]
        self.base = Bookings(world, times, kinds)
        self.free = [k for k, agent in enumerate(world.agents) if not agent.fixed]
        for k, (agent, look) in enumerate(zip(world.agents, self.ahead, strict=True)):
            self.base.hold(k, look.held)
            until_s = look.free_s
            if agent.fixed:
                until_s = look.free_s + DWELL_S if agent.goal == agent.place else EVER
            self.base.stay(k, agent.place, -EVER, until_s)

    def nothing(self) -> Bookings:
        """No bookings at all."""
        return Bookings(self.world, self.base.times, self.base.kinds)

    def standing(self, robot: int) -> Route:
        """The route of a robot that stays where it is."""
        agent = self.world.agents[robot]
        return Route(robot=robot, place=agent.place, steps=(), end=agent.place, cost_s=WINDOW_S)

    def least_s(self) -> float:
        """What all would cost if each were alone."""
        total_s = 0.0
        for k in self.free:
            agent = self.world.agents[k]
            if agent.goal is not None:
                alone_s = agent.costs.cost_s(agent.place, agent.heading_rad, agent.goal)
                total_s += self.ahead[k].free_s + (alone_s if alone_s < EVER else 0.0)
        return total_s

    def in_turn(self, first: Sequence[int], low_w: float, budget: int) -> Window:
        """Plan in turn, `first` before the others; who finds no way has those that it would meet
        plan anew behind itself. `budget` bounds the states looked at.
        """
        front = [k for k in first if k in self.free]
        todo = front + [k for k in self.free if k not in set(front)]
        routes: dict[int, Route] = {}
        taken_back: Counter[int] = Counter()
        failed, booked = list[int](), self.base.copy()
        while todo:
            k = todo.pop(0)
            route = self.sipp.route(k, self.ahead[k].free_s, booked)
            met: set[int] = set()
            if route is None and self.sipp.expanded < budget:
                route = self.sipp.route(k, self.ahead[k].free_s, self.base, low_w, booked)
                if route is not None:
                    met = self.sipp.met(route, booked)
                    taken_back.update(met)
                    if any(taken_back[other] > TAKEN_BACK_MAX for other in met):
                        route, met = None, set()
            if route is None:
                failed.append(k)
                continue
            routes[k] = route
            if met:
                todo = sorted(met & routes.keys(), key=self.free.index) + todo
                routes = {k: kept for k, kept in routes.items() if k not in met}
                booked = self.base.copy()
                for kept in routes.values():
                    booked.book(kept)
            else:
                booked.book(route)
        return Window(routes=[routes[k] for k in sorted(routes)], failed=failed)
