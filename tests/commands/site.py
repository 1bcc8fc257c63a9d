"""A small site for tests of commands, with names that the golden examples use."""

from itertools import pairwise

from ledger.events import (
    AnyEvent,
    OrderAssigned,
    OrderCreated,
    RobotAdded,
    RobotConnected,
    SceneImported,
    StepFinished,
    StepStarted,
)
from ledger.ids import BinName, OrderId, PointName, RobotName, SceneId
from ledger.scene import Area, Bin, BinTask, ContainerType, Group, Path, Point, RobotConfig
from ledger.state import StepTask

SCENE = SceneId("6870D00B569153590E058D3F")
POINTS = ("AP110", "AP125", "AP2483", "PP1", "CP1")
BINS = ("BHQ1_0105_04", "BHQ1_0101_03")
TASKS = (BinTask(name="Load", operation="JackLoad"), BinTask(name="Unload", operation="JackUnload"))
ORDER = OrderId("TO20250806-000001")
SECOND = OrderId("TO20250806-000002")
R1, R2 = RobotName("R1"), RobotName("R2")


def area() -> Area:
    points = tuple(Point(name=PointName(n), x_m=float(i), y_m=0.0) for i, n in enumerate(POINTS))
    paths = tuple(
        Path(start=a.name, end=b.name)
        for one, other in pairwise(points)
        for a, b in ((one, other), (other, one))
    )
    bins = tuple(Bin(name=BinName(n), point=PointName("AP110"), tasks=TASKS) for n in BINS)
    return Area(
        id=1,
        name="hall",
        map_name="hall",
        map_digest="0" * 32,
        points=points,
        paths=paths,
        bins=bins,
    )


def opened(*robots: RobotName, bins: int = 1) -> tuple[AnyEvent, ...]:
    """The scene and robots that are there and answer."""
    scene = SceneImported(
        scene=SCENE,
        name="site",
        digest="d" * 64,
        areas=(area(),),
        groups=(Group(id=0, name="default"), Group(id=1, name="AMR")),
        container_types=(ContainerType(name="pallet"),),
    )
    came: list[AnyEvent] = [scene]
    for robot in robots:
        config = RobotConfig(name=robot, group=1, simulated=True, bin_count=bins)
        came += [RobotAdded(scene=SCENE, config=config), RobotConnected(scene=SCENE, robot=robot)]
    return tuple(came)


def task(location: str = "AP110", **fields: object) -> StepTask:
    return StepTask(location=location, **fields)


def created(
    order: OrderId = ORDER, *tasks: StepTask, sealed: bool = True, **fields: object
) -> OrderCreated:
    return OrderCreated(scene=SCENE, order=order, tasks=tasks, sealed=sealed, **fields)


def assigned(order: OrderId = ORDER, robot: RobotName = R1, bin: int = 0) -> OrderAssigned:
    return OrderAssigned(scene=SCENE, order=order, robot=robot, bin=bin, cost_s=1.0)


def started(step: int = 0, order: OrderId = ORDER, robot: RobotName = R1) -> StepStarted:
    return StepStarted(scene=SCENE, order=order, step=step, robot=robot)


def finished(step: int = 0, order: OrderId = ORDER, robot: RobotName = R1) -> StepFinished:
    return StepFinished(scene=SCENE, order=order, step=step, robot=robot)
