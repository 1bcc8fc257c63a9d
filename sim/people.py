"""People at a simulated robot: they push it aside, or drive it by hand across the floor.

They look where they go: nothing is moved to where another robot is or may still drive to, for what
keeps such a vehicle off others is the people themselves. Where a robot was moved it has forgotten
its route, begins a session of its own, and says truly where it is.
"""

import random
from collections.abc import Iterable
from math import atan2, cos, hypot, inf, pi, sin

from ledger.link import DISPATCHER, Mark
from ledger.scene import XY, Point
from sim.curves import wrapped
from sim.faults import JUMP_M_MAX
from sim.placement import Ground, taken
from sim.robot import SimRobot, has_way, place

BY_HAND = "person"  # holds control meanwhile
SPEED_MPS = 0.3
# Who backs off from one robot comes no nearer to others within so much more: one that stands may
# just now be told to drive on towards it, on ground granted before (found: two touched).
BACK_OFF_ROOM_M = 1.0
ROOM_M = 0.15  # between the discs of two robots: the ground granted is wider than the bodies
NEAR_M = 8.0  # so far ahead is driven at a time
TRIES_MAX = 8
# Who finds no way to put a robot back for so long carries it to a point that is free: in a crowd
# that waits for this very robot there is none near, for ever (found: 20 robots stood for 90 min).
CARRY_S = 60.0
CARRY_TRIES_MAX = 100  # points, the nearest first …
CARRY_AGAIN_S = 10.0  # … each time


def forget(robot: SimRobot, session: str) -> None:
    """Stand where it is without a route, as after its software has begun anew."""
    robot.x, robot.y, robot.heading, _ = place(robot)
    robot.point = None
    robot.past.append(robot.session)
    robot.session = session
    robot.legs.clear()
    robot.along = robot.speed = 0.0
    robot.done = robot.authority = Mark()
    robot.commit = 0
    robot.changed = robot.awake = True


def can_be_moved(robot: SimRobot) -> bool:
    """Does it stand, and do nothing that it would have to break off."""
    working = robot.actions.running and not robot.actions.charging
    return robot.speed == 0.0 and not working


def too_near(
    robot: SimRobot, x_m: float, y_m: float, others: Iterable[SimRobot], room_m: float = ROOM_M
) -> list[tuple[float, float, float]]:
    """Where others are, or may still drive to, too near for a robot that stands or turns there;
    each behind its distance.
    """
    found = []
    for other in others:
        if other is robot or other.body.area != robot.body.area:
            continue
        if other.body.scene != robot.body.scene:
            continue
        reach_m = robot.body.radius_m + other.body.radius_m + room_m
        for x, y in taken(other, (x_m, y_m), reach_m):
            off_m = hypot(x - x_m, y - y_m)
            if off_m < reach_m:
                found.append((off_m, x, y))
    return found


def push(
    robot: SimRobot, rng: random.Random, session: str, others: Iterable[SimRobot]
) -> tuple[float, float, float] | None:
    """Push a standing robot aside and give where it is then; None = there is no room, or it is
    about to drive on.
    """
    x, y, heading, _ = place(robot)
    way_m, angle = rng.uniform(0.1, JUMP_M_MAX), rng.uniform(-pi, pi)
    turn = rng.uniform(-0.3, 0.3)
    at = x + way_m * cos(angle), y + way_m * sin(angle)
    if not can_be_moved(robot) or has_way(robot) or too_near(robot, *at, others):
        return None
    if robot.actions.charging:
        robot.actions.stop_charging()
    if robot.legs:
        forget(robot, session)
    robot.point = None
    robot.x, robot.y, robot.heading = *at, wrapped(heading + turn)
    robot.changed = robot.awake = True
    return robot.x, robot.y, robot.heading


class Hand:
    """One robot being driven by hand."""

    def __init__(self, robot: SimRobot, session: str) -> None:
        """Take it over where it stands."""
        if robot.actions.charging:
            robot.actions.stop_charging()
        forget(robot, session)
        robot.controller = BY_HAND
        self.robot = robot
        self.target: XY | None = None
        self.carry_in_s = CARRY_S

    def step(
        self,
        dt_s: float,
        rng: random.Random,
        ground: Ground,
        others: Iterable[SimRobot],
        *,
        home: bool,
    ) -> bool:
        """Drive for a while, straight across the floor from point to point; `home` = to a point to
        stay on. Tells whether it has been put there and let go.
        """
        robot, seen = self.robot, list(others)
        robot.changed, robot.hand_mps = True, 0.0
        self.carry_in_s -= dt_s if home else 0.0
        if self.carry_in_s <= 0.0:
            self.carry_in_s = CARRY_AGAIN_S
            carried = _target(robot, rng, ground, seen, home=True, carried=True)
            return carried is not None and self._let_go(ground, carried)
        if self.target is None:
            self.target = _target(robot, rng, ground, seen, home=home)
            if self.target is None:
                self._back_off(dt_s, seen)
                return False
        x, y = self.target
        left_m = hypot(x - robot.x, y - robot.y)
        way_m = min(SPEED_MPS * dt_s, left_m)
        if left_m > 0.0:
            heading = atan2(y - robot.y, x - robot.x)
            at = robot.x + way_m * cos(heading), robot.y + way_m * sin(heading)
            if too_near(robot, *at, seen):
                self.target = None  # perhaps go elsewhere
                self._back_off(dt_s, seen)
                return False
            robot.x, robot.y, robot.heading = *at, heading
            robot.hand_mps = way_m / dt_s
        if left_m > way_m:
            return False
        self.target, robot.hand_mps = None, 0.0
        return home and self._let_go(ground, (x, y))

    def _let_go(self, ground: Ground, at: XY) -> bool:
        robot = self.robot
        robot.x, robot.y = at
        robot.point = next((p.name for p in ground.area.points if (p.x_m, p.y_m) == at), None)
        robot.controller = DISPATCHER
        return robot.point is not None

    def _back_off(self, dt_s: float, others: list[SimRobot]) -> None:
        """Who stands too near to others is pushed straight away from them, without turning: two
        that are both driven by hand would else wait for each other for ever.
        """
        robot = self.robot
        near = too_near(robot, robot.x, robot.y, others)
        if not near:
            return
        off_m, x, y = min(near)
        if off_m <= 0.0:
            return
        away = (robot.x - x) / off_m, (robot.y - y) / off_m
        wide = too_near(robot, robot.x, robot.y, others, BACK_OFF_ROOM_M)
        if all(away[0] * (robot.x - x) + away[1] * (robot.y - y) >= 0.0 for _, x, y in wide):
            robot.x += away[0] * SPEED_MPS * dt_s
            robot.y += away[1] * SPEED_MPS * dt_s
            robot.hand_mps = SPEED_MPS


def _target(
    robot: SimRobot,
    rng: random.Random,
    ground: Ground,
    others: list[SimRobot],
    *,
    home: bool,
    carried: bool = False,
) -> XY | None:
    def away_m(point: Point) -> float:
        return hypot(point.x_m - robot.x, point.y_m - robot.y)

    reach_m, tries = (inf, CARRY_TRIES_MAX) if carried else (NEAR_M, TRIES_MAX)
    near = [point for point in ground.area.points if away_m(point) <= reach_m]
    near.sort(key=lambda point: (away_m(point), point.name))
    tried = near[:tries] if home else rng.sample(near, min(tries, len(near)))
    if not near and ground.area.points:
        tried = [min(ground.area.points, key=lambda point: (away_m(point), point.name))]
    for point in tried:
        if not too_near(robot, point.x_m, point.y_m, others):
            return point.x_m, point.y_m
    return None
