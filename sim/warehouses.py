"""Generated warehouses of any size, for demos, tests and benchmarks.

```
    P P P P P P P P P     yard rows: parking and chargers on both sides of a lane, as many as needed
    +-+-+-+-+-+-+-+-+
    P P P P P P P P P     places on spurs, off the lanes
    +-+-+-+-+-+-+-+-+     two cross lanes, tied together at every aisle
    +-+-+-+-+-+-+-+-+
    |   |   |   |         aisles: one lane between racks, two-way, open at both ends
    +-+-+-+-+-+-+-+-+     likewise between two blocks of racks
    +-+-+-+-+-+-+-+-+
    |   |   |   |
    +-+-+-+-+-+-+-+-+     two cross lanes
    +-+-+-+-+-+-+-+-+
    A-+     A-+           pick stations on loops of their own: in one way, out another
```

All lanes are straight and two-way. Points are so far apart (1.4 m in aisles, 1.8 m elsewhere) that
robots of 1.0 x 0.7 m may stand and turn on any of them at once: a rotation disc has 0.61 m, and
what meets another point's disc is no place to rest for the planner.
A yard has a way out at both ends and at every fifth column: with those at its ends alone a hundred
robots that left it at once stood for four minutes (71 orders were done in those, 55 without).
Without the places on spurs no single point cuts the lanes in two.
"""

import hashlib
import random
from itertools import pairwise
from math import ceil

import msgspec

from ledger.ids import BinName, PointName, RobotName
from ledger.scene import (
    XY,
    Area,
    Bin,
    BinTask,
    Path,
    Point,
    PointKind,
    RobotConfig,
    SceneFile,
)

COLUMN_M = 1.8  # between points of cross lanes; every other column is an aisle
BAY_M = 1.4
LANE_GAP_M = 2.0  # between the two lanes of a pair, and down to the stations
SPUR_M = 1.8
YARD_M = 3 * SPUR_M  # from one yard lane to the next: two spurs and the gap between their ends
RUNG_FIRST, RUNG_COLUMNS = 3, 5  # ways out of a yard, beside those at its ends
RACK_DEPTH_M = 1.0
RACK_GAP_M = 0.8  # from the lane's middle to the rack
AISLES_MAX = 200
BAYS_MAX = 200
BLOCKS_MAX = 50
ROBOTS_MAX = 2000

PREFIX = {
    PointKind.WAYPOINT: "LM",
    PointKind.ACTION: "AP",
    PointKind.PARKING: "PP",
    PointKind.CHARGING: "CP",
}
LOAD = BinTask(name="Load", operation="JackLoad")
UNLOAD = BinTask(name="Unload", operation="JackUnload")


class Layout:
    """A warehouse being drawn: points by their place on the drawing, and what joins them."""

    def __init__(self) -> None:
        self.points: dict[XY, Point] = {}
        self.paths: list[Path] = []
        self.bins: list[Bin] = []
        self.walls: list[tuple[XY, XY]] = []

    def point(self, x_m: float, y_m: float, kind: PointKind = PointKind.WAYPOINT) -> XY:
        """Draw a point; numbers run over all kinds, as in the vendor's maps."""
        at = (round(x_m, 3), round(y_m, 3))
        if at not in self.points:
            name = PointName(f"{PREFIX[kind]}{len(self.points) + 1}")
            self.points[at] = Point(name=name, x_m=at[0], y_m=at[1], kind=kind)
        return at

    def join(self, *chain: XY) -> None:
        """Draw a two-way lane through points."""
        for a, b in pairwise(chain):
            start, end = self.points[a].name, self.points[b].name
            self.paths.append(Path(start=start, end=end))
            self.paths.append(Path(start=end, end=start))

    def bin(self, name: str, at: XY) -> None:
        """Draw a storage place reached from a point."""
        point = self.points[at].name
        self.bins.append(Bin(name=BinName(name), point=point, tasks=(LOAD, UNLOAD)))

    def box(self, left_m: float, bottom_m: float, right_m: float, top_m: float) -> None:
        """Draw four walls."""
        corners = [(left_m, bottom_m), (right_m, bottom_m), (right_m, top_m), (left_m, top_m)]
        rounded = [(round(x, 3), round(y, 3)) for x, y in corners]
        self.walls.extend(zip(rounded, rounded[1:] + rounded[:1], strict=True))


