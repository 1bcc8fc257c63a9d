"""Reserved ground: each refusal of the specification, and what asking and giving back lead to."""

import msgspec
import pytest
import shapely
from hypothesis import given as given_any
from hypothesis import settings
from hypothesis import strategies as st

from commands.decide import decide
from commands.rejected import Reason, Rejected
from commands.resource_target import Target
from commands.resources import (
    GRANT_MS_MAX,
    LapseMapResources,
    ReleaseAllMapResources,
    ReleaseMapResources,
    ReleaseOwnedMapResources,
    has_all,
)
from ledger.events import (
    MapResourcesAsked,
    SceneDisabled,
)
from ledger.ids import UnitId
from ledger.proposals import GrantMapResources
from ledger.state import Fleet, MapUnit
from tests.commands.reserving import (
    OTHER,
    SQUARE,
    asked,
    granted,
    released,
    reserve,
    scene,
    unit,
)
from tests.commands.site import SCENE, opened
from tests.scenario import STORY_MS, ask, given, happened

# -- the seventeen


@pytest.mark.parametrize("owner", ["", "  "])
def test_1_the_owner_must_not_be_blank(owner):
    outcome = given(*opened()).when(reserve(unit(owner=owner)))
    outcome.rejected(Reason.RESOURCE_OWNER_BLANK, "owner must not be empty")


def test_2_there_must_be_units():
    given(*opened()).when(reserve()).rejected(Reason.RESOURCE_UNITS_EMPTY, "must not be empty")


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (unit("u1", "WMS"), unit("u2", "MES")),
        (unit("u1", target=Target(scene_id=SCENE)), unit("u2", target=Target(scene_id=OTHER))),
        (
            unit("u1", target=Target(scene_id=OTHER, area_id=1)),
            unit("u2", target=Target(scene_id=OTHER, area_name="loft")),
        ),
    ],
)
def test_3_all_units_are_of_one_owner_and_one_area(first, second):
    other = scene(OTHER, "other", areas=((1, "hall", False), (2, "loft", False)))
    fixed = msgspec.structs.replace(first, target=first.target)
    if first.owner != second.owner:
        given(*opened()).when(reserve(fixed, second)).rejected(Reason.RESOURCE_UNITS_MIXED)
        return
    if second.target.area_id is None and second.target.area_name is None:
        other = scene(OTHER, "other")
    outcome = given(*opened(), other).when(reserve(fixed, second))
    outcome.rejected(Reason.RESOURCE_UNITS_MIXED, "same area of the same scene")


def test_one_area_may_be_named_in_several_ways():
    targets = (Target(), Target(scene_id=SCENE), Target(scene_name="site", area_name="hall"))
    units = [unit(f"u{n}", target=target) for n, target in enumerate(targets)]
    fleet = given(*opened()).when(reserve(*units)).fleet
    assert decide(fleet, reserve(*units)).events[0].units[2].area == 1


@pytest.mark.parametrize(
    "fields", [{"points": ("AP110", "AP1")}, {"paths": ("AP110->AP125", "AP110->AP2483")}]
)
def test_16_points_and_paths_must_be_there(fields):
    outcome = given(*opened()).when(reserve(unit(), unit("u2", **fields)))
    words = f"scene id={SCENE}, scene name=site, area id=1, area name=hall"
    outcome.rejected(Reason.RESOURCE_PLACE_UNKNOWN, "do not exist in the target area", words)


@pytest.mark.parametrize(
    ("id_", "fields"),
    [
        ("u1", {"points": ("AP2483",)}),  # the same id
        ("u2", {"points": ("AP110",)}),  # the same ground
        ("u2", {"paths": ("AP110->AP125",)}),
        ("u2", {"zones": (((-0.01, -1.0), (0.01, -1.0), (0.01, 1.0), (-0.01, 1.0)),)}),
    ],
)
def test_17_what_somebody_else_holds_is_not_to_be_had(id_, fields):
    words = f"the resource applied for (unitId={id_}) is already held by owner=AMB-06"
    for held in ((), (granted("u1"),)):
        outcome = given(*opened(), asked(owner="AMB-06"), *held).when(reserve(unit(id_, **fields)))
        outcome.rejected(Reason.RESOURCE_HELD, words)


