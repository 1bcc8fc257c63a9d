"""Which points of a map lie in single-lane corridors."""

from itertools import pairwise

from ledger.ids import PointName, SceneId
from ledger.scene import Area, Path, Point, Scene
from scheduler.corridors import find_corridors


def scene(*lanes: str, one_way: tuple[str, ...] = ()) -> Scene:
    """Make a map of chains of one-letter points."""
    names = sorted({name for lane in (*lanes, *one_way) for name in lane})
    points = tuple(Point(name=PointName(n), x_m=2.0 * k, y_m=0.0) for k, n in enumerate(names))
    there = [
        Path(start=PointName(a), end=PointName(b))
        for lane in (*lanes, *one_way)
        for a, b in pairwise(lane)
    ]
    back = [Path(start=PointName(b), end=PointName(a)) for lane in lanes for a, b in pairwise(lane)]
    area = Area(
        id=1, name="a", map_name="m", map_digest="", points=points, paths=tuple(there + back)
    )
    return Scene(id=SceneId("s"), name="s", digest="", areas=(area,), groups=())


def test_an_aisle_between_two_lanes_is_a_corridor_and_its_mouths_are_not() -> None:
    found = find_corridors(scene("abcd", "cmnod", "cx", "dy"))
    assert {p for p in found if found[p].name == "m"} == {"m", "n", "o"}
    assert found[PointName("m")].orders_max == 2
    assert not {"c", "d"} & found.keys()


def test_short_stubs_and_one_way_roads_are_none() -> None:
    assert find_corridors(scene("ab", one_way=("bcdefa",))) == {}


def test_a_long_corridor_takes_more_orders() -> None:
    found = find_corridors(scene("abcdefghijklmnopqrstuvwxyz"))
    assert {corridor.orders_max for corridor in found.values()} == {5}


def test_a_dead_end_takes_one_order() -> None:
    """A second one, if it leads deeper, waits in everybody's way until the first is out."""
    found = find_corridors(scene("cdefghijk", "acb"))
    assert {point: corridor.orders_max for point, corridor in found.items()} == dict.fromkeys(
        map(PointName, "defghijk"), 1
    )
