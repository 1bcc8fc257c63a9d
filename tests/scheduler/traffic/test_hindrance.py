from itertools import combinations

import msgspec
import pytest

from ledger.scene import Group
from scheduler.traffic.compile import THIRD_PARTIES, compile_area
from scheduler.traffic.hindrance import hindrance
from tests.scheduler.traffic.maps import area_of, lattice

GROUPS = [Group(id=0, name="g")]


def test_where_every_way_leads_between_two_stops_fewer_are_taken():
    grid = compile_area(lattice(12, 12, 1.0), GROUPS)
    assert grid.places.stops == 36  # not the 70 that are clear of each other
    points = [grid.net.points[point] for point in grid.places.point[:36]]
    assert min(abs(a.x_m - b.x_m) + abs(a.y_m - b.y_m) for a, b in combinations(points, 2)) >= 2.0


def test_fewer_stops_are_not_taken_for_their_own_sake():
    assert compile_area(lattice(12, 12, 0.7), GROUPS).places.stops == 36  # each second point
    assert compile_area(lattice(6, 6, 2.0), GROUPS).places.stops == 36


def test_hindrance_grows_with_the_room_that_moves_need():
    roadmap = compile_area(lattice(5, 5), GROUPS)
    free = hindrance(roadmap.net, roadmap.places, roadmap.moves)
    assert free == pytest.approx(1 / 2.0 / 25)  # one stop each 2 m
    more = msgspec.structs.replace(roadmap.moves, need=[n | 7 for n in roadmap.moves.need])
    assert hindrance(roadmap.net, roadmap.places, more) > 1.5 * free
    assert THIRD_PARTIES > 0


def test_a_map_without_ways_hinders_without_end():
    area = lattice(3, 1, 3.0)
    roadmap = compile_area(area_of(list(area.points), []), GROUPS)
    assert hindrance(roadmap.net, roadmap.places, roadmap.moves) == float("inf")