# -- what is refused beyond these


def test_a_unit_says_what_it_wants():
    given(*opened()).when(reserve(unit(points=()))).rejected(Reason.RESOURCE_UNIT_EMPTY, "u1")
    given(*opened()).when(reserve(unit(" "))).rejected(Reason.FIELD_INVALID, "units.0.unitId")


@pytest.mark.parametrize(
    "zone",
    [
        ((0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0)),  # crosses itself
        ((0.0, 0.0), (1.0, 0.0), (2.0, 0.0)),  # a line
        ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0)),
    ],
)
def test_a_zone_is_a_polygon(zone):
    outcome = given(*opened()).when(reserve(unit(zones=(SQUARE, zone))))
    outcome.rejected(Reason.RESOURCE_ZONE_INVALID, "units.0.spatialZones.1")


def test_one_id_stands_for_one_content_until_it_is_released():
    before = (*opened(), asked())
    given(*before).when(reserve(unit(points=("AP125",)))).rejected(Reason.RESOURCE_UNIT_CHANGED)
    twice = reserve(unit(), unit(points=("AP125",)))
    given(*opened()).when(twice).rejected(Reason.RESOURCE_UNIT_CHANGED, "release it first")
    elsewhere = reserve(unit(target=Target(scene_id=OTHER)))
    given(*before, scene(OTHER, "o")).when(elsewhere).rejected(Reason.RESOURCE_UNIT_CHANGED)
    changed = MapUnit(id=UnitId("u1"), owner="WMS", area=1, points=("AP125",))
    again = given(*before, released("u1")).when(reserve(unit(points=("AP125",))))
    again.then(MapResourcesAsked(scene=SCENE, units=(changed,)))


def test_too_many_shapes_are_refused_before_they_cost_anything():
    units = [unit(f"u{n}", points=("AP110",) * 1000) for n in range(6)]
    given(*opened()).when(reserve(*units)).rejected(Reason.TOO_MANY)


def test_all_or_nothing():
    outcome = given(*opened(), asked(owner="MES")).when(
        reserve(unit("u2", points=("PP1",)), unit("u3", points=("AP110",)))
    )
    outcome.rejected(Reason.RESOURCE_HELD, "u3")


# -- asking, and asking again


def test_ground_is_asked_for_as_it_was_named():
    command = reserve(
        unit(reason="crane", points=("AP110",), paths=("AP110->AP125",), zones=(SQUARE,))
    )
    made = MapUnit(
        id=UnitId("u1"),
        owner="WMS",
        reason="crane",
        area=1,
        points=("AP110",),
        paths=("AP110->AP125",),
        zones=(SQUARE,),
    )
    fleet = given(*opened()).when(command).then(MapResourcesAsked(scene=SCENE, units=(made,)))
    assert not fleet.claims[UnitId("u1")].granted
    assert not has_all(fleet, "WMS", (UnitId("u1"),))


def test_asking_again_for_the_same_is_fine_and_new_units_are_added():
    before = (*opened(), asked(), granted("u1"))
    given(*before).when(reserve(unit())).nothing()
    given(*before).when(reserve(unit(reason="another word"))).nothing()
    more = given(*before).when(reserve(unit(), unit("u2", points=("PP1",))))
    more.then(asked("u2", points=("PP1",)))
    given(*opened()).when(reserve(unit(), unit())).then(asked())


def test_an_owner_may_reserve_the_same_ground_twice_and_what_touches_anothers():
    before = (*opened(), asked(zones=(SQUARE,)))
    given(*before).when(reserve(unit("u2", zones=(SQUARE,)))).then(asked("u2", zones=(SQUARE,)))
    beside = ((1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0))
    given(*before).when(reserve(unit("u2", "MES", zones=(beside,)))).then(
        asked("u2", "MES", zones=(beside,))
    )


