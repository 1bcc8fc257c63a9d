"""Traffic with real footprints: orders per hour on lattices and in aisles, beside free flow.

Run as `python -m bench.floors`, or with `--quick` for minutes instead of hours of simulation.
Free flow is the same robots, delays and service times passing through each other. The setup is
that of the design notes (traffic §11): 1.0 x 0.7 m and 5 cm around it, 1.2 m/s, 0.6 m/s², turns of
1 rad/s, steps of 0.1 s, one move in ten late by an exponential time of 6 s in the mean.
"""

import argparse
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from itertools import pairwise

import msgspec

from bench.tables import show
from ledger.ids import BinName, PointName
from ledger.scene import XY, Area, Bin, Group, Kinematics, Path, Point, PointKind
from scheduler.corridors import corridors_of
from tests.scheduler.traffic.floor import DT_S, Floor
from tests.scheduler.traffic.maps import area_of
from tests.stands import STALL_MS, Stands

GROUPS = (Group(id=0, name="g", kinematics=Kinematics(turn_radps2_max=1e6)),)
LATE = 0.1
WARM_UP_S = 120
JUDGE_S = 0.5  # bodies
GRANTS_S = 30.0  # and that each is on ground of its own
LOOK_S = 1.0  # for who stands
AISLES, AISLE_M, PITCH_M, BLIND = 12, 20, 2.5, (2, 6, 10)
STUBS, STUB_M = 11, 2.5
LANE_GAP_M = 2.0

Row = dict[str, float | str]


class Instance(msgspec.Struct, frozen=True, kw_only=True):
    """One map with one number of robots, and what it is held against."""

    name: str
    robots: int
    area: Callable[[], Area]
    starts: Callable[[Area], list[PointName]]
    goals: Callable[[Area], list[PointName]]
    service_s: float = 0.0
    share: float = 0.0  # of free flow, at least
    aim: float = 0.0
    hours: float = 1.0  # simulated in the full run
    quick_s: int = 600
    seeds: int = 2


def lattice(side: int, pitch_m: float, spacing_m: float) -> Area:
    """Two-way lanes in a square lattice, with a point each `spacing_m` along them."""
    points: dict[str, Point] = {}
    paths: list[Path] = []
    steps = round(pitch_m / spacing_m)

    def point(i: int, j: int) -> PointName:
        name = PointName(f"P{i}-{j}")
        points.setdefault(name, Point(name=name, x_m=i * spacing_m, y_m=j * spacing_m))
        return name

    last = (side - 1) * steps
    for lane in range(0, last + 1, steps):
        for a, b in pairwise(range(last + 1)):
            for start, end in ((point(a, lane), point(b, lane)), (point(lane, a), point(lane, b))):
                paths += [Path(start=start, end=end), Path(start=end, end=start)]
    return area_of(list(points.values()), paths)


def aisles(lanes: str) -> Area:
    """Two-way single-lane aisles with a bin each metre between cross lanes, points each half
    metre, parking stubs below them; three aisles are dead ends.

    What the prototype's cross lanes were is not recorded. Its 663 points and 1,240 paths, fewer
    than two for each link, speak for one-way lanes, its free flow for two-way ones. `lanes`:
    "paired" (two-way, tied together at every aisle, as warehouses are built and `sim` generates
    them), "one-way" (a ring: east below, west above), or "single" (one two-way lane).
    """
    points: dict[PointName, Point] = {}
    paths: list[Path] = []
    bins: list[Bin] = []

    def line(at_m: XY, dx: int, dy: int, length_m: float, both: bool = True) -> None:
        before: PointName | None = None
        for k in range(round(length_m * 2) + 1):
            x, y = at_m[0] + dx * k / 2, at_m[1] + dy * k / 2
            name = PointName(f"{x:.1f}/{y:.1f}")
            points.setdefault(name, Point(name=name, x_m=x, y_m=y))
            if before is not None:
                paths.append(Path(start=before, end=name))
                if both:
                    paths.append(Path(start=name, end=before))
            before = name

    def mark(x: float, y: float, kind: PointKind) -> PointName:
        name = PointName(f"{x:.1f}/{y:.1f}")
        points[name] = msgspec.structs.replace(points[name], kind=kind)
        return name

    gap = LANE_GAP_M if lanes == "paired" else 0.0
    for k in range(AISLES):
        x = k * PITCH_M
        line((x, -gap), 0, 1, AISLE_M + gap + (-2 if k in BLIND else gap))
        for y in range(2, AISLE_M - 1):
            name = mark(x, float(y), PointKind.ACTION)
            bins.append(Bin(name=BinName(name), point=name))
    east = (AISLES - 1) * PITCH_M
    for level in sorted({0.0, -gap, float(AISLE_M), AISLE_M + gap}):
        start = (east, level) if level >= AISLE_M else (0.0, level)
        line(start, -1 if level >= AISLE_M else 1, 0, east, both=lanes != "one-way")
    for k in range(STUBS):
        line((k * PITCH_M, -gap), 0, -1, STUB_M)
        mark(k * PITCH_M, -gap - STUB_M, PointKind.PARKING)
    return area_of(list(points.values()), paths, bins)


def _crossings(area: Area) -> list[PointName]:
    """Points where lanes meet; not the corners, whose stop may be anywhere near them."""
    leaving = Counter(path.start for path in area.paths)
    return [point.name for point in area.points if leaving[point.name] > 2]


