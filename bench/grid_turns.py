"""Robots on a grid by the rules of the League of Robot Runners 2023: turning costs a step."""

import math
import time

from bench.grid_runs import Fleet, Run
from scheduler.traffic.pibt import propose

HEADINGS = (0.0, math.pi / 2, math.pi, -math.pi / 2)


def _quarter(heading_rad: float) -> int:
    return round(heading_rad / (math.pi / 2)) % 4


class Turning:
    """A committed move is its turns and then one step ahead, once the cell has been left; robots
    follow each other within a step, but none changes places with another.
    """

    def __init__(self, fleet: Fleet) -> None:
        """All begin facing east."""
        self.fleet = fleet
        self.facing = [_quarter(agent.heading_rad) for agent in fleet.agents]
        self.here = [agent.place for agent in fleet.agents]
        self.onto: list[int | None] = [None] * len(fleet.agents)  # moves
        self.held = set(self.here)

    def run(self, steps: int, warm_up: int) -> Run:
        """Tasks and the rest per step."""
        run, fleet = Run(steps=steps - warm_up), self.fleet
        for step in range(steps):
            before = time.process_time()
            self._plan()
            run.cpu_s += time.process_time() - before if step >= warm_up else 0.0
            self._act()
            for k, onto in enumerate(self.onto):
                if onto is None and fleet.arrived(k):
                    if step >= warm_up:
                        run.tasks += 1
                        run.waited = max(run.waited, step - fleet.since[k])
                    fleet.next_task(k, step + 1.0)
        run.waited = max(run.waited, steps - min(fleet.since))
        return run

    def _plan(self) -> None:
        """Commit what can be; who has to wait may turn already."""
        fleet, grid = self.fleet, self.fleet.grid
        taken = {agent.place for agent in fleet.agents}
        for name, (move,) in propose(fleet.world()):
            k = fleet.number[name]
            agent, end = fleet.agents[k], grid.moves.end[move]
            if self.onto[k] is not None:
                continue
            if end not in taken:
                taken.discard(agent.place)
                taken.add(end)
                agent.place, agent.heading_rad = end, grid.heading_end[move]
                self.onto[k] = move
            else:
                self._turn(k, grid.heading_start[move])
                agent.heading_rad = HEADINGS[self.facing[k]]

    def _turn(self, k: int, heading_rad: float) -> bool:
        """One quarter towards a heading, if it has another."""
        left = (_quarter(heading_rad) - self.facing[k]) % 4
        if left:
            self.facing[k] = (self.facing[k] + (1 if left < 3 else -1)) % 4
        return left > 0

    def _act(self) -> None:
        grid = self.fleet.grid
        ahead = [
            (k, move)
            for k, move in enumerate(self.onto)
            if move is not None and not self._turn(k, grid.heading_start[move])
        ]
        moved = True
        while moved:
            waiting = []
            for k, move in ahead:
                end = grid.moves.end[move]
                if end in self.held:
                    waiting.append((k, move))
                    continue
                self.held.discard(self.here[k])
                self.held.add(end)
                self.here[k], self.onto[k] = end, None
            moved, ahead = len(waiting) < len(ahead), waiting