def test_other_areas_have_ground_of_their_own():
    two = scene(areas=((1, "hall", False), (2, "loft", False)))
    outcome = given(two, asked()).when(reserve(unit("u2", "MES", target=Target(area_id=2))))
    outcome.then(asked("u2", "MES", area=2))


# -- granted, lapsed


def grant(*ids, scene=SCENE):
    return GrantMapResources(scene=scene, units=tuple(UnitId(id_) for id_ in ids))


def test_traffic_says_what_it_has_cleared():
    fleet = given(*opened(), asked()).when(grant("u1")).then(granted("u1"))
    assert has_all(fleet, "WMS", (UnitId("u1"),))
    assert not has_all(fleet, "MES", (UnitId("u1"),))


def test_what_is_not_waited_for_any_more_is_not_granted():
    given(*opened()).when(grant("u1")).rejected(Reason.RESOURCE_NOT_PENDING)
    again = given(*opened(), asked(), granted("u1"))
    again.when(grant("u1")).rejected(Reason.RESOURCE_NOT_PENDING)
    given(*opened(), asked()).when(grant("u1", "u1", "u2")).then(granted("u1"))
    given(*opened(), asked()).when(grant("u1", scene=OTHER)).rejected(Reason.RESOURCE_NOT_PENDING)


def test_a_grant_that_comes_too_late_gives_the_ground_back():
    long_ago = msgspec.structs.replace(asked(), at_ms=STORY_MS - GRANT_MS_MAX - 1)
    just = msgspec.structs.replace(asked("u2", points=("PP1",)), at_ms=STORY_MS - GRANT_MS_MAX)
    before = [msgspec.structs.replace(event, at_ms=1) for event in opened()]
    outcome = given(*before, long_ago, just).when(grant("u1", "u2"))
    outcome.then(granted("u2"), released("u1", lapsed=True))


def test_only_what_was_not_granted_lapses():
    before = (*opened(), asked(), asked("u2", points=("PP1",)), asked("u3", points=("CP1",)))
    before = (*before, granted("u1"))
    ids = (UnitId("u1"), UnitId("u2"), UnitId("u9"))
    lapse = ask(LapseMapResources, owner="WMS", units=ids)
    given(*before).when(lapse).then(released("u2", lapsed=True))
    given(*before).when(ask(LapseMapResources, owner="MES", units=ids)).nothing()
    given(*before).when(ask(LapseMapResources)).then(released("u2", "u3", lapsed=True))
    given(*before).when(ask(LapseMapResources, owner="WMS")).nothing()


# -- giving back

HELD = (
    *opened(),
    scene(OTHER, "other", areas=((1, "hall", False), (2, "loft", False))),
    asked("a", "WMS"),
    asked("b", "MES", points=("PP1",)),
    asked("c", "WMS", scene=OTHER, area=1),
    asked("d", "WMS", scene=OTHER, area=2),
    granted("a"),
    granted("c", scene=OTHER),
)


def test_units_are_released_by_their_ids_whoever_asks():
    release = ask(ReleaseMapResources, units=("a", "b", "d", "unknown", "a"))
    given(*HELD).when(release).then(released("a", "b"), released("d", scene=OTHER))
    given(*HELD).when(ask(ReleaseMapResources, units=("unknown",))).nothing()


@pytest.mark.parametrize(
    ("target", "here", "there"),
    [
        (Target(), ("a",), ("c", "d")),
        (Target(scene_id=OTHER), (), ("c", "d")),
        (Target(scene_name="site"), ("a",), ()),
        (Target(scene_id=OTHER, scene_name="site"), (), ("c", "d")),
        (Target(scene_name="other", area_id=2, area_name="hall"), (), ("d",)),
        (Target(scene_name="other", area_name="hall"), (), ("c",)),
        (Target(area_id=2), (), ("d",)),
        (Target(area_name="hall"), ("a",), ("c",)),
    ],
)
def test_what_an_owner_holds_is_released_everywhere_or_where_it_says(target, here, there):
    events = [released(*here)] if here else []
    events += [released(*there, scene=OTHER)] if there else []
    given(*HELD).when(ask(ReleaseOwnedMapResources, owner="WMS", target=target)).then(*events)


