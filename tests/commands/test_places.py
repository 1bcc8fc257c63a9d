import msgspec
import pytest

from commands import places as module
from commands.places import SCENES_REMEMBERED_MAX, check_task, places_of
from commands.rejected import Reason, Rejected
from ledger.ids import BinName, PointName, SceneId
from ledger.scene import Bin, BinTask, Scene
from tests.commands.site import BINS, area, task


def scene(*areas: object) -> Scene:
    return Scene(id=SceneId("S"), name="s", digest="same", areas=areas, groups=())


def test_points_and_bins_are_places_and_nothing_else_is() -> None:
    places = places_of(scene(area()))
    assert "AP110" in places
    assert BINS[0] in places
    assert "AP9" not in places


def test_a_disabled_area_has_no_places() -> None:
    off = msgspec.structs.replace(area(), disabled=True)
    assert "AP110" not in places_of(scene(off))


def test_a_changed_map_is_never_answered_from_the_old_one() -> None:
    before = scene(area())
    assert places_of(before) is places_of(before)
    without = msgspec.structs.replace(area(), bins=())
    assert BINS[0] not in places_of(scene(without))
    assert BINS[0] in places_of(before)


def test_many_maps_do_not_pile_up() -> None:
    for _ in range(SCENES_REMEMBERED_MAX + 10):
        places_of(scene(area()))
    assert len(module._remembered) <= SCENES_REMEMBERED_MAX


def test_a_bin_goes_before_a_point_of_the_same_name() -> None:
    lift = BinTask(name="Lift", operation="x")
    twin = Bin(name=BinName("AP110"), point=PointName("AP110"), tasks=(lift,))
    places = places_of(scene(msgspec.structs.replace(area(), bins=(twin,))))
    check_task(places, task("AP110", arguments='{"binTask":"Lift"}'), "steps[0]")


@pytest.mark.parametrize("arguments", ["", "[]", "x", '{"binTask":null}', '{"binTask":{}}'])
def test_arguments_that_are_no_object_are_refused(arguments: str) -> None:
    with pytest.raises(Rejected) as refusal:
        check_task(places_of(scene(area())), task(arguments=arguments), "steps[0]")
    assert refusal.value.reason is Reason.ARGUMENTS_INVALID
