import random
from itertools import pairwise

import msgspec
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shapely import affinity

from ledger.ids import PointName, RobotName
from ledger.link import Load, Mark
from ledger.scene import Group, Point
from ledger.state import BinStatus, Robot, RobotBin
from scheduler.traffic.admission import LOAD_CHANGED
from scheduler.traffic.classes import Classes, carries, corners, outline
from scheduler.traffic.compile import compile_area, digest_of
from tests.scheduler.traffic.floor import SCENE, Floor
from tests.scheduler.traffic.maps import area_of, both, lattice
from tests.scheduler.traffic.test_traffic import GROUPS, R0, R1, floor, send, until
from tests.strategies import robot_config

PALLET = ((0.6, 0.6), (-0.6, 0.6), (-0.6, -0.6), (0.6, -0.6))
PITCHES_M = st.sampled_from((1.4, 2.0))
FORKS = (Group(id=0, name="forks", footprint_loaded=PALLET),)


class Carriers(Floor):
    """Robots that take a load at one goal, once there is room, and put it down at the next."""

    def __init__(self, *args, **given):
        self.loaded: set[RobotName] = set()
        self.growing: set[RobotName] = set()  # wait for room
        self.putting: set[RobotName] = set()
        super().__init__(*args, **given)

    def fresh_traffic(self):
        made = super().fresh_traffic()
        for name in self.loaded | self.growing:
            made.load(name, loaded=True)
        return made

    def _orders(self):
        before = set(self.busy)
        super()._orders()
        for name in sorted(self.busy.keys() - before):
            (self.putting if name in self.loaded else self.growing).add(name)
        for name in sorted(self.growing):
            self.traffic.load(name, loaded=True)
            self.busy[name] = self.now_ms + int(self.service_s * 1000)
            if self.traffic.has_room(name):
                self.growing.discard(name)
                self.loaded.add(name)
        for name in sorted(self.putting - self.busy.keys()):
            self.putting.discard(name)
            self.loaded.discard(name)
            self.traffic.load(name, loaded=False)

    def bodies(self):
        return {
            r.name: affinity.translate(
                affinity.rotate(
                    outline(r.group, loaded=r.name in self.loaded),
                    r.heading,
                    origin=(0, 0),
                    use_radians=True,
                ),
                r.x,
                r.y,
            )
            for r in self.robots.values()
        }


def owned(made, robot):
    spaces = next(p for p in made.traffic.plans(made.now_ms) if p.robot == robot).spaces
    return shapely.union_all([shapely.Polygon(space.points) for space in spaces])


def two_lanes(apart_m=1.0):
    """A lane to drive by, and a stub beside it: far enough for empty robots only."""
    lane = [(f"A{k}", 2.0 * k, 0.0) for k in range(5)]
    stub = [("B0", 4.0, apart_m + 2.0), ("B1", 4.0, apart_m)]
    points = [Point(name=PointName(n), x_m=x, y_m=y) for n, x, y in (*lane, *stub)]
    paths = [p for a, b in pairwise(lane) for p in both(a[0], b[0])]
    return area_of(points, paths + both("B0", "B1"))


def test_a_load_takes_nothing_away_from_the_robot():
    narrow = Group(id=0, name="g", footprint_loaded=((0.2, 0.2), (-0.2, 0.2), (0.0, -0.2)))
    body = shapely.convex_hull(shapely.multipoints(corners(narrow, loaded=True)))
    assert body.covers(shapely.Polygon(narrow.footprint))
    assert outline(narrow, loaded=True).equals(shapely.Polygon(narrow.footprint))
    assert outline(FORKS[0], loaded=True).area == pytest.approx(1.44)


def test_groups_without_a_loaded_footprint_have_one_class():
    classes = Classes(GROUPS)
    assert classes.of(0) == classes.of(0, loaded=True)
    assert len(classes.footprints) == 1
    assert len(Classes(FORKS).footprints) == 3


def test_the_loaded_footprint_is_part_of_what_names_a_roadmap():
    area = lattice(2, 2)
    plain = Group(id=0, name="forks")
    assert digest_of(area, FORKS) != digest_of(area, (plain,))


def test_a_robot_carries_what_the_ledger_or_it_itself_says():
    robot = Robot(scene=SCENE, config=robot_config(0), bins=(RobotBin(),), idle_since_ms=0)
    report = floor(lattice(2, 2), {"R0": ("P0-0", 0.0)}).robots[R0].report(0, 0)
    assert not carries(robot, report)
    reported = msgspec.structs.replace(report, loads=(Load(bin=0, container="c"),))
    assert carries(robot, reported)
    for status in (BinStatus.FILLED, BinStatus.CANCELLED):
        filled = msgspec.structs.replace(robot, bins=(RobotBin(status=status),))
        assert carries(filled, None)
    held = msgspec.structs.replace(robot, bins=(RobotBin(status=BinStatus.RESERVED),))
    assert not carries(held, None)


def test_ground_for_the_load_is_had_before_it_is_taken_and_given_back_after():
    made = floor(lattice(3, 1), {"R0": ("P0-0", 0.0)}, groups=FORKS)
    made.tick()
    empty = owned(made, "R0")
    assert not made.traffic.has_room(R0), "nobody has said that it takes a load"
    made.traffic.load(R0, loaded=True)
    assert not made.traffic.has_room(R0)
    made.tick()
    assert made.traffic.has_room(R0)
    loaded = owned(made, "R0")
    assert loaded.area > empty.area + 0.5
    assert loaded.covers(empty)
    made.traffic.load(R0, loaded=False)
    made.tick()
    assert owned(made, "R0").equals(empty)