def test_releasing_works_in_a_disabled_scene_too():
    release = ask(ReleaseOwnedMapResources, owner="WMS", target=Target(scene_id=SCENE))
    given(*HELD, SceneDisabled(scene=SCENE)).when(release).then(released("a"))


@pytest.mark.parametrize(
    ("target", "reason"),
    [
        (Target(scene_id="x"), Reason.RESOURCE_SCENE_ID_UNKNOWN),
        (Target(scene_name="x"), Reason.RESOURCE_SCENE_NAME_UNKNOWN),
        (Target(scene_id=SCENE, area_id=7), Reason.RESOURCE_AREA_ID_UNKNOWN),
        (Target(scene_id=SCENE, area_name="x"), Reason.RESOURCE_AREA_NAME_UNKNOWN),
    ],
)
def test_a_place_that_is_not_there_is_a_mistake_in_releasing_too(target, reason):
    given(*HELD).when(ask(ReleaseOwnedMapResources, owner="WMS", target=target)).rejected(reason)


def test_a_blank_owner_releases_nothing():
    release = ask(ReleaseOwnedMapResources, owner=" ")
    given(*HELD).when(release).rejected(Reason.RESOURCE_OWNER_BLANK)


def test_everything_is_released_at_once():
    everything = (released("a", "b"), released("c", "d", scene=OTHER))
    fleet = given(*HELD).when(ask(ReleaseAllMapResources)).then(*everything)
    assert not fleet.claims
    given(*opened()).when(ask(ReleaseAllMapResources)).nothing()


# -- the law

PLACES = {"AP110": 0.0, "AP125": 1.0, "AP2483": 2.0, "PP1": 3.0, "CP1": 4.0}


def polygons(unit_: MapUnit) -> shapely.Geometry:
    """The ground of a unit on the straight line of points, drawn independently."""
    grounds = [shapely.box(PLACES[p] - 0.05, -0.05, PLACES[p] + 0.05, 0.05) for p in unit_.points]
    for path in unit_.paths:
        ends = [(PLACES[end], 0.0) for end in path.split("->")]
        grounds.append(shapely.LineString(ends).buffer(0.05))
    return shapely.union_all([*grounds, *(shapely.Polygon(zone) for zone in unit_.zones)])


coordinates = st.floats(-1, 5, allow_nan=False).map(lambda v: round(v, 2))
zones = st.tuples(coordinates, coordinates, st.floats(0.05, 2), st.floats(0.05, 2)).map(
    lambda z: ((z[0], z[1]), (z[0] + z[2], z[1]), (z[0] + z[2], z[1] + z[3]), (z[0], z[1] + z[3]))
)
units = st.builds(
    unit,
    st.sampled_from(["u1", "u2", "u3", "u4", "u5"]),
    st.sampled_from(["WMS", "MES"]),
    points=st.lists(st.sampled_from(sorted(PLACES)), max_size=2).map(tuple),
    paths=st.lists(st.sampled_from(["AP110->AP125", "PP1->AP2483"]), max_size=1).map(tuple),
    zones=st.lists(zones, max_size=1).map(tuple),
)
moves = st.one_of(
    st.lists(units, min_size=1, max_size=2).map(lambda some: reserve(*some)),
    st.lists(st.sampled_from(["u1", "u2", "u3"]), max_size=2).map(
        lambda ids: ask(ReleaseMapResources, units=tuple(ids))
    ),
)


@settings(max_examples=60, deadline=None)
@given_any(st.lists(moves, max_size=12))
def test_ground_of_different_owners_never_overlaps(commands):
    fleet: Fleet = happened(opened())
    for command in commands:
        try:
            happened(decide(fleet, command).events, fleet)
        except Rejected as no:
            assert no.message
        held = [claim.unit for claim in fleet.claims.values()]
        for k, one in enumerate(held):
            for other in held[:k]:
                if one.owner != other.owner:
                    assert polygons(one).intersection(polygons(other)).area < 1e-6
