"""The ground of doors, and who may enter it."""

from ledger.ids import PointName
from ledger.scene import Area, Door, Group
from scheduler.goal import Goal
from scheduler.traffic.compile import compile_area
from scheduler.traffic.costs import INFINITE
from scheduler.traffic.doors import DoorNow
from scheduler.traffic.traffic import Traffic
from tests.scheduler.traffic.floor import Floor
from tests.scheduler.traffic.maps import lattice

GROUPS = (Group(id=0, name="g"),)
OPEN, SHUT, BROKEN = DoorNow(enter=True, leave=True), DoorNow(), DoorNow(works=False)


def across(a: str, b: str, id_: int = 1, **fields: object) -> Door:
    keys = (f"{a}->{b}", f"{b}->{a}")
    return Door(id=id_, name=f"D{id_}", area=0, paths=keys, **fields)  # type: ignore[arg-type]


class Hall(Floor):
    """A floor whose doors are as the test says."""

    def __init__(self, area: Area, doors: tuple[Door, ...], *starts: str) -> None:
        self.doors = doors
        self.now = {door.id: SHUT for door in doors}
        at = {f"R{n}": (name, 0.0) for n, name in enumerate(starts)}
        super().__init__(area, GROUPS, at, [], service_s=1.0)
        self.idle.update(self.robots)

    def fresh_traffic(self) -> Traffic:
        traffic = super().fresh_traffic()
        traffic.lay_doors(self.doors)
        traffic.follow_doors(self.now)
        return traffic

    def set(self, now: DoorNow, id_: int = 1) -> None:
        self.now[id_] = now
        self.traffic.follow_doors(self.now)

    def send(self, robot: str, point: str) -> None:
        name = next(n for n in self.robots if n == robot)
        self.goals[name] = Goal(point=PointName(point), rank=(0, 0, name))

    def plan(self, robot: str = "R0"):
        return next(p for p in self.traffic.plans(self.now_ms) if p.robot == robot)


def test_a_robot_stops_before_a_shut_door_wants_it_and_says_so() -> None:
    hall = Hall(lattice(4, 1), (across("P1-0", "P2-0"),), "P0-0")
    hall.send("R0", "P3-0")
    hall.run(15)
    robot = hall.robots[hall.plan().robot]
    assert abs(robot.x - 2.0) < 0.1, "before the lane that the door is across"
    assert hall.traffic.wanted_doors() == {1: ("R0",)}
    assert hall.plan().blocked_by == ("door:D1",)
    hall.set(OPEN)
    hall.run(15)
    assert abs(robot.x - 6.0) < 0.1
    assert hall.traffic.wanted_doors() == {}


def test_a_door_is_wanted_only_by_who_is_near() -> None:
    hall = Hall(lattice(4, 1), (across("P1-0", "P2-0", open_ahead_m=0.5),), "P0-0")
    hall.send("R0", "P3-0")
    near = []
    for _ in range(150):
        hall.tick()
        if hall.traffic.wanted_doors():
            near.append(2.0 - hall.robots[hall.plan().robot].x)
    assert near and max(near) <= 0.5


def test_a_robot_in_a_door_that_is_shut_may_go_on_as_long_as_it_is_open() -> None:
    hall = Hall(lattice(4, 1), (across("P1-0", "P2-0"),), "P0-0")
    hall.send("R0", "P3-0")
    hall.run(15)
    hall.set(OPEN)
    hall.tick()
    track = hall.traffic._tracks[hall.plan().robot]
    shut, cells = hall.traffic._doors, [slot.cell for slot in track.owned]
    for now, may in ((DoorNow(leave=True, works=False), True), (DoorNow(works=False), False)):
        hall.set(now)
        assert [track.may_enter(cell, shut.shut) for cell in cells if cell in shut.shut] == 4 * [
            may
        ]