def test_a_load_waits_for_a_robot_that_passes_and_says_for_whom():
    made = floor(two_lanes(), {"R0": ("B0", -1.57), "R1": ("A0", 0.0)}, groups=FORKS)
    made.tick()
    send(made, "R1", "A4")
    while made.robots[R1].x < 3.0:
        made.tick()
    made.robots[R1].frozen_s = 40.0
    send(made, "R0", "B1")
    until(made, "R0", "B1", limit_s=30)
    made.traffic.load(R0, loaded=True)
    for _ in range(50):
        made.tick()
        made.judge()
        assert not made.traffic.has_room(R0)
    plan = next(p for p in made.traffic.plans(made.now_ms) if p.robot == R0)
    assert plan.blocked_by == (R1,)
    until(made, "R1", "A4")
    made.tick()
    assert made.traffic.has_room(R0)
    assert owned(made, R0).disjoint(owned(made, R1))


def test_nobody_passes_a_loaded_robot_where_only_an_empty_one_leaves_room():
    made = floor(two_lanes(), {"R0": ("B1", -1.57), "R1": ("A0", 0.0)}, groups=FORKS)
    made.tick()
    made.traffic.load(R0, loaded=True)
    made.busy[R0] = made.now_ms + 10**9
    send(made, "R1", "A4")
    for _ in range(200):
        made.tick()
        assert owned(made, R0).disjoint(owned(made, R1))
    assert made.robots[R1].x < 4.0


def test_what_was_committed_for_an_empty_robot_is_not_driven_on_with_a_load():
    made = floor(lattice(9, 1), {"R0": ("P0-0", 0.0)}, groups=FORKS)
    send(made, "R0", "P8-0")
    while made.robots[R0].x < 3.0:
        made.tick()
    robot = made.robots[R0]
    authority, session = robot.authority, robot.session
    assert authority.along_m == 2.0
    made.traffic.load(R0, loaded=True)
    while made.traffic.trouble(R0) == LOAD_CHANGED:
        made.tick()
        assert robot.authority == authority or robot.session != session
    assert robot.x == pytest.approx(2.0 * authority.piece), "it was placed anew on its way"
    until(made, "R0", "P8-0")
    assert made.traffic.has_room(R0)


def test_a_robot_that_starts_anew_with_a_load_on_its_way_is_placed_where_it_stands():
    made = floor(lattice(9, 1), {"R0": ("P0-0", 0.0)}, groups=FORKS)
    send(made, "R0", "P8-0")
    while made.robots[R0].x < 3.0:
        made.tick()
    made.traffic.load(R0, loaded=True)
    robot = made.robots[R0]
    robot.session, robot.pieces, robot.speed = "anew", {}, 0.0
    robot.progress = robot.authority = Mark()
    for _ in range(20):
        made.tick()
    assert made.traffic.trouble(R0) != LOAD_CHANGED
    until(made, "R0", "P8-0")


def test_a_load_that_comes_off_on_the_way_stops_nobody():
    made = floor(lattice(9, 1), {"R0": ("P0-0", 0.0)}, groups=FORKS)
    made.traffic.load(R0, loaded=True)
    send(made, "R0", "P8-0")
    while made.robots[R0].x < 3.0:
        made.tick()
    session = made.robots[R0].session
    made.traffic.load(R0, loaded=False)
    until(made, "R0", "P8-0")
    made.tick()
    assert made.robots[R0].session == session
    assert owned(made, R0).area < 1.0


@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.integers(0, 10_000), st.sampled_from((1.4, 2.0)), st.lists(st.integers(3, 12), max_size=2)
)
def test_with_loads_that_come_and_go_nobody_overlaps_or_leaves_its_ground(seed, pitch_m, pauses_s):
    chance = random.Random(seed)
    area = lattice(4, 4, pitch_m)
    roadmap = compile_area(area, FORKS)
    stops = [roadmap.net.points[p].name for p in roadmap.places.point[: roadmap.places.stops]]
    count = min(4, len(stops) - 2)
    starts = {
        f"R{k}": (p, chance.uniform(-3, 3)) for k, p in enumerate(chance.sample(stops, count))
    }
    made = Carriers(area, FORKS, starts, list(stops), seed=seed, late=0.1, service_s=1.0)
    for pause_s in pauses_s:
        made.run(pause_s)
        made.restart()
    made.run(40)
    assert sum(made.done.values())


def stage(seed: int) -> None:
    """A soak's turn: six carriers on a lattice, with a new scheduler now and then."""
    chance = random.Random(seed)
    area = lattice(5, 5, chance.choice((1.4, 1.7, 2.0)))
    roadmap = compile_area(area, FORKS)
    stops = [roadmap.net.points[p].name for p in roadmap.places.point[: roadmap.places.stops]]
    chosen = chance.sample(stops, min(6, len(stops) - 2))
    starts = {f"R{k}": (point, chance.uniform(-3, 3)) for k, point in enumerate(chosen)}
    made = Carriers(area, FORKS, starts, stops, seed=seed, late=0.1, service_s=1.0)
    for _ in range(4):
        made.run(chance.uniform(20, 60), report_loss=chance.choice((0.0, 0.1)))
        made.restart()
