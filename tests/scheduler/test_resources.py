"""Reservations from the ledger to traffic and back, on a small site."""

import msgspec
import pytest
import shapely

from ledger.events import (
    MapResourcesAsked,
    MapResourcesReleased,
    OrderAssigned,
    SceneMapReplaced,
)
from ledger.ids import PathKey, PointName, UnitId
from ledger.proposals import GrantMapResources
from ledger.scene import Path
from ledger.state import MapUnit
from scheduler.dispatch.reasons import Why
from scheduler.resources import Ground
from tests.scheduler.small_shift import Shift
from tests.scheduler.small_site import SCENE, added, area, carry, imported


def shift(**robots: float) -> Shift:
    work = Shift(imported(), *(added(name) for name in robots))
    for name, x_m in robots.items():
        work.robots.place(name, x_m)
    return work


def asked(*ids: str, owner: str = "WMS", at: str = "W9", in_area: int = 1) -> MapResourcesAsked:
    units = tuple(MapUnit(id=UnitId(id_), owner=owner, area=in_area, points=(at,)) for id_ in ids)
    return MapResourcesAsked(scene=SCENE, units=units)


def is_granted(work: Shift, id_: str) -> bool:
    claim = work.fleet.claims.get(UnitId(id_))
    return claim is not None and claim.granted


def test_free_ground_is_granted() -> None:
    work = shift(A=0.0)
    work.run(0.5)
    work.happen(asked("u1", "u2"))
    assert work.run(1, lambda: is_granted(work, "u1") and is_granted(work, "u2"))
    grants = [p for p in work.core.proposed if isinstance(p, GrantMapResources)]
    assert [p.units for p in grants] == [("u1", "u2")]


def test_an_application_is_granted_as_a_whole() -> None:
    work = shift(A=3.0)
    work.run(0.5)
    taken = asked("u1", at="W3").units + asked("u2", at="W9").units
    work.happen(MapResourcesAsked(scene=SCENE, units=taken))
    work.run(2)
    assert not is_granted(work, "u1") and not is_granted(work, "u2")
    work.run(0.2)
    work.happen(asked("u3", at="W11"))
    assert work.run(1, lambda: is_granted(work, "u3"))  # another application does not wait for it
    work.traffic[1].known["A"] = 0.0
    assert work.run(2, lambda: is_granted(work, "u1") and is_granted(work, "u2"))


def test_ground_that_is_given_back_is_free_again() -> None:
    work = shift(A=0.0)
    work.run(0.5)
    work.happen(asked("u1"))
    work.run(1, lambda: is_granted(work, "u1"))
    work.happen(MapResourcesReleased(scene=SCENE, units=(UnitId("u1"),)))
    work.run(0.2)
    assert not work.traffic[1].claims


def test_a_unit_that_was_given_back_and_asked_for_again_is_told_anew() -> None:
    work = shift(A=0.0)
    work.run(0.5)
    work.happen(asked("u1"))
    work.run(1, lambda: is_granted(work, "u1"))
    work.happen(MapResourcesReleased(scene=SCENE, units=(UnitId("u1"),)), asked("u1", at="W2"))
    assert work.run(1, lambda: is_granted(work, "u1"))
    ((_, ground, owned),) = work.traffic[1].claims.values()
    assert shapely.Polygon(ground[0]).covers(shapely.Point(2.0, 0.0))
    assert not owned


def test_a_new_scheduler_is_told_what_was_granted_and_what_was_not() -> None:
    work = shift(A=3.0)
    work.run(0.5)
    work.happen(asked("u1"), asked("u2", owner="MES", at="W3"))
    work.run(1, lambda: is_granted(work, "u1"))
    work.restart()
    work.run(1)
    claims = work.traffic[1].claims
    assert {id_: owned for id_, (_, _, owned) in claims.items()} == {"u1": True, "u2": False}


def test_a_new_map_is_told_too_and_ground_without_a_map_is_not_granted() -> None:
    work = shift(A=0.0)
    work.run(0.5)
    work.happen(asked("u1"), asked("u2", in_area=7))
    work.run(1)
    assert is_granted(work, "u1") and not is_granted(work, "u2")
    scene = work.fleet.scenes[SCENE]
    work.happen(SceneMapReplaced(scene=SCENE, digest="e", areas=scene.areas, groups=scene.groups))
    work.run(0.2)
    assert work.traffic[1].claims.keys() == {"u1"}


def test_an_order_into_reserved_ground_waits_for_it_to_be_given_back() -> None:
    work = shift(A=0.0)
    work.run(0.5)
    work.happen(asked("u1", at="W5"))
    work.run(1, lambda: is_granted(work, "u1"))
    work.happen(carry(1, "B5", "B9"))
    work.run(12)
    order = work.order(1)
    assert order.robot is None
    assert order.allocation_reject.robots == {"A": "GroundReserved"}
    work.happen(MapResourcesReleased(scene=SCENE, units=(UnitId("u1"),)))
    assert work.run(60, lambda: work.order(1) is None)


def test_an_order_that_is_under_way_waits_and_says_for_whom() -> None:
    work = shift(A=0.0)
    work.run(0.5)
    work.happen(carry(1, "B2", "B15"))
    assert work.run(10, lambda: bool(work.happened(OrderAssigned)))
    work.happen(asked("u1", at="W15"))
    assert work.run(60, lambda: work.order(1).done_step == 0)
    work.traffic[1].stuck.add("A")  # where the reserved ground begins

    def is_explained() -> bool:
        reject = work.order(1).execution_reject
        return reject is not None and reject.robots == {"external:WMS": "GroundReserved"}

    assert work.run(60, is_explained)
    assert work.order(1).execution_reject.code == Why.GROUND_RESERVED
    work.happen(MapResourcesReleased(scene=SCENE, units=(UnitId("u1"),)))
    work.traffic[1].stuck.clear()
    assert work.run(60, lambda: work.order(1) is None)


def test_ground_is_0_05_m_around_points_and_paths() -> None:
    there = area()
    unit = MapUnit(
        id=UnitId("u"),
        owner="WMS",
        area=1,
        points=("W3", "gone"),
        paths=("W5->W6", "gone->gone"),
        zones=(((8.0, 0.0), (9.0, 0.0), (9.0, 1.0)),),
    )
    zone, point, path = Ground(there).rings(unit)
    assert shapely.Polygon(zone).area == pytest.approx(0.5)
    assert shapely.Polygon(point).bounds == pytest.approx((2.95, -0.05, 3.05, 0.05))
    assert shapely.Polygon(path).bounds == pytest.approx((4.95, -0.05, 6.05, 0.05))


def test_the_ground_of_a_bent_path_follows_it() -> None:
    bent = Path(start=PointName("W0"), end=PointName("W2"), controls=((0.0, 2.0), (2.0, 2.0)))
    there = msgspec.structs.replace(area(), paths=(bent,))
    unit = MapUnit(id=UnitId("u"), owner="WMS", area=1, paths=(PathKey("W0->W2"),))
    (ring,) = Ground(there).rings(unit)
    ground = shapely.Polygon(ring)
    for k in range(101):
        t = k / 100
        x = 3 * (1 - t) * t**2 * 2 + t**3 * 2
        y = 3 * (1 - t) ** 2 * t * 2 + 3 * (1 - t) * t**2 * 2
        assert ground.covers(shapely.Point(x, y).buffer(0.045))
    assert ground.area < 0.5