def _ends(area: Area) -> list[PointName]:
    return [point.name for point in area.points if point.kind is not PointKind.WAYPOINT]


def instances() -> list[Instance]:
    """Maps, robots, and the shares of free flow that they are held against."""
    found = [
        Instance(
            name="lattice 10 x 10",
            robots=robots,
            area=lambda: lattice(10, 2.0, 2.0),
            starts=_crossings,
            goals=_crossings,
            hours=8.0,
            seeds=1,
        )
        for robots in (4, 10, 20, 40)
    ]
    found += [
        Instance(
            name="fine lattice 15 x 15",
            robots=robots,
            area=lambda: lattice(15, 2.0, 0.5),
            starts=_crossings,
            goals=_crossings,
            share=share,
            aim=aim,
        )
        for robots, share, aim in ((15, 0.80, 0.85), (30, 0.69, 0.75), (60, 0.51, 0.60))
    ]
    found += [
        Instance(
            name=f"aisles, three dead ends, {lanes} cross lanes",
            robots=robots,
            area=partial(aisles, lanes),
            starts=_ends,
            goals=_ends,
            service_s=10.0,
            share=share if lanes == "paired" else 0.0,
        )
        for lanes in ("paired", "one-way", "single")
        for robots, share in ((10, 0.82), (20, 0.72), (30, 0.69))
    ]
    return found


def floor(instance: Instance, seed: int, free_flow: bool = False) -> Floor:
    """Robots spread over the map, with orders to random goals; into corridors, in free flow too, no
    more of them than dispatch sends there.
    """
    area = instance.area()
    names = instance.starts(area)
    step = len(names) / instance.robots
    return Floor(
        area,
        GROUPS,
        {f"R{k:02d}": (names[int(k * step)], 0.0) for k in range(instance.robots)},
        instance.goals(area),
        seed=seed,
        late=LATE,
        service_s=instance.service_s,
        corridors=corridors_of(area),
        free_flow=free_flow,
    )


def begun(made: Floor) -> Floor:
    """Let robots spread as they will stay, and measure from then on."""
    for _ in range(round(WARM_UP_S / DT_S)):
        made.tick()
    made.begin()
    return made


def judged(made: Floor, seconds: float) -> Stands:
    """Run under the judge; who stood without a named cause."""
    stands = Stands()
    for k in range(round(seconds / DT_S)):
        made.tick()
        if k % round(LOOK_S / DT_S) == 0:
            _look(made, stands)
        if k % round(JUDGE_S / DT_S) == 0:
            made.judge_bodies()
        if k % round(GRANTS_S / DT_S) == 0:
            made.judge()
    return stands


def _look(made: Floor, stands: Stands) -> None:
    bound = made.goals.keys() - made.busy.keys()
    stood = [name for name in Stands.long(made.moved_ms, made.now_ms) if name in bound]
    if stood:
        plans = {plan.robot: plan for plan in made.traffic.plans(made.now_ms)}
        stands.look(stood, made.moved_ms, plans, (), made.now_ms)


def free_orders_per_h(instance: Instance, seed: int, seconds: float) -> float:
    """Of the control: robots that pass through each other."""
    control = begun(floor(instance, seed, free_flow=True))
    for _ in range(round(seconds / DT_S)):
        control.tick()
    return control.orders_per_h()


def measure(instance: Instance, seed: int, seconds: float) -> Row:
    """One run under the judge and its control."""
    start = time.process_time()
    free = free_orders_per_h(instance, seed, seconds)
    ours = begun(floor(instance, seed))
    stands = judged(ours, seconds)
    return {
        "orders_per_h": ours.orders_per_h(),
        "free_flow_per_h": free,
        "share": ours.orders_per_h() / free,
        "unserved_s": ours.unserved_ms / 1000,
        "unnamed_s": stands.unnamed_ms / 1000,
        "cpu_s": time.process_time() - start,
    }


def row(instance: Instance, quick: bool) -> Row:
    """All seeds of one instance: means, and the longest waits."""
    seconds = instance.quick_s if quick else instance.hours * 3600
    runs = [measure(instance, seed, seconds) for seed in range(1, instance.seeds + 1)]

    def mean(key: str) -> float:
        return sum(float(run[key]) for run in runs) / len(runs)

    return {
        "instance": instance.name,
        "robots": instance.robots,
        "ours": mean("share"),
        "at_least": instance.share,
        "aim": instance.aim,
        "unit": "share of free flow",
        "orders_per_h": mean("orders_per_h"),
        "free_flow_per_h": mean("free_flow_per_h"),
        "unserved_s": max(float(run["unserved_s"]) for run in runs),
        "unnamed_s": max(float(run["unnamed_s"]) for run in runs),
        "unnamed_s_max": STALL_MS / 1000,
        "simulated_s": seconds * len(runs),
        "cpu_s": mean("cpu_s") * len(runs),
    }


def rows(quick: bool = False, only: str = "") -> list[Row]:
    """Every instance, or those whose name has `only` in it."""
    return [row(i, quick) for i in instances() if only in f"{i.name} {i.robots}"]


def report(title: str, rows: Callable[[bool, str], list[Row]], about: str | None) -> None:
    """Measure what the command line asks for, and print it."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--only", default="", help="instances with this in their names")
    given = parser.parse_args()
    show(title, rows(given.quick, given.only))


if __name__ == "__main__":
    report("traffic: floors", rows, __doc__)
