"""Any sequence of scene commands, against a model of a few lines."""

from collections.abc import Callable
from typing import Any

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st

from commands.decide import AnyCommand, decide
from commands.orders import CancelAllOrders, CreateOrder
from commands.rejected import Reason, Rejected
from commands.scene_config import ConfigureScene
from commands.scene_life import (
    CreateScene,
    DisableScene,
    PauseDispatch,
    RemoveScenes,
    RenameScene,
)
from commands.scenes import ImportScene, scene_digest
from ledger.events import AnyEvent
from ledger.ids import SceneId
from ledger.scene_config import SceneConfig
from ledger.state import Fleet, StepTask
from tests.scenario import ask, happened
from tests.strategies import grid

IDS = [SceneId(f"{n:024}") for n in range(4)]
NAMES = ["a", "b", "c"]
FILES = [msgspec.structs.replace(grid(columns=c), name=n) for n in NAMES for c in (2, 3)]


class Model(msgspec.Struct):
    """What a client believes of a scene."""

    name: str
    file: int | None = None
    disabled: bool = False
    paused: bool = False
    parking_paused: bool = False
    orders: int = 0
    place: int = 0


Models = dict[SceneId, Model]


def _taken(models: Models, name: str) -> bool:
    return any(m.name == name for m in models.values())


def _make(new: SceneId, models: Models, name: str) -> tuple[AnyCommand, Reason | None]:
    asked = ask(CreateScene, scene=new, name=name)
    if _taken(models, name):
        return asked, Reason.SCENE_NAME_TAKEN
    models[new] = Model(name=name)
    return asked, None


def _import(new: SceneId, models: Models, file: int) -> tuple[AnyCommand, Reason | None]:
    content = FILES[file]
    asked = ask(ImportScene, scene=new, digest=scene_digest(content), file=content)
    if any(m.file == file for m in models.values()):
        return asked, None  # the same content is the same scene
    for model in models.values():
        if model.name == content.name:
            model.file = file
            return asked, None
    models[new] = Model(name=content.name, file=file)
    return asked, None


def _rename(
    scene: SceneId, models: Models, name: str, place: int
) -> tuple[AnyCommand, Reason | None]:
    asked = ask(RenameScene, scene=scene, name=name, display_order=place)
    if scene not in models:
        return asked, Reason.SCENE_UNKNOWN
    if models[scene].name != name and _taken(models, name):
        return asked, Reason.SCENE_NAME_TAKEN
    models[scene].name, models[scene].place = name, place
    return asked, None


def _switch(
    scene: SceneId, models: Models, field: str, on: bool
) -> tuple[AnyCommand, Reason | None]:
    asked = {
        "disabled": ask(DisableScene, scene=scene, disabled=on),
        "paused": ask(PauseDispatch, scene=scene, paused=on),
        "parking_paused": ask(ConfigureScene, scene=scene, config=SceneConfig(parking_paused=on)),
    }[field]
    if scene not in models:
        return asked, Reason.SCENE_UNKNOWN
    setattr(models[scene], field, on)
    return asked, None


def _order(scene: SceneId, models: Models) -> tuple[AnyCommand, Reason | None]:
    asked = ask(CreateOrder, scene=scene, sealed=True, tasks=(StepTask(location="B1"),))
    model = models.get(scene)
    if model is None:
        return asked, Reason.SCENE_UNKNOWN
    if model.disabled:
        return asked, Reason.SCENE_DISABLED
    if model.file is None:
        return asked, Reason.LOCATION_UNKNOWN
    model.orders += 1
    return asked, None


def _cancel(scene: SceneId, models: Models) -> tuple[AnyCommand, Reason | None]:
    asked = ask(CancelAllOrders, scene=scene)
    if scene not in models:
        return asked, Reason.SCENE_UNKNOWN
    models[scene].orders = 0
    return asked, None


def _remove(scenes: list[SceneId], models: Models) -> tuple[AnyCommand, Reason | None]:
    asked = ask(RemoveScenes, scenes=tuple(scenes))
    for scene in scenes:
        if scene not in models:
            return asked, Reason.SCENE_UNKNOWN
        if models[scene].orders:
            return asked, Reason.SCENE_HAS_ORDERS
    for scene in set(scenes):
        del models[scene]
    return asked, None


scenes, names = st.sampled_from(IDS), st.sampled_from(NAMES)
STEPS: st.SearchStrategy[tuple[Callable[..., Any], tuple[Any, ...]]] = st.one_of(
    st.tuples(st.just(_make), st.tuples(names)),
    st.tuples(st.just(_import), st.tuples(st.sampled_from(range(len(FILES))))),
    st.tuples(st.just(_rename), st.tuples(scenes, names, st.integers(0, 2))),
    st.tuples(
        st.just(_switch),
        st.tuples(scenes, st.sampled_from(["disabled", "paused", "parking_paused"]), st.booleans()),
    ),
    st.tuples(st.just(_order), st.tuples(scenes)),
    st.tuples(st.just(_cancel), st.tuples(scenes)),
    st.tuples(st.just(_remove), st.tuples(st.lists(scenes, max_size=3))),
)


def _seen(fleet: Fleet) -> Models:
    live = [order.scene for order in fleet.orders.values()]
    digests = {scene_digest(file): n for n, file in enumerate(FILES)}
    return {
        s.id: Model(
            name=s.name,
            file=digests.get(s.digest),
            disabled=s.disabled,
            paused=s.dispatch_paused,
            parking_paused=s.config.parking_paused,
            orders=live.count(s.id),
            place=s.display_order,
        )
        for s in fleet.scenes.values()
        if not s.removed
    }


@settings(max_examples=150)
@given(st.lists(STEPS, max_size=30))
def test_scenes_are_what_the_commands_made_them(steps: list[Any]) -> None:
    fleet, models = Fleet(), Models()
    events: list[AnyEvent] = []
    for make, arguments in steps:
        if make in (_make, _import):  # ids are handed out once
            new = next((i for i in IDS if i not in fleet.scenes), None)
            if new is None:
                continue
            arguments = (new, models, *arguments)
        else:
            arguments = (arguments[0], models, *arguments[1:])
        asked, refusal = make(*arguments)
        try:
            decided = decide(fleet, asked).events
        except Rejected as no:
            assert no.reason is refusal, no
            continue
        assert refusal is None, refusal
        happened(decided, fleet)
        events.extend(decided)
        assert _seen(fleet) == models
        present = {s.id for s in fleet.scenes.values() if not s.removed}
        assert {robot.scene for robot in fleet.robots.values()} <= present
    assert happened(events).canonical() == fleet.canonical()
