"""Driving distances, against a search of a few lines."""

from math import hypot, isclose, pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ledger.ids import PointName
from ledger.scene import Area, Path, Point
from projections.distances import Network
from tests.strategies import grid


def area(points: dict[str, tuple[float, float]], *paths: Path) -> Area:
    made = tuple(Point(name=PointName(n), x_m=x, y_m=y) for n, (x, y) in points.items())
    return Area(id=0, name="a", map_name="a", map_digest="", points=made, paths=paths)


def path(start: str, end: str, *controls: tuple[float, float]) -> Path:
    return Path(start=PointName(start), end=PointName(end), controls=controls)


LANE = area({"A": (0, 0), "B": (10, 0), "C": (10, 5)}, path("A", "B"), path("B", "C"))


@st.composite
def areas(draw: st.DrawFn) -> Area:
    size = draw(st.integers(1, 7))
    xs = st.integers(-9, 9)
    points = {f"P{n}": (float(draw(xs)), float(draw(xs))) for n in range(size)}
    pairs = st.tuples(st.sampled_from(sorted(points)), st.sampled_from(sorted(points)))
    ways = draw(st.sets(pairs.filter(lambda p: p[0] != p[1]), max_size=20)) if size > 1 else set()
    return area(points, *(path(a, b) for a, b in sorted(ways)))


@given(areas())
def test_no_way_is_shorter_and_every_way_is_found(place: Area) -> None:
    at = {p.name: (p.x_m, p.y_m) for p in place.points}
    far = {(a, b): 0.0 if a == b else float("inf") for a in at for b in at}
    for p in place.paths:
        (ax, ay), (bx, by) = at[p.start], at[p.end]
        far[p.start, p.end] = min(far[p.start, p.end], hypot(bx - ax, by - ay))
    for k in at:  # Floyd and Warshall
        for a in at:
            for b in at:
                far[a, b] = min(far[a, b], far[a, k] + far[k, b])
    network = Network(place)
    for a in at:
        for b, found in zip(at, network.distances_m({a: 0.0}, list(at)), strict=True):
            if found is None:
                assert far[a, b] == float("inf")
            else:
                assert isclose(found, far[a, b], abs_tol=1e-4)


def test_what_is_left_of_the_path_it_is_on_counts() -> None:
    network = Network(LANE)
    starts = network.starts(4.0, 0.2, 0.5)
    assert starts == {"B": pytest.approx(6.0)}
    there = [PointName(n) for n in "ABC"]
    assert network.distances_m(starts, there) == [None, pytest.approx(6), pytest.approx(11)]


def test_on_a_two_way_lane_it_may_go_either_way() -> None:
    both = area({"A": (0, 0), "B": (10, 0)}, path("A", "B"), path("B", "A"))
    starts = Network(both).starts(4.0, 0.0, 0.5)
    assert starts == {"A": pytest.approx(4), "B": pytest.approx(6)}


def test_off_all_paths_it_is_nowhere() -> None:
    network = Network(LANE)
    assert network.starts(4.0, 0.6, 0.5) == {}
    assert network.distances_m({}, [PointName("A")]) == [None]


def test_a_bend_is_as_long_as_it_is() -> None:
    c = 4 / 3 * (2**0.5 - 1)  # the best cubic for a quarter circle
    bend = area({"A": (1, 0), "B": (0, 1)}, path("A", "B", (1, c), (c, 1)))
    network = Network(bend)
    (found,) = network.distances_m({PointName("A"): 0.0}, [PointName("B")])
    assert found == pytest.approx(pi / 2, abs=1e-3)
    (left,) = network.starts(2**-0.5, 2**-0.5, 0.1).values()
    assert left == pytest.approx(pi / 4, abs=1e-3)


def test_what_a_door_closes_is_not_driven() -> None:
    for closed in ("A->B", "B"):
        network = Network(LANE, {closed})
        assert network.distances_m({PointName("A"): 0.0}, [PointName("C")]) == [None]
    network = Network(LANE, {"A"})  # who stands in it may leave it
    assert network.distances_m({PointName("A"): 0.0}, [PointName("C")]) == [pytest.approx(15)]


def test_without_paths_there_is_only_here() -> None:
    network = Network(area({"A": (0, 0), "B": (1, 0)}))
    assert network.starts(0.0, 0.0, 1.0) == {}
    there = [PointName("A"), PointName("B"), PointName("X")]
    assert network.distances_m({PointName("A"): 0.0}, there) == [0.0, None, None]


def test_on_a_grid_distances_are_those_of_its_streets() -> None:
    hall = grid(columns=4, rows=3).areas[0]
    (found,) = Network(hall).distances_m({PointName("AP1"): 0.0}, [PointName("LM12")])
    assert found == pytest.approx(3 * 3.0 + 2 * 3.0)
