import msgspec
import pytest

from commands.rejected import Reason
from commands.scene_config import ConfigureScene
from commands.scenes import ImportScene, scene_digest
from ledger.events import RobotAdded, SceneConfigured, SceneImported, SceneMapReplaced
from ledger.ids import SceneId
from ledger.scene import Group, SceneFile
from ledger.scene_config import ChargingConfig, ChargingLevels, SceneConfig
from tests.commands.site import R1, SCENE, opened
from tests.scenario import ask, given
from tests.strategies import grid

NEW = SceneId("ABCDEF0123456789ABCDEF01")
FILE = grid(robots=2)

replace = msgspec.structs.replace


def take(file: SceneFile, scene: SceneId = NEW) -> object:
    return ask(ImportScene, scene=scene, digest=scene_digest(file), file=file)


def imported(file: SceneFile = FILE) -> tuple[object, ...]:
    scene = SceneImported(
        scene=NEW,
        name=file.name,
        digest=scene_digest(file),
        areas=file.areas,
        groups=file.groups,
        config=file.config,
    )
    return (scene, *(RobotAdded(scene=NEW, config=config) for config in file.robots))


def test_a_new_file_is_a_new_scene_with_its_robots() -> None:
    outcome = given().when(take(FILE))
    outcome.then(*imported())
    assert outcome.decision.made == NEW


def test_the_same_content_is_the_same_scene() -> None:
    outcome = given(*imported()).when(take(FILE, SceneId("0" * 24)))
    outcome.nothing()
    assert outcome.decision.made == NEW


def test_the_digest_is_of_the_content_not_of_its_layout() -> None:
    text = msgspec.json.format(msgspec.json.encode(FILE), indent=4)
    assert scene_digest(msgspec.json.decode(text, type=SceneFile)) == scene_digest(FILE)
    assert scene_digest(replace(FILE, name="x")) != scene_digest(FILE)


def test_a_changed_file_replaces_the_map_and_adds_new_robots() -> None:
    changed = grid(columns=5, robots=3)
    replaced = SceneMapReplaced(
        scene=NEW, digest=scene_digest(changed), areas=changed.areas, groups=changed.groups
    )
    configured = SceneConfigured(scene=NEW, config=SceneConfig(parking_paused=True))
    outcome = given(*imported(), configured).when(take(changed, SceneId("0" * 24)))
    fleet = outcome.then(replaced, RobotAdded(scene=NEW, config=changed.robots[2]))
    assert outcome.decision.made == NEW
    assert fleet.scenes[NEW].config.parking_paused


def test_the_group_of_a_robot_cannot_vanish() -> None:
    changed = replace(FILE, groups=(Group(id=5, name="other"),), robots=())
    given(*imported()).when(take(changed)).rejected(Reason.GROUP_UNKNOWN, "R1")


def test_a_file_with_a_bad_robot_is_not_taken() -> None:
    twice = replace(FILE, robots=(FILE.robots[0], FILE.robots[0]))
    given().when(take(twice)).rejected(Reason.ROBOT_NAME_TAKEN)
    stray = replace(FILE, groups=(Group(id=9, name="g"),))
    given().when(take(stray)).rejected(Reason.GROUP_UNKNOWN)
