"""Scenes made, renamed, taken out of service, paused and removed."""

import pytest

from commands.ids import next_order_id
from commands.orders import (
    CancelAllOrders,
    CancelOrder,
    CreateOrder,
    PrioritiseOrders,
    RetryOrders,
    SealOrder,
)
from commands.rejected import Reason
from commands.robots import CreateRobots
from commands.scene_life import (
    NAME_CHARS_MAX,
    CreateScene,
    DisableScene,
    PauseDispatch,
    RemoveScenes,
    RenameScene,
)
from commands.steps import AddSteps
from ledger.events import (
    OrderCancelled,
    SceneDisabled,
    SceneDispatchPaused,
    SceneDispatchResumed,
    SceneEnabled,
    SceneImported,
    SceneRemoved,
    SceneRenamed,
)
from ledger.ids import RobotName, SceneId
from ledger.proposals import AssignOrder, CreateSystemOrder, FinishStep, StartStep
from ledger.scene import Group, RobotConfig
from ledger.state import OrderKind
from tests.commands.site import ORDER, R1, SCENE, assigned, created, opened, started, task
from tests.scenario import STORY_MS, ask, given

NEW = SceneId("ABCDEF0123456789ABCDEF01")
DISABLED, PAUSED = SceneDisabled(scene=SCENE), SceneDispatchPaused(scene=SCENE)


def create(name: str = "new") -> object:
    return ask(CreateScene, scene=NEW, name=name)


def rename(name: str | None = None, place: int | None = None) -> object:
    return ask(RenameScene, scene=SCENE, name=name, display_order=place)


def remove(*scenes: SceneId) -> object:
    return ask(RemoveScenes, scenes=scenes)


def test_a_scene_is_made_empty() -> None:
    groups = (Group(id=0, name="default"),)
    made = SceneImported(scene=NEW, name="new", digest="", areas=(), groups=groups)
    outcome = given(*opened()).when(create())
    fleet = outcome.then(made)
    assert outcome.decision.made == NEW
    assert fleet.scenes[NEW].modified_ms == STORY_MS


def test_names_are_unique_among_the_scenes_that_are_there() -> None:
    given(*opened()).when(create("site")).rejected(Reason.SCENE_NAME_TAKEN, "site")
    fleet = given(*opened()).when(create()).then(*given().when(create()).decision.events)
    assert len(fleet.scenes) == 2
    second = given(*opened(), *given().when(create()).decision.events)
    second.when(rename("new")).rejected(Reason.SCENE_NAME_TAKEN, "new")
    gone = given(*opened(), SceneRemoved(scene=SCENE))
    gone.when(create("site")).then(
        SceneImported(
            scene=NEW, name="site", digest="", areas=(), groups=(Group(id=0, name="default"),)
        )
    )


@pytest.mark.parametrize("name", ["", " ", " a", "a ", "a\n", "\0", "\ud800", "x" * 201])
def test_a_name_is_one_that_can_be_shown(name: str) -> None:
    given(*opened()).when(create(name)).rejected(Reason.SCENE_NAME_INVALID, "name")
    given(*opened()).when(rename(name)).rejected(Reason.SCENE_NAME_INVALID, "name")
    assert NAME_CHARS_MAX == 200


def test_a_scene_gets_another_name_or_place() -> None:
    site = given(*opened())
    site.when(rename()).nothing()
    site.when(rename("site", 0)).nothing()
    site.when(rename(place=7)).then(SceneRenamed(scene=SCENE, name="site", display_order=7))
    fleet = (
        given(*opened())
        .when(rename("hall"))
        .then(SceneRenamed(scene=SCENE, name="hall", display_order=0))
    )
    assert (fleet.scenes[SCENE].name, fleet.scenes[SCENE].version) == ("hall", 1)


def test_out_of_service_and_back() -> None:
    off, on = (ask(DisableScene, scene=SCENE, disabled=d) for d in (True, False))
    given(*opened()).when(on).nothing()
    given(*opened()).when(off).then(DISABLED)
    given(*opened(), DISABLED).when(off).nothing()
    given(*opened(), DISABLED).when(on).then(SceneEnabled(scene=SCENE))


def test_dispatch_pauses_and_goes_on() -> None:
    pause, go_on = (ask(PauseDispatch, scene=SCENE, paused=p) for p in (True, False))
    given(*opened()).when(go_on).nothing()
    given(*opened()).when(pause).then(PAUSED)
    given(*opened(), PAUSED, DISABLED).when(go_on).then(SceneDispatchResumed(scene=SCENE))


