"""A grid that looks like a compiled map to the planner, and robots that move on it in steps."""

import math

from bench.grid_maps import XY, Floor
from ledger.scene import Kinematics
from scheduler.traffic.moves import Moves
from scheduler.traffic.pockets import Pockets
from scheduler.traffic.roadmap import Roadmap
from scheduler.traffic.stops import Places

STEP_S = 3.0  # a cell of 2 m with some slack: what the planner's prices in seconds are meant for


class Grid(Roadmap):
    """Every cell is a stop and every way to the next one a move that needs only its end empty."""

    def __init__(self, floor: Floor, turn_steps: float = 0.0) -> None:
        """`turn_steps`: what a quarter turn costs; 0 = robots drive sideways."""
        self.floor = floor
        self.turn_steps = turn_steps
        self.cell = {xy: k for k, xy in enumerate(floor.cells)}
        count = len(floor.cells)
        start = [self.cell[a] for a, _ in floor.ways]
        end = [self.cell[b] for _, b in floor.ways]
        self.moves = Moves(
            start=start,
            end=end,
            paths=[(k,) for k in range(len(end))],
            need=[1 << place for place in end],
        )
        self.longest_m = 1.0
        self.places = Places(
            point=list(range(count)),
            stops=count,
            conflict=[0] * count,
            resting={},
            turning=[0] * count,
        )
        self.pockets = Pockets(pocket=[-1] * count, depth_m=[0.0] * count)
        self.heading_start = [self._heading(a, b) for a, b in floor.ways]
        self.heading_end = self.heading_start
        self.turning = [True] * count
        self.leaving = [[] for _ in range(count)]
        for move, place in enumerate(start):
            self.leaving[place].append(move)

    def _heading(self, a: XY, b: XY) -> float:
        if not self.turn_steps:
            return 0.0
        return math.atan2(b[1] - a[1], b[0] - a[0])

    def turn_cost_s(self, angle_rad: float, limits: Kinematics) -> float:
        """Whole steps."""
        return STEP_S * self.turn_steps * round(angle_rad / (math.pi / 2))

    def move_s(self, move: int, limits: Kinematics) -> float:
        """One step."""
        return STEP_S

    def final_turn_rad(self, place: int, heading_rad: float) -> float:
        """No goal demands a heading."""
        return 0.0
