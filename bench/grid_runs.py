"""Robots on a grid: endless tasks, in lockstep or each in its own time."""

import random
import time
from collections import Counter

import msgspec

from bench.grid_floor import STEP_S, Grid
from scheduler.traffic.costs import Costs
from scheduler.traffic.pibt import propose
from scheduler.traffic.world import Agent, World

QUEUE_STEPS = 8.0  # each robot on its way to a station counts like this much more way to it


class Run(msgspec.Struct, kw_only=True):
    """What came out of one run, after its warm-up."""

    tasks: int = 0
    steps: float = 0.0
    cpu_s: float = 0.0  # planning, ranks and rows of costs included
    waited: float = 0.0  # the longest that any robot was on one task, in steps

    @property
    def per_step(self) -> float:
        """Tasks done per step."""
        return self.tasks / self.steps


class Fleet:
    """Robots with endless tasks; who has had its task longest comes first."""

    def __init__(self, grid: Grid, costs: Costs, robots: int, seed: int) -> None:
        """Put robots at home, or anywhere if there are more of them."""
        self.grid, self.costs = grid, costs
        self.chance = random.Random(seed)
        homes = list(grid.floor.homes)
        if robots > len(homes):
            homes = list(grid.floor.cells)
        self.goals = [[grid.cell[xy] for xy in kind] for kind in grid.floor.goals]
        self.bound: Counter[int] = Counter()
        self.kind = [0] * robots
        self.agents = [
            Agent(name=f"R{k:04}", place=grid.cell[xy], heading_rad=0.0, costs=costs)
            for k, xy in enumerate(self.chance.sample(homes, robots))
        ]
        self.number = {agent.name: k for k, agent in enumerate(self.agents)}
        self.since = [0.0] * robots
        for k in range(robots):
            self.next_task(k, 0.0)

    def next_task(self, k: int, now: float) -> None:
        """Another goal than where it is."""
        agent, kind = self.agents[k], self.kind[k]
        if agent.goal is not None:
            self.bound[agent.goal] -= 1
        if self.grid.floor.nearest and kind == 0:
            goal = min(self.goals[0], key=lambda place: (self.effort(agent, place), place))
        else:
            goal = self.chance.choice(self.goals[kind])
            while goal == agent.place:
                goal = self.chance.choice(self.goals[kind])
        self.bound[goal] += 1
        agent.goal, self.since[k] = goal, now
        self.kind[k] = (kind + 1) % len(self.goals)

    def effort(self, agent: Agent, place: int) -> float:
        """Way to a station, and who else is bound for it."""
        way_s = self.costs.cost_s(agent.place, agent.heading_rad, place)
        return way_s / STEP_S + QUEUE_STEPS * self.bound[place]

    def arrived(self, k: int) -> bool:
        """Is it where its task is."""
        return self.agents[k].place == self.agents[k].goal

    def world(self) -> World:
        """All robots in the order of their ranks."""
        since, agents = self.since, self.agents
        order = sorted(range(len(agents)), key=since.__getitem__)
        return World(roadmap=self.grid, agents=[agents[k] for k in order])


def in_lockstep(fleet: Fleet, steps: int, warm_up: int) -> Run:
    """Everybody moves once a step, none late: the model of the planning literature."""
    run, end = Run(steps=steps - warm_up), fleet.grid.moves.end
    for step in range(steps):
        before = time.process_time()
        proposed = propose(fleet.world())
        spent = time.process_time() - before
        taken = {agent.place for agent in fleet.agents}
        for name, moves in proposed:
            agent = fleet.agents[fleet.number[name]]
            (move,) = moves
            assert end[move] not in taken, "the moves of a step must have a serial order"
            taken.discard(agent.place)
            taken.add(end[move])
            agent.place = end[move]
            agent.heading_rad = fleet.grid.heading_end[move]
        for k in range(len(fleet.agents)):
            if fleet.arrived(k):
                if step >= warm_up:
                    run.tasks += 1
                    run.waited = max(run.waited, step - fleet.since[k])
                fleet.next_task(k, step + 1.0)
        if step >= warm_up:
            run.cpu_s += spent
    run.waited = max(run.waited, steps - min(fleet.since))
    return run