def test_robots_go_round_a_broken_door_and_through_it_again_once_it_works() -> None:
    hall = Hall(lattice(3, 2), (across("P0-0", "P1-0"),), "P0-0")
    hall.tick()
    way = hall.traffic.cost_s(hall.plan().robot, PointName("P2-0"))
    hall.set(BROKEN)
    assert hall.traffic.cost_s(hall.plan().robot, PointName("P2-0")) > way + 4
    hall.set(SHUT)
    assert hall.traffic.cost_s(hall.plan().robot, PointName("P2-0")) == way
    hall.set(BROKEN)
    hall.send("R0", "P2-0")
    hall.run(20)
    assert hall.traffic.stands_at(hall.plan().robot, PointName("P2-0"))


def test_who_has_no_way_but_a_broken_door_stays_and_says_so() -> None:
    hall = Hall(lattice(4, 1), (across("P1-0", "P2-0"),), "P0-0")
    hall.set(BROKEN)
    hall.send("R0", "P3-0")
    hall.run(10)
    assert hall.traffic.cost_s(hall.plan().robot, PointName("P3-0")) == INFINITE
    assert hall.plan().blocked_by == ("door:D1",)
    assert hall.plan().commit == 0, "nothing is committed that could hold up others"
    hall.set(OPEN)
    hall.run(20)
    assert hall.traffic.stands_at(hall.plan().robot, PointName("P3-0"))


def test_a_restart_wants_the_door_that_a_robot_is_in() -> None:
    hall = Hall(lattice(4, 1), (across("P1-0", "P2-0"),), "P0-0")
    hall.set(OPEN)
    hall.send("R0", "P3-0")
    while not hall.robots[hall.plan().robot].x > 2.6:
        hall.tick()
    hall.set(SHUT)
    hall.restart()
    for _ in range(3):
        hall.tick()
    assert hall.traffic.wanted_doors() == {1: ("R0",)}


def test_a_robot_found_beside_its_lane_wants_only_the_door_it_is_in() -> None:
    door = across("P1-0", "P2-0")
    for x_m, wanted in ((3.0, {1: ("R0",)}), (1.9, {}), (4.1, {})):
        hall = Hall(lattice(4, 1), (door,), "P1-0")
        robot = hall.robots[next(iter(hall.robots))]
        robot.x, robot.y = x_m, 0.35
        hall.tick()
        assert hall.traffic.wanted_doors() == wanted, x_m


def test_the_points_between_two_lanes_of_a_door_are_its_ground_too() -> None:
    keys = (*across("P1-0", "P2-0").paths, *across("P2-0", "P3-0").paths)
    door = Door(id=1, name="D1", area=0, paths=keys)
    hall = Hall(lattice(5, 1), (door,), "P2-0", "P0-0")
    hall.tick()
    assert hall.traffic.wanted_doors() == {1: ("R0",)}, "only who stands in it"


def test_a_door_around_a_point_is_entered_before_the_body_reaches_it() -> None:
    area = lattice(4, 1)
    door = Door(id=1, name="D1", area=0, points=(PointName("P2-0"),))
    hall = Hall(area, (door,), "P0-0")
    hall.send("R0", "P3-0")
    hall.run(15)
    roadmap = compile_area(area, GROUPS)
    ground = roadmap.polygon(roadmap.rest(0, roadmap.net.number[PointName("P2-0")]))
    assert not hall.bodies()[hall.plan().robot].intersects(ground)
    hall.set(OPEN)
    hall.run(15)
    assert hall.traffic.stands_at(hall.plan().robot, PointName("P3-0"))


def test_doors_of_other_areas_are_passed_over() -> None:
    door = Door(id=1, name="D1", area=5, paths=across("P1-0", "P2-0").paths)
    hall = Hall(lattice(4, 1), (door,), "P0-0")
    hall.send("R0", "P3-0")
    hall.run(15)
    assert hall.traffic.stands_at(hall.plan().robot, PointName("P3-0"))
