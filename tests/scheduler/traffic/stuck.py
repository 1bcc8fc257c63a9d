"""Maps and worlds in which robots stand in each other's way, for tests of the ways out."""

import random

from ledger.ids import PointName
from ledger.scene import Area, Group, Path, Point
from scheduler.traffic.compile import compile_area
from scheduler.traffic.costs import Costs
from scheduler.traffic.roadmap import Roadmap
from scheduler.traffic.world import Agent, World
from tests.scheduler.traffic.maps import area_of, both, lattice, warehouse

GROUPS = (Group(id=0, name="g"),)


def drawn(lines: dict[str, tuple[float, float]], two_way: str, one_way: str = "") -> Area:
    """Points by name, and paths as pairs of letters: "ab bc"."""
    points = [Point(name=PointName(name), x_m=x, y_m=y) for name, (x, y) in lines.items()]
    paths = [path for pair in two_way.split() for path in both(pair[0], pair[1])]
    paths += [Path(start=PointName(p[0]), end=PointName(p[1])) for p in one_way.split()]
    return area_of(points, paths)


# A blind lane a-b-c-d with a place to pass at s, beside b.
PASSING_PLACE = drawn(
    {"a": (0, 0), "b": (2, 0), "c": (4, 0), "d": (6, 0), "s": (2, 2)}, "ab bc cd bs"
)
RING = drawn(
    {"a": (0, 0), "b": (2, 0), "c": (4, 0), "d": (4, 2), "e": (2, 2), "f": (0, 2)},
    "ab bc cd de ef fa",
)
LOOP = drawn(
    {"a": (0, 0), "b": (2, 0), "c": (4, 0), "d": (4, 2), "e": (2, 2), "f": (0, 2)},
    "",
    "ab bc cd de ef fa",
)
CROSS = drawn(
    {"a": (0, 0), "b": (2, 0), "c": (4, 0), "d": (6, 0), "s": (2, 2), "t": (4, -2)},
    "ab bc cd bs ct",
)
AREAS = (PASSING_PLACE, RING, LOOP, CROSS, lattice(3, 3), warehouse(2, 3, 1, blind=(1,)))
MAPS = [compile_area(area, GROUPS) for area in AREAS]
COSTS = [Costs(roadmap, GROUPS[0].kinematics) for roadmap in MAPS]


def roads(area: Area) -> tuple[Roadmap, Costs]:
    """An area compiled."""
    roadmap = compile_area(area, GROUPS)
    return roadmap, Costs(roadmap, GROUPS[0].kinematics)


def world_on(
    on: tuple[Roadmap, Costs], stands: dict[str, str], goals: dict[str, str], **fixed: bool
) -> World:
    """Robots by name at points, with goals; the first one has the highest rank."""
    roadmap, costs = on
    return World(
        roadmap=roadmap,
        agents=[
            Agent(
                name=name,
                place=roadmap.place[PointName(at)],
                heading_rad=0.0,
                costs=costs,
                goal=roadmap.place[PointName(goals[name])] if name in goals else None,
                fixed=fixed.get(name, False),
            )
            for name, at in stands.items()
        ],
    )


def world_of(which: int, stands: dict[str, str], goals: dict[str, str], **fixed: bool) -> World:
    """The same on one of the maps."""
    return world_on((MAPS[which], COSTS[which]), stands, goals, **fixed)


def random_world(which: int, seed: int, robots_max: int) -> World:
    """Robots anywhere, bound for anywhere."""
    roadmap, chance = MAPS[which], random.Random(seed)
    count = chance.randint(2, min(robots_max, roadmap.places.stops))
    return World(
        roadmap=roadmap,
        agents=[
            Agent(
                name=f"R{k}",
                place=place,
                heading_rad=chance.choice((0.0, 1.57, 3.14, -1.57)),
                costs=COSTS[which],
                goal=chance.randrange(len(roadmap.place)),
                fixed=k > 0 and chance.random() < 0.1,
            )
            for k, place in enumerate(chance.sample(range(roadmap.places.stops), count))
        ],
    )


_SQUARE = compile_area(lattice(6, 6), GROUPS)
_SQUARE_COSTS = Costs(_SQUARE, GROUPS[0].kinematics)


def crowded(seed: int, robots: int) -> World:
    """So many of the 36 stops of a lattice taken."""
    chance = random.Random(seed)
    return World(
        roadmap=_SQUARE,
        agents=[
            Agent(
                name=f"R{k:02d}",
                place=place,
                heading_rad=0.0,
                costs=_SQUARE_COSTS,
                goal=chance.randrange(36),
            )
            for k, place in enumerate(chance.sample(range(36), robots))
        ],
    )
