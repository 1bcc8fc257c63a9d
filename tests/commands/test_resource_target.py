"""Reserved ground: refusals 4 to 15 of the specification, about scene and area."""

import pytest

from commands.decide import decide
from commands.rejected import Reason
from commands.resource_target import Target
from ledger.events import SceneDisabled, SceneRemoved
from tests.commands.reserving import OTHER, reserve, scene, unit
from tests.commands.site import SCENE, opened
from tests.scenario import given


def test_4_the_scene_of_an_id_must_be_enabled():
    outcome = given(*opened(), SceneDisabled(scene=SCENE)).when(
        reserve(unit(target=Target(scene_id=SCENE, scene_name="nonsense")))
    )
    outcome.rejected(Reason.RESOURCE_SCENE_ID_DISABLED, f'with id "{SCENE}" is disabled')


@pytest.mark.parametrize("removed", [False, True])
def test_5_the_scene_of_an_id_must_be_there(removed):
    gone = (scene(OTHER, "gone"), SceneRemoved(scene=OTHER)) if removed else ()
    outcome = given(*opened(), *gone).when(reserve(unit(target=Target(scene_id=OTHER))))
    outcome.rejected(Reason.RESOURCE_SCENE_ID_UNKNOWN, f'no scene with id "{OTHER}"')


def test_6_the_scene_of_a_name_must_be_enabled():
    outcome = given(*opened(), SceneDisabled(scene=SCENE)).when(
        reserve(unit(target=Target(scene_name="site")))
    )
    outcome.rejected(Reason.RESOURCE_SCENE_NAME_DISABLED, 'the scene named "site" is disabled')


def test_7_the_scene_of_a_name_must_be_there():
    outcome = given(*opened()).when(reserve(unit(target=Target(scene_name="bbb"))))
    outcome.rejected(Reason.RESOURCE_SCENE_NAME_UNKNOWN, 'there is no scene named "bbb"')


@pytest.mark.parametrize("events", [(), (*opened(), SceneDisabled(scene=SCENE))])
def test_8_without_a_name_some_scene_must_be_enabled(events):
    given(*events).when(reserve(unit())).rejected(Reason.RESOURCE_NO_SCENE, "no scene is enabled")


def test_9_without_a_name_only_one_scene_may_be_enabled():
    outcome = given(*opened(), scene(OTHER, "other")).when(reserve(unit()))
    outcome.rejected(Reason.RESOURCE_SEVERAL_SCENES, "several scenes are enabled")
    also = given(*opened(), scene(OTHER, "other"), SceneDisabled(scene=OTHER))
    assert decide(also.fleet, reserve(unit())).events


HALF = scene(areas=((1, "ccc", True), (2, "loft", False)))
WHERE = f"in the target scene (ID={SCENE}, name=site)"


def test_10_the_area_of_an_id_must_be_enabled():
    outcome = given(HALF).when(reserve(unit(target=Target(area_id=1, area_name="loft"))))
    words = f"{WHERE} the area with id 1 is disabled; its name is ccc"
    outcome.rejected(Reason.RESOURCE_AREA_ID_DISABLED, words)


def test_11_the_area_of_a_name_must_be_enabled():
    outcome = given(HALF).when(reserve(unit(target=Target(area_name="ccc"))))
    words = f"{WHERE} the area named ccc is disabled"
    outcome.rejected(Reason.RESOURCE_AREA_NAME_DISABLED, words)


def test_12_the_area_of_an_id_must_be_there():
    outcome = given(HALF).when(reserve(unit(target=Target(area_id=0))))
    outcome.rejected(Reason.RESOURCE_AREA_ID_UNKNOWN, f"{WHERE} there is no area with id 0")


def test_13_the_area_of_a_name_must_be_there():
    outcome = given(HALF).when(reserve(unit(target=Target(area_name="ddd"))))
    outcome.rejected(Reason.RESOURCE_AREA_NAME_UNKNOWN, f"{WHERE} there is no area named ddd")


def test_14_without_a_name_some_area_must_be_enabled():
    outcome = given(scene(areas=((1, "ccc", True),))).when(reserve(unit()))
    outcome.rejected(Reason.RESOURCE_NO_AREA, f"{WHERE} all areas are disabled")


def test_15_without_a_name_only_one_area_may_be_enabled():
    several = scene(areas=((1, "ccc", False), (2, "loft", False)))
    outcome = given(several).when(reserve(unit()))
    outcome.rejected(Reason.RESOURCE_SEVERAL_AREAS, "has several enabled areas")
    assert decide(given(HALF).fleet, reserve(unit())).events[0].units[0].area == 2
