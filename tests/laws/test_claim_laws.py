"""Laws of reserved ground: nobody but the owner's own is on it from grant to release."""

import random

import shapely
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from ledger.ids import PointName
from ledger.scene import Group
from scheduler.corridors import Corridor
from tests.laws.test_traffic_laws import floors
from tests.scheduler.traffic.floor import Floor
from tests.scheduler.traffic.maps import lattice, warehouse

FEW = settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])
OVERLAP_M2 = 1e-6
CLEARED_S_MAX = 120  # for ground that nobody who cannot leave rests on
DONE_S_MAX = 240  # for a goal after all ground was given back


class Reserving:
    """Claims and gives back ground on a floor at random, and looks on by polygons alone."""

    def __init__(self, floor: Floor, chance: random.Random, owners: list[str]) -> None:
        self.floor, self.chance, self.owners = floor, chance, owners
        self.claims: dict[str, tuple[str, tuple[tuple[float, float], ...]]] = {}
        self.granted: set[str] = set()
        self.asked = 0

    def ask(self) -> None:
        """A rectangle anywhere that is clear of those of other owners."""
        xs = [point.x_m for point in self.floor.area.points]
        ys = [point.y_m for point in self.floor.area.points]
        x, y = self.chance.uniform(min(xs), max(xs)), self.chance.uniform(min(ys), max(ys))
        wide, high = self.chance.uniform(0.1, 2.5), self.chance.uniform(0.1, 2.5)
        ring = tuple(shapely.get_coordinates(shapely.box(x, y, x + wide, y + high))[:-1].tolist())
        owner = self.chance.choice(self.owners)
        polygon = shapely.Polygon(ring)
        others = (r for o, r in self.claims.values() if o != owner)
        if not any(shapely.Polygon(other).intersects(polygon) for other in others):
            self.asked += 1
            self.claims[f"u{self.asked}"] = (owner, tuple(map(tuple, ring)))
            self.floor.traffic.claim(f"u{self.asked}", owner, (tuple(map(tuple, ring)),))

    def give_back(self, id_: str) -> None:
        del self.claims[id_]
        self.granted.discard(id_)
        self.floor.traffic.unclaim(id_)

    def restart(self) -> None:
        """A new scheduler is told of all, and of what was granted before."""
        self.floor.restart()
        for id_, (owner, ring) in sorted(self.claims.items()):
            self.floor.traffic.claim(id_, owner, (ring,), owned=id_ in self.granted)

    def look(self) -> None:
        self.granted.update(i for i in self.claims if self.floor.traffic.claimed(i))
        bodies = self.floor.bodies()
        for id_ in self.granted:
            owner, ring = self.claims[id_]
            ground = shapely.Polygon(ring)
            for name, body in bodies.items():
                if name != owner:
                    assert body.intersection(ground).area < OVERLAP_M2, (id_, name)

    def run(self, seconds: float) -> None:
        for k in range(round(seconds * 10)):
            self.floor.tick()
            self.look()
            if k % 5 == 0:
                self.floor.judge()


@FEW
@given(floors(), st.integers(0, 10_000))
def test_nobody_else_is_on_reserved_ground_from_grant_to_release(floor, seed):
    chance = random.Random(seed)
    reserving = Reserving(floor, chance, ["Box-02", "WMS", "R0"])
    for _ in range(25):
        reserving.run(chance.uniform(0.1, 4.0))
        what = chance.random()
        if what < 0.5 and len(reserving.claims) < 4:
            reserving.ask()
        elif what < 0.75 and reserving.claims:
            reserving.give_back(chance.choice(sorted(reserving.claims)))
        elif what < 0.85:
            reserving.restart()


def busy_floor(seed: int, *, aisles: bool) -> Floor:
    """A map on which every goal can be reached from everywhere, with a third of it taken."""
    chance = random.Random(seed)
    area = warehouse(4, 5, 2) if aisles else lattice(4, 4)
    points = [p.name for p in area.points]
    rests = [n for n in points if n[0] in "SNP"]
    goals = [PointName(n) for n in points if n[0] in "BP"]
    starts = {f"R{k}": (name, 0.0) for k, name in enumerate(chance.sample(rests, 4))}
    lanes = {
        PointName(n): Corridor(name=PointName(n.split("-")[0]), orders_max=2)
        for n in points
        if n.startswith("B")
    }
    group = (Group(id=0, name="g"),)
    return Floor(area, group, starts, goals, seed=seed, service_s=1.0, corridors=lanes)


@FEW
@given(st.integers(0, 10_000), st.booleans())
def test_all_goals_are_reached_once_the_ground_is_given_back(seed, aisles):
    floor = busy_floor(seed, aisles=aisles)
    chance = random.Random(seed)
    reserving = Reserving(floor, chance, ["Box-02", "WMS"])
    for _ in range(10):
        reserving.run(chance.uniform(0.5, 4.0))
        if len(reserving.claims) < 3:
            reserving.ask()
        else:
            reserving.give_back(chance.choice(sorted(reserving.claims)))
    for id_ in sorted(reserving.claims):
        reserving.give_back(id_)
    before = dict(floor.done)
    for _ in range(DONE_S_MAX):
        reserving.run(1)
        if all(floor.done[name] > before[name] for name in floor.robots):
            return
    raise AssertionError(
        {
            n: (floor.goals.get(n), p)
            for n, p in zip(floor.robots, floor.traffic.plans(0), strict=True)
        }
    )


@FEW
@example(seed=1275, aisles=True)  # one drove to and fro on it, as both ways out are dead ends
@given(st.integers(0, 10_000), st.booleans())
def test_ground_is_had_in_bounded_time_if_all_on_it_can_leave(seed, aisles):
    floor = busy_floor(seed, aisles=aisles)
    chance = random.Random(seed)
    reserving = Reserving(floor, chance, ["Box-02"])
    reserving.run(chance.uniform(1, 10))
    while not reserving.claims:
        reserving.ask()
    for _ in range(CLEARED_S_MAX):
        reserving.run(1)
        if reserving.granted:
            return
    raise AssertionError(floor.traffic.plans(0))
