"""A shift with doors, and an onlooker that shares nothing with traffic but the map's drawing."""

import math
import random
import tempfile
from pathlib import Path as FilePath

import msgspec
import shapely

from commands.devices import CloseDoors, KeepDoorsOpen, OpenDoors
from fleetledger.shift import Shift
from ledger.feed import FeedFollower
from ledger.ids import CommandId, PointName, RobotName
from ledger.link import DoorStatus
from ledger.scene import Area, Door, RobotConfig, SceneFile
from ledger.state import DeviceKind, StepTask
from scheduler.traffic.judge import body, collisions
from sim.devices import SimDoor
from sim.faults import FaultMix
from sim.link import SimRole
from sim.robot import place
from sim.world import World
from tests.scheduler.traffic.maps import lattice

PITCH_M = 2.0
REACH_M = 0.7  # a body that stands, or turns, on a point does not reach further


def door_across(id_: int, a: str, b: str, **fields: object) -> Door:
    keys = (f"{a}->{b}", f"{b}->{a}")
    return Door(id=id_, name=f"D{id_}", area=1, paths=keys, simulated=True, **fields)  # type: ignore[arg-type]


def door_at(id_: int, point: str) -> Door:
    return Door(id=id_, name=f"D{id_}", area=1, points=(PointName(point),), simulated=True)


def hall(columns: int, rows: int) -> Area:
    return msgspec.structs.replace(lattice(columns, rows, PITCH_M), id=1, name="hall")


def threshold(area: Area, door: Door) -> shapely.Geometry:
    """Where nobody is who waits before the door, passes by it, or has passed it."""
    at = {point.name: (point.x_m, point.y_m) for point in area.points}
    if door.points:
        return shapely.union_all([shapely.Point(at[p]).buffer(0.3) for p in door.points])
    lanes = [shapely.LineString([at[end] for end in key.split("->")]) for key in door.paths]
    ends = [shapely.Point(at[end]).buffer(REACH_M) for key in door.paths for end in key.split("->")]
    wide = shapely.union_all([lane.buffer(0.3) for lane in lanes])
    return shapely.difference(wide, shapely.union_all(ends))


class Doorkeeping:
    """A shift whose every moment is looked at; simulators and schedulers die and come back."""

    def __init__(
        self, area: Area, doors: tuple[Door, ...], robots: int, seed: int, late: float = 0.0
    ) -> None:
        self.area, self.doors = area, doors
        self.chance = random.Random(seed)
        configs = (RobotConfig(name=RobotName(f"R{n}"), simulated=True) for n in range(robots))
        file = SceneFile(name="hall", areas=(area,), doors=doors, robots=tuple(configs))
        self.late = FaultMix(late_ratio=late, late_mean_s=4.0)
        self.shift = Shift(file, seed=seed, faults=self.late)
        self.folder = tempfile.TemporaryDirectory()
        self.thresholds = {door.id: threshold(area, door) for door in doors}
        self.kill_sim()

    def __enter__(self) -> "Doorkeeping":
        return self

    def __exit__(self, *trouble: object) -> None:
        self.folder.cleanup()

    def kill_sim(self) -> None:
        """Kill the simulator: it remembers what it wrote to its files, and nothing else."""
        shift = self.shift
        for let_go in shift.sim._tokens.values():
            let_go()
        shift.world = World(random.Random(self.chance.random()), self.late)
        memory = FilePath(self.folder.name) / "sim.saved"
        shift.sim = SimRole(
            shift.bus, FeedFollower(shift.bus), shift.world, memory=memory, report_ms=shift.step_ms
        )
        shift.sim.start(shift.now_ms)

    def status(self, door: int) -> DoorStatus:
        found = self.shift.sim.devices._devices[self.shift.scene, DeviceKind.DOOR, door]
        assert isinstance(found, SimDoor)
        return found.leaf.status

    def bodies(self) -> dict[RobotName, shapely.Polygon]:
        outline = ((0.5, 0.35), (-0.5, 0.35), (-0.5, -0.35), (0.5, -0.35))
        return {
            robot.body.name: body(outline, *place(robot)[:3]) for robot in self.shift.world.robots()
        }

    def in_doors(self) -> dict[int, list[RobotName]]:
        """Robots in doors that are not open."""
        found = {
            id_: [name for name, shape in self.bodies().items() if shape.intersects(ground)]
            for id_, ground in self.thresholds.items()
            if self.status(id_) is not DoorStatus.OPENED
        }
        return {id_: names for id_, names in found.items() if names}

    def judge(self) -> None:
        """Nobody's true body is in a door that is not open, and none in another's."""
        assert collisions(self.bodies()) == []
        assert self.in_doors() == {}

    def run(self, seconds: float) -> None:
        self.shift.run(seconds, self.judge)

    def order(self, *points: str) -> None:
        self.shift.order(*(StepTask(location=point) for point in points))

    def order_at_random(self) -> None:
        shut = {point for door in self.doors for point in door.points}
        points = [point.name for point in self.area.points if point.name not in shut]
        self.order(*self.chance.sample(points, 2))

    def ask(self, what: str, door: int) -> None:
        """One of the things that people do to doors."""
        shift, devices = self.shift, self.shift.sim.devices
        head = {
            "id": CommandId(shift.handler.new_id()),
            "by": "tester",
            "at_ms": shift.now_ms,
            "scene": shift.scene,
            "doors": (door,),
        }
        match what:
            case "open":
                shift.handler.handle(OpenDoors(**head))
            case "close":
                shift.handler.handle(CloseDoors(**head))
            case "hold":
                shift.handler.handle(KeepDoorsOpen(**head))
            case "let go":
                shift.handler.handle(KeepDoorsOpen(**head, keep_open=False))
            case "jam":
                devices.fault(shift.scene, DeviceKind.DOOR, door, "it is stuck")
            case "mend":
                devices.mend(shift.scene, DeviceKind.DOOR, door)
            case "kill sim":
                self.kill_sim()
            case "kill scheduler":
                shift.restart_scheduler()

    def finish(self, seconds: float) -> None:
        """Mend and let go of everything, and let all orders end."""
        for door in self.doors:
            self.ask("mend", door.id)
            self.ask("let go", door.id)
        for _ in range(math.ceil(seconds / 10)):
            if not self.business():
                return
            self.run(10)

    def business(self) -> list[str]:
        return [f"{o.id} {o.robot} {o.execution_reject}" for o in self.shift.fleet.orders.values()]
