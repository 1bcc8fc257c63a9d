"""How long matching takes, and a pass of the assignment phase: `python -m bench.assign`."""

import json
import random
import statistics
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from ledger.ids import OrderId, PointName, RobotName, SceneId
from ledger.link import Report
from ledger.scene import Area, Point, RobotConfig, Scene
from ledger.state import BinStatus, Order, OrderStatus, Robot, RobotBin, Step, StepTask
from scheduler.current import current
from scheduler.dispatch.matching import match_greedy, match_km
from scheduler.dispatch.phases import ALL, QUICK, dispatch
from scheduler.places import find_places
from scheduler.view import RobotView, View

SCENE = SceneId("bench")
ROUNDS = 7
SIDE = 60  # points of the square map


class _Grid:
    """Roads of a grid, at the price of a dictionary look-up."""

    def __init__(self, at: dict[str, tuple[float, float]]) -> None:
        self._at = at

    def stands_at(self, robot: RobotName, point: PointName) -> bool:
        return self._at[robot] == self._at[point]

    def cost_s(self, robot: RobotName, point: PointName) -> float:
        (ax, ay), (bx, by) = self._at[robot], self._at[point]
        return abs(ax - bx) + abs(ay - by)

    def has_room(self, robot: RobotName) -> bool:
        """There always is."""
        return True

    def reserved(self, robot: RobotName, point: PointName) -> tuple[str, ...]:
        """Nothing is."""
        return ()


def _site(robots: int, orders: int, *, busy: bool, seed: int = 1) -> View:
    chance = random.Random(seed)
    points = tuple(
        Point(name=PointName(f"P{x}-{y}"), x_m=float(x), y_m=float(y))
        for x in range(SIDE)
        for y in range(SIDE)
    )
    area = Area(id=1, name="a", map_name="m", map_digest="", points=points, paths=())
    scene = Scene(id=SCENE, name="bench", digest="", areas=(area,), groups=())
    at: dict[str, tuple[float, float]] = {p.name: (p.x_m, p.y_m) for p in points}
    found: dict[RobotName, RobotView] = {}
    for n in range(robots):
        name = RobotName(f"R{n:04}")
        start = chance.choice(points)
        at[name] = (start.x_m, start.y_m)
        order = _order(10**6 + n, chance.choice(points), name) if busy else None
        found[name] = _robot(name, start, order)
    waiting = [_order(n, chance.choice(points), None) for n in range(orders)]
    return View(
        scene=scene, places=find_places(scene), robots=found, waiting=waiting, roads=_Grid(at)
    )


def _robot(name: RobotName, start: Point, order: Order | None) -> RobotView:
    content = RobotBin() if order is None else RobotBin(status=BinStatus.RESERVED, order=order.id)
    orders = () if order is None else (order,)
    return RobotView(
        name=name,
        robot=Robot(
            scene=SCENE,
            config=RobotConfig(name=name),
            online=True,
            bins=(content,),
            orders=tuple(o.id for o in orders),
            idle_since_ms=0,
        ),
        orders=orders,
        at=current(orders),
        report=Report(
            scene=SCENE,
            robot=name,
            number=1,
            at_ms=0,
            area=1,
            x_m=start.x_m,
            y_m=start.y_m,
            heading_rad=0.0,
            point=start.name,
        ),
        ready=True,
    )


def _order(number: int, point: Point, robot: RobotName | None) -> Order:
    id_ = OrderId(f"TO20260101-{number:07}")
    step = Step(id=f"{id_}-Step0", task=StepTask(location=point.name), created_ms=0, modified_ms=0)  # type: ignore[arg-type]
    return Order(
        id=id_,
        scene=SCENE,
        created_ms=0,
        created_by="",
        modified_ms=0,
        modified_by="",
        steps=(step,),
        robot=robot,
        bin=None if robot is None else 0,
        status=OrderStatus.TO_BE_ALLOCATED if robot is None else OrderStatus.ALLOCATED,
    )


def _ms(work: Callable[[], object]) -> float:
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        work()
        times.append((time.perf_counter() - start) * 1000)
    return round(statistics.median(times), 2)


def main() -> None:
    """Print the table, and keep it for comparison."""
    numbers = np.random.default_rng(1)
    results: dict[str, float] = {}
    for rows, columns in ((100, 100), (500, 500), (1000, 1000), (200, 1000)):
        table = numbers.uniform(0.0, 1000.0, (rows, columns))
        results[f"KM {rows} x {columns}, ms"] = _ms(partial(match_km, table))
        results[f"Greedy {rows} x {columns}, ms"] = _ms(partial(match_greedy, table))
    idle, busy = _site(100, 500, busy=False), _site(100, 500, busy=True)
    results["pass, 100 free robots, 500 orders, ms"] = _ms(lambda: dispatch(idle, 1, ALL))
    results["pass, 100 busy robots, 500 orders, ms"] = _ms(lambda: dispatch(busy, 1, ALL))
    results["quick phases, 100 busy robots, ms"] = _ms(lambda: dispatch(busy, 1, QUICK))
    for what, ms in results.items():
        print(f"{what:45} {ms:10.2f}")
    target = Path(__file__).parent / "results" / "assign.json"
    target.parent.mkdir(exist_ok=True)
    target.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
