"""Robots on a grid that are late now and then: each moves in its own time, and holds two cells."""

import random
import time

import msgspec

from bench.grid_runs import Fleet, Run
from scheduler.traffic.pibt import propose

TICKS = 8  # per undisturbed move
RELEASED = 2  # ticks until the cell behind is free: a quarter of the move


class _Robot(msgspec.Struct, kw_only=True):
    """Where a robot is, while the fleet's agents say where its committed moves end."""

    here: int
    onto: int | None = None  # the cell that it drives to
    driven: int = 0  # ticks
    frozen_at: int = -1
    frozen: int = 0


class Late:
    """Moves of one unit; with probability `late` one stands still in its midst for a while.

    A move is committed when no other robot's committed moves end there, and begins when the cell
    is free: the order in which product and simulation do it (design notes, traffic, section 4).
    """

    def __init__(self, fleet: Fleet, late: float, mean: float, seed: int) -> None:
        """`mean` delay in units, exponential."""
        self.fleet, self.late, self.mean = fleet, late, mean
        self.chance = random.Random(seed)
        self.robots = [_Robot(here=agent.place) for agent in fleet.agents]
        self.held = {robot.here: k for k, robot in enumerate(self.robots)}

    def run(self, units: int, warm_up: int) -> Run:
        """Tasks and the rest per unit of time."""
        run, fleet = Run(steps=units - warm_up), self.fleet
        for tick in range(units * TICKS):
            now = tick / TICKS
            for robot in self.robots:
                if robot.onto is not None:
                    self._drive(robot)
            for k, robot in enumerate(self.robots):
                if robot.onto is None and robot.here == fleet.agents[k].goal:
                    if now >= warm_up:
                        run.tasks += 1
                        run.waited = max(run.waited, now - fleet.since[k])
                    fleet.next_task(k, now)
            before = time.process_time()
            self._plan()
            run.cpu_s += time.process_time() - before if now >= warm_up else 0.0
            for k, robot in enumerate(self.robots):
                self._begin(k, robot)
        run.waited = max(run.waited, units - min(fleet.since))
        return run

    def _drive(self, robot: _Robot) -> None:
        if robot.driven == robot.frozen_at and robot.frozen:
            robot.frozen -= 1
            return
        robot.driven += 1
        if robot.driven == RELEASED:
            del self.held[robot.here]
        if robot.driven == TICKS:
            assert robot.onto is not None
            robot.here, robot.onto = robot.onto, None

    def _plan(self) -> None:
        fleet, end = self.fleet, self.fleet.grid.moves.end
        for agent, robot in zip(fleet.agents, self.robots, strict=True):
            agent.fixed = robot.driven == robot.frozen_at and robot.frozen > 0
        taken = {agent.place for agent in fleet.agents}
        for name, (move,) in propose(fleet.world()):
            k = fleet.number[name]
            agent, robot = fleet.agents[k], self.robots[k]
            near = robot.onto is None and robot.here == agent.place
            if near and end[move] not in taken:
                taken.discard(agent.place)
                taken.add(end[move])
                agent.place = end[move]

    def _begin(self, k: int, robot: _Robot) -> None:
        place = self.fleet.agents[k].place
        if robot.onto is not None or place == robot.here or place in self.held:
            return
        self.held[place] = k
        robot.onto, robot.driven, robot.frozen, robot.frozen_at = place, 0, 0, -1
        if self.chance.random() < self.late:
            robot.frozen_at = self.chance.randrange(TICKS)
            robot.frozen = round(self.chance.expovariate(1 / self.mean) * TICKS)