@pytest.mark.parametrize(
    "asked",
    [
        rename("x"),
        ask(DisableScene, scene=SCENE, disabled=False),
        ask(PauseDispatch, scene=SCENE, paused=True),
        remove(SCENE),
        ask(CreateRobots, scene=SCENE, robots=()),
        ask(CancelAllOrders, scene=SCENE),
    ],
    ids=lambda asked: type(asked).__name__,
)
def test_a_removed_scene_is_unknown_to_every_command(asked: object) -> None:
    given(*opened(), SceneRemoved(scene=SCENE)).when(asked).rejected(Reason.SCENE_UNKNOWN, SCENE)


def test_a_removed_scene_takes_its_robots_along_and_keeps_its_name() -> None:
    fleet = given(*opened(R1)).when(remove(SCENE, SCENE)).then(SceneRemoved(scene=SCENE))
    assert not fleet.robots
    assert (fleet.scenes[SCENE].name, fleet.scenes[SCENE].areas) == ("site", ())


def test_a_scene_with_orders_of_clients_stays_and_so_do_the_others() -> None:
    other = given().when(create()).decision.events
    site = given(*opened(R1), created(), DISABLED, *other)
    site.when(remove(NEW, SCENE)).rejected(Reason.SCENE_HAS_ORDERS, "site", ORDER)
    site.when(remove(NEW, SceneId("x"))).rejected(Reason.SCENE_UNKNOWN, "x")
    site.when(remove(NEW)).then(SceneRemoved(scene=NEW))
    site.when(remove()).nothing()


def test_parking_and_charging_end_with_the_scene() -> None:
    site = given(*opened(R1))
    own = next_order_id(site.fleet, STORY_MS, OrderKind.PARKING)
    parking = created(own, task("PP1"), kind=OrderKind.PARKING)
    site = given(*opened(R1), parking, assigned(own))
    site.when(remove(SCENE)).then(OrderCancelled(scene=SCENE, order=own), SceneRemoved(scene=SCENE))


@pytest.mark.parametrize(
    "asked",
    [
        ask(CreateOrder, scene=SCENE, sealed=True, tasks=(task(),)),
        ask(AddSteps, order=ORDER, tasks=(task(),)),
        ask(SealOrder, order=ORDER),
        ask(PrioritiseOrders, orders=(ORDER,), priority=5),
        ask(CreateRobots, scene=SCENE, robots=(RobotConfig(name=RobotName("R9"), group=1),)),
        AssignOrder(scene=SCENE, order=ORDER, robot=R1, bin=0, cost_s=1.0),
        CreateSystemOrder(
            scene=SCENE, kind=OrderKind.PARKING, robot=R1, location="PP1", cost_s=1.0
        ),
    ],
    ids=lambda asked: type(asked).__name__,
)
def test_a_scene_out_of_service_takes_no_work(asked: object) -> None:
    order = created(ORDER, task(), sealed=False)
    given(*opened(R1), order, DISABLED).when(asked).rejected(Reason.SCENE_DISABLED, SCENE)


def test_nobody_sets_out_in_a_scene_out_of_service_but_what_was_begun_ends() -> None:
    start = StartStep(scene=SCENE, order=ORDER, step=0, robot=R1)
    given(*opened(R1), created(ORDER, task()), assigned(), DISABLED).when(start).rejected(
        Reason.SCENE_DISABLED
    )
    begun = given(*opened(R1), created(ORDER, task()), assigned(), started(), DISABLED)
    finish = FinishStep(scene=SCENE, order=ORDER, step=0, robot=R1)
    assert len(begun.when(finish).decision.events) == 2


def test_orders_of_a_scene_out_of_service_can_be_cancelled() -> None:
    site = given(*opened(R1), created(ORDER, task()), DISABLED)
    cancelled = OrderCancelled(scene=SCENE, order=ORDER)
    site.when(ask(CancelOrder, scene=SCENE, order=ORDER)).then(cancelled)
    site = given(*opened(R1), created(ORDER, task()), DISABLED)
    site.when(ask(CancelAllOrders, scene=SCENE)).then(cancelled)


def test_a_fault_in_a_scene_out_of_service_waits() -> None:
    site = given(*opened(R1), created(ORDER, task()), DISABLED)
    asked = ask(RetryOrders, orders=(ORDER,))
    outcome = site.when(asked)
    assert outcome.decision.refused[ORDER].reason is Reason.SCENE_DISABLED


def test_while_dispatch_is_paused_no_order_gets_a_robot_and_clients_go_on() -> None:
    site = given(*opened(R1), created(ORDER, task()), PAUSED)
    assign = AssignOrder(scene=SCENE, order=ORDER, robot=R1, bin=0, cost_s=1.0)
    site.when(assign).rejected(Reason.SCENE_DISPATCH_PAUSED)
    asked = ask(CreateOrder, scene=SCENE, sealed=True, tasks=(task(),))
    assert len(site.when(asked).decision.events) == 1
    begun = given(*opened(R1), created(ORDER, task()), assigned(), PAUSED)
    begun.when(StartStep(scene=SCENE, order=ORDER, step=0, robot=R1)).then(started())