def generate(
    *,
    aisles: int,
    bays: int,
    robots: int,
    seed: int,
    blocks: int = 1,
    stations: int | None = None,
    chargers: int | None = None,
    parking: int | None = None,
    name: str | None = None,
) -> SceneFile:
    """Draw a warehouse: `bays` in each of `blocks` of each aisle, bins left and right of them.

    By default a station for every two aisles, a charger for every five robots, and parking for all
    robots and a tenth more. The seed moves stations and chargers. Raises ValueError on a size that
    cannot be drawn.
    """
    stations = max(1, aisles // 2) if stations is None else stations
    chargers = max(2, ceil(robots / 5)) if chargers is None else chargers
    parking = robots + max(2, ceil(robots / 10)) if parking is None else parking
    _check(aisles, bays, blocks, robots, stations)
    rng = random.Random(seed)
    layout = Layout()
    columns = [i * COLUMN_M for i in range(2 * aisles)]
    south = _lane_pair(layout, columns, -LANE_GAP_M, 0.0)
    top_m = 0.0
    for block in range(blocks):
        bottom_m = top_m
        top_m = bottom_m + 2 * SPUR_M + (bays - 1) * BAY_M
        _lane_pair(layout, columns, top_m, top_m + LANE_GAP_M)
        for aisle in range(aisles):
            _aisle(layout, aisle, columns[2 * aisle], bottom_m, top_m, block * bays, bays)
        top_m += LANE_GAP_M
    chosen = sorted(rng.sample(range(aisles), stations))
    for number, aisle in enumerate(chosen, start=1):
        _station(layout, number, columns[2 * aisle], south)
    _places(layout, columns, top_m, chargers, parking, rng)
    return _scene_file(layout, name or f"Warehouse {aisles}x{bays * blocks}", robots)


def for_robots(robots: int, seed: int) -> SceneFile:
    """Draw a warehouse in which so many robots work well, on about one stop in twelve.

    What counts is a stretch of aisle for every robot, short enough to wait for. Measured with 50
    robots sent to random bins, one run of ten minutes each: 13 aisles of 2 x 8 bays did 1220 an
    hour, 14 of 4 x 4 did 1790, and 2140 with two lanes instead of one between the blocks.
    """
    blocks = max(1, round((robots / 3.2) ** 0.5))
    aisles = max(4, ceil(1.1 * robots / blocks))
    return generate(aisles=aisles, bays=4, blocks=blocks, robots=robots, seed=seed)


def _check(aisles: int, bays: int, blocks: int, robots: int, stations: int) -> None:
    for what, value, least, most in (
        ("aisles", aisles, 2, AISLES_MAX),
        ("bays", bays, 1, BAYS_MAX),
        ("blocks", blocks, 1, BLOCKS_MAX),
        ("robots", robots, 0, ROBOTS_MAX),
        ("stations", stations, 0, aisles),
    ):
        if not least <= value <= most:
            raise ValueError(f"{what} must be from {least} to {most}, not {value}")


def _lane_pair(layout: Layout, columns: list[float], low_m: float, high_m: float) -> float:
    """Draw two lanes side by side with a rung at every aisle and at the far end."""
    low = [layout.point(x, low_m) for x in columns]
    high = [layout.point(x, high_m) for x in columns]
    layout.join(*low)
    layout.join(*high)
    for column in [*range(0, len(columns), 2), len(columns) - 1]:
        layout.join(low[column], high[column])
    return low_m


def _aisle(
    layout: Layout,
    aisle: int,
    x_m: float,
    bottom_m: float,
    top_m: float,
    first_bay: int,
    bays: int,
) -> None:
    """Draw one aisle of one block, its bins and its racks."""
    chain = [layout.point(x_m, bottom_m)]
    for bay in range(bays):
        at = layout.point(x_m, bottom_m + SPUR_M + bay * BAY_M, PointKind.ACTION)
        chain.append(at)
        for side in ("L", "R"):
            layout.bin(f"B-{aisle + 1:02}-{first_bay + bay + 1:02}-{side}", at)
    chain.append(layout.point(x_m, top_m))
    layout.join(*chain)
    low, high = bottom_m + SPUR_M - BAY_M / 2, top_m - SPUR_M + BAY_M / 2
    for inner, outer in ((-RACK_GAP_M, -1), (RACK_GAP_M, 1)):
        edges = sorted((x_m + inner, x_m + inner + outer * RACK_DEPTH_M))
        layout.box(edges[0], low, edges[1], high)


def _station(layout: Layout, number: int, x_m: float, lane_m: float) -> None:
    """Draw a pick station on a loop, so that a waiting robot blocks neither lane nor exit."""
    station = layout.point(x_m, lane_m - LANE_GAP_M, PointKind.ACTION)
    beside = layout.point(x_m + COLUMN_M, lane_m - LANE_GAP_M)
    layout.join(layout.point(x_m, lane_m), station, beside, layout.point(x_m + COLUMN_M, lane_m))
    layout.bin(f"ST-{number:02}", station)
    layout.box(x_m - 0.8, lane_m - LANE_GAP_M - 1.9, x_m + 0.8, lane_m - LANE_GAP_M - 0.9)


def _places(
    layout: Layout,
    columns: list[float],
    lane_m: float,
    chargers: int,
    parking: int,
    rng: random.Random,
) -> None:
    """Draw spurs with places above the top lane, then yard lanes with places on both sides."""
    ends = (columns[0] - COLUMN_M, columns[-1] + COLUMN_M)
    rungs = columns[RUNG_FIRST::RUNG_COLUMNS] if len(columns) < chargers + parking else []
    beside = [x for x in columns if x not in rungs]
    spots = [((x, lane_m), (x, lane_m + SPUR_M)) for x in beside]
    first_m = lane_m
    while len(spots) < chargers + parking:
        above_m = lane_m + YARD_M
        for i in (0, -1):  # the yard hangs on the lane below by both ends …
            climb = [layout.point(ends[i], lane_m + k * SPUR_M) for k in range(4)]
            layout.join(*climb)
            if lane_m == first_m:  # a yard lane reaches to its ends by itself
                layout.join(layout.point(columns[i], lane_m), climb[0])
        for x in rungs:  # … and in between
            layout.join(*[layout.point(x, lane_m + k * SPUR_M) for k in range(4)])
        layout.join(*[layout.point(x, above_m) for x in (ends[0], *columns, ends[1])])
        for x in beside:
            spots.append(((x, above_m), (x, above_m - SPUR_M)))
            spots.append(((x, above_m), (x, above_m + SPUR_M)))
        lane_m = above_m
    used = spots[: chargers + parking]
    charging = set(rng.sample(range(len(used)), chargers))
    for i, (lane, spot) in enumerate(used):
        kind = PointKind.CHARGING if i in charging else PointKind.PARKING
        layout.join(layout.point(*lane), layout.point(*spot, kind))


def _scene_file(layout: Layout, name: str, robots: int) -> SceneFile:
    xs = [x for x, _ in layout.points]
    ys = [y for _, y in layout.points]
    layout.box(min(xs) - 2.5, min(ys) - 2.5, max(xs) + 2.5, max(ys) + 2.5)
    area = Area(
        id=0,
        name="Floor",
        map_name=name.replace(" ", "-").lower(),
        map_digest="",
        points=tuple(layout.points.values()),
        paths=tuple(layout.paths),
        bins=tuple(layout.bins),
        walls=tuple(layout.walls),
    )
    digest = hashlib.md5(msgspec.json.encode(area), usedforsecurity=False).hexdigest()
    return SceneFile(
        name=name,
        areas=(msgspec.structs.replace(area, map_digest=digest),),
        robots=tuple(
            RobotConfig(name=RobotName(f"AMB-{n:02}"), simulated=True) for n in range(1, robots + 1)
        ),
    )
