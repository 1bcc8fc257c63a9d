import msgspec

from commands.rejected import Reason
from commands.scene_life import CreateScene
from commands.scenes import ImportScene, scene_digest
from ledger.events import (
    AnyEvent,
    OrderAssigned,
    OrderCancelled,
    OrderCreated,
    RobotAdded,
    RobotConnected,
    SceneConfigured,
    SceneImported,
    SceneMapReplaced,
    SceneRemoved,
    SceneRenamed,
    StepFinished,
    StepStarted,
)
from ledger.ids import SceneId
from ledger.scene import Group, SceneFile
from ledger.scene_config import ChargingConfig, ChargingLevels, SceneConfig
from ledger.state import OrderKind, StepTask
from tests.commands.site import ORDER, R1
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


def order(where: str, arguments: str | None = None, **fields: object) -> OrderCreated:
    step = StepTask(location=where, arguments=arguments)
    return OrderCreated(scene=NEW, order=ORDER, tasks=(step,), sealed=True, **fields)


def without(bin_: str) -> SceneFile:
    area = FILE.areas[0]
    bins = tuple(b for b in area.bins if b.name != bin_)
    return replace(FILE, areas=(replace(area, bins=bins),))


def test_a_place_where_an_order_is_still_to_go_cannot_vanish() -> None:
    lacking = take(without("B2"))
    given(*imported(), order("B2")).when(lacking).rejected(Reason.LOCATION_IN_USE, ORDER, "B2")
    assert len(given(*imported(), order("B1")).when(lacking).decision.events) == 1
    keyed = OrderCreated(scene=NEW, order=ORDER, key_locations=("B2",))
    given(*imported(), keyed).when(lacking).rejected(Reason.LOCATION_IN_USE, ORDER, "B2")
    closed = replace(FILE, areas=(replace(FILE.areas[0], disabled=True),))
    given(*imported(), order("B1")).when(take(closed)).rejected(Reason.LOCATION_IN_USE, "B1")
    area = FILE.areas[0]
    bare = replace(area, bins=tuple(replace(b, tasks=()) for b in area.bins))
    wants = order("B1", '{"binTask": "load"}')
    given(*imported(), wants).when(take(replace(FILE, areas=(bare,)))).rejected(
        Reason.LOCATION_IN_USE, ORDER, "B1", "load"
    )


def test_a_place_where_an_order_has_been_may_vanish() -> None:
    tasks = (StepTask(location="B2"), StepTask(location="B1"))
    begun: tuple[AnyEvent, ...] = (
        *imported(),
        OrderCreated(scene=NEW, order=ORDER, tasks=tasks, key_locations=("B2", "B1")),
        RobotConnected(scene=NEW, robot=R1),
        OrderAssigned(scene=NEW, order=ORDER, robot=R1, bin=0, cost_s=1.0),
        StepStarted(scene=NEW, order=ORDER, step=0, robot=R1),
        StepFinished(scene=NEW, order=ORDER, step=0, robot=R1),
    )
    assert len(given(*begun).when(take(without("B2"))).decision.events) == 1
    given(*begun).when(take(without("B1"))).rejected(Reason.LOCATION_IN_USE, "B1")


def test_orders_of_the_systems_own_end_with_their_place() -> None:
    outcome = given(*imported(), order("B2", kind=OrderKind.PARKING)).when(take(without("B2")))
    assert outcome.decision.events[0] == OrderCancelled(scene=NEW, order=ORDER)
    assert isinstance(outcome.decision.events[1], SceneMapReplaced)


def test_the_file_of_a_removed_scene_makes_a_new_one() -> None:
    second = SceneId("0" * 24)
    outcome = given(*imported(), SceneRemoved(scene=NEW)).when(take(FILE, second))
    assert outcome.decision.made == second
    assert [e.scene for e in outcome.decision.events] == [second] * 3


def test_the_same_content_is_the_same_scene_whatever_its_name_is_by_now() -> None:
    renamed = SceneRenamed(scene=NEW, name="hall", display_order=0)
    outcome = given(*imported(), renamed).when(take(FILE, SceneId("0" * 24)))
    outcome.nothing()
    assert outcome.decision.made == NEW


def test_an_empty_scene_is_filled_with_settings_and_all_unless_it_has_its_own() -> None:
    file = replace(FILE, config=SceneConfig(parking_paused=True))
    made = given().when(ask(CreateScene, scene=NEW, name=file.name)).decision.events
    filled = given(*made).when(take(file, SceneId("0" * 24)))
    assert filled.decision.made == NEW
    assert SceneConfigured(scene=NEW, config=file.config) in filled.decision.events
    own = SceneConfigured(scene=NEW, config=SceneConfig(charging_paused=True))
    kept = given(*made, own).when(take(file, SceneId("0" * 24)))
    assert not any(isinstance(e, SceneConfigured) for e in kept.decision.events)
    assert len(kept.decision.events) == 3


def test_a_file_with_levels_by_group_has_a_digest() -> None:
    levels = {g: ChargingLevels(idle_s=g) for g in (0, 1)}
    other = dict(reversed(levels.items()))
    files = [
        replace(FILE, config=SceneConfig(charging=ChargingConfig(by_group=groups)))
        for groups in (levels, other)
    ]
    assert scene_digest(files[0]) == scene_digest(files[1]) != scene_digest(FILE)
