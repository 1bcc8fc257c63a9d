"""Generated warehouses hold what a planner needs."""

from math import hypot

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from commands.imports.scene_json import check_references, write_scene
from ledger.ids import PointName
from ledger.scene import Area, PointKind, SceneFile
from sim.warehouses import for_robots, generate

sizes = st.fixed_dictionaries(
    {
        "aisles": st.integers(2, 12),
        "bays": st.integers(1, 10),
        "blocks": st.integers(1, 3),
        "robots": st.integers(0, 60),
        "seed": st.integers(0, 5),
    }
)


def components(area: Area, without: PointName | None = None) -> int:
    """Count strongly connected parts of the lanes, perhaps with one point closed."""
    names = [p.name for p in area.points if p.name != without]
    index = {name: i for i, name in enumerate(names)}
    ways = [(index[p.start], index[p.end]) for p in area.paths if without not in (p.start, p.end)]
    rows, columns = np.array(ways).T
    graph = csr_matrix((np.ones(len(ways)), (rows, columns)), shape=(len(names), len(names)))
    return int(connected_components(graph, directed=True, connection="strong")[0])


@given(size=sizes)
@settings(max_examples=30, deadline=None)
def test_every_place_is_reachable_from_every_other(size: dict[str, int]) -> None:
    made = generate(**size)
    check_references(made)
    assert components(made.areas[0]) == 1


@given(size=sizes)
@settings(max_examples=15, deadline=None)
def test_points_are_clear_of_each_others_rotation_discs(size: dict[str, int]) -> None:
    points = np.array([(p.x_m, p.y_m) for p in generate(**size).areas[0].points])
    apart = np.hypot(*(points[:, None, :] - points[None, :, :]).transpose(2, 0, 1))
    np.fill_diagonal(apart, np.inf)
    assert apart.min() >= 1.4 - 1e-9


def without_spurs(area: Area) -> Area:
    """Take the parking and charging places away: their spurs are dead ends on purpose."""
    kept = tuple(p for p in area.points if p.kind not in (PointKind.PARKING, PointKind.CHARGING))
    names = {p.name for p in kept}
    paths = tuple(p for p in area.paths if p.start in names and p.end in names)
    return Area(id=0, name="", map_name="", map_digest="", points=kept, paths=paths, bins=())


@pytest.mark.parametrize(("aisles", "bays", "blocks", "robots"), [(2, 1, 1, 30), (5, 4, 2, 12)])
def test_no_single_point_cuts_the_lanes_in_two(
    aisles: int, bays: int, blocks: int, robots: int
) -> None:
    made = generate(aisles=aisles, bays=bays, blocks=blocks, robots=robots, seed=3)
    lanes = without_spurs(made.areas[0])
    for point in lanes.points:
        assert components(lanes, without=point.name) == 1, point.name


@given(size=sizes)
@settings(max_examples=30, deadline=None)
def test_there_is_a_parking_place_for_every_robot(size: dict[str, int]) -> None:
    made = generate(**size)
    kinds = [p.kind for p in made.areas[0].points]
    assert kinds.count(PointKind.PARKING) > size["robots"] == len(made.robots)
    assert kinds.count(PointKind.CHARGING) >= 2
    assert len(made.areas[0].bins) >= 2 * size["aisles"] * size["bays"] * size["blocks"]


@given(size=sizes)
@settings(max_examples=10, deadline=None)
def test_the_same_seed_draws_the_same_warehouse(size: dict[str, int]) -> None:
    assert write_scene(generate(**size)) == write_scene(generate(**size))


@pytest.mark.parametrize("robots", [3, 20, 50, 100])
def test_a_fleet_occupies_a_small_share_of_the_stops(robots: int) -> None:
    made = for_robots(robots, seed=1)
    assert len(made.robots) == robots
    assert robots / len(made.areas[0].points) < 0.13


def test_all_lanes_are_two_way() -> None:
    area = for_robots(20, seed=1).areas[0]
    keys = [(p.start, p.end) for p in area.paths]
    assert len(keys) == len(set(keys))
    assert {(b, a) for a, b in keys} == set(keys)


def test_lanes_are_short_enough_to_follow_each_other_on() -> None:
    made: SceneFile = for_robots(50, seed=1)
    points = {p.name: p for p in made.areas[0].points}
    for lane in made.areas[0].paths:
        a, b = points[lane.start], points[lane.end]
        assert 1.3 < hypot(a.x_m - b.x_m, a.y_m - b.y_m) < 2.1


@pytest.mark.parametrize(
    ("size", "word"), [({"aisles": 1}, "aisles"), ({"bays": 0}, "bays"), ({"stations": 9}, "stat")]
)
def test_an_impossible_size_is_refused_by_name(size: dict[str, int], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        generate(**{"aisles": 4, "bays": 3, "robots": 2, "seed": 0, **size})
