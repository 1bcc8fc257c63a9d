"""What each field of a robot's set-up does, from the wire into the set-up, in all five calls."""

from itertools import count
from typing import Any

import msgspec
import pytest

from ledger.events import AnyEvent, RobotDisconnected, RobotGivenUp
from ledger.ids import RobotName, SceneId, robot_key
from ledger.scene import ConnectionType, RobotConfig, RobotVendor
from ledger.state import Robot
from tests.commands.api.application import Site, site
from tests.commands.site import R1, R2, SCENE, opened

OF_SCENE = f"/api/fleet/scenes/{SCENE}/robot"
CALLS = ("create", "create/batch", "create/auto-batch", "update/config", "update/config/batch")

# field of the request -> its value, the field of the set-up, and its value
PARTS: dict[str, tuple[Any, str, Any]] = {
    "remark": ("spare", "remark", "spare"),
    "groupId": (1, "group", 1),
    "tags": (["a", "b"], "tags", ("a", "b")),
    "vendor": ("Hai", "vendor", RobotVendor.HAI),
    "selfBinNum": (3, "bin_count", 3),
    "image": ({"any": [1]}, "image", '{"any":[1]}'),
    "connectionType": ("RobotToFleet", "connection", ConnectionType.ROBOT_TO_FLEET),
    "robotIp": ("10.0.0.7", "host", "10.0.0.7"),
    "robotPortStart": (19204, "port_first", 19204),
    "ssl": (True, "tls", True),
    "gwAuthId": ("user", "gateway_user", "user"),
    "gwAuthSecret": ("sesame", "gateway_secret_kept", True),
    "simulated": (True, "simulated", True),
    "plusOne": (True, "plus_one", True),
    "disabled": (True, "disabled", True),
}


def robot_of(there: Site, name: str) -> Robot:
    return there.handler.fleet.robots[robot_key(SCENE, RobotName(name))]


NUMBERS = count(1)


@pytest.fixture(scope="module")
def there() -> Site:
    """One site for all tests that make robots of their own."""
    return site(*opened())


async def set_up(there: Site, call: str, parts: dict[str, Any]) -> Robot:
    """Set a robot up in one of the five ways: beside this nothing is said of it."""
    name = made = f"A{next(NUMBERS)}"
    if call == "create/auto-batch":
        name = f"{made}-01"
        body: Any = {"robotNamePrefix": made, "count": 1, **parts}
    elif call == "create/batch":
        body = [{"robotName": f"{name}x"}, {"robotName": name, **parts}]
    elif call == "update/config/batch":
        body = {"robotNames": [name], "config": parts}
    else:
        body = {"robotName": name, **parts}
    if call.startswith("update"):
        first = await there.post(f"{OF_SCENE}/create", {"robotName": name})
        assert first.status_code == 200, first.text
    answer = await there.post(f"{OF_SCENE}/{call}", body)
    assert answer.status_code == 200, answer.text
    return robot_of(there, name)


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("field", PARTS)
async def test_a_part_of_a_set_up_is_kept_and_changes_nothing_else(
    there: Site, call: str, field: str
) -> None:
    if (call, field) == ("create/auto-batch", "disabled"):
        return  # the catalogue has none there
    value, kept_as, kept = PARTS[field]
    if (call, field) == ("create/auto-batch", "robotIp"):
        field = "robotIpStart"
    robot = await set_up(there, call, {field: value})
    assert robot.config == RobotConfig(name=robot.name, **{kept_as: kept})
    secret = there.secrets.get((SCENE, robot.name))
    assert secret == ("sesame" if field == "gwAuthSecret" else None)


@pytest.mark.parametrize("call", CALLS)
async def test_what_is_not_said_is_as_the_specification_says(there: Site, call: str) -> None:
    config = (await set_up(there, call, {})).config
    assert (config.group, config.bin_count, config.vendor) == (0, 1, RobotVendor.SEER)
    assert not (config.disabled or config.simulated or config.tags)


@pytest.mark.parametrize("call", CALLS)
async def test_bins_are_as_many_as_loads_can_be_carried_at_once(there: Site, call: str) -> None:
    robot = await set_up(there, call, {"selfBinNum": 3, "plusOne": True})
    assert len(robot.bins) == 4


async def test_a_series_has_its_prefix_its_count_and_its_first_address() -> None:
    there = site()
    body = {"robotNamePrefix": "Fork", "count": 3, "robotIpStart": "10.0.0.9"}
    await there.post(f"{OF_SCENE}/create/auto-batch", body)
    robots = [robot.config for robot in there.handler.fleet.robots.values()]
    assert [r.name for r in robots] == ["Fork-01", "Fork-02", "Fork-03"]
    assert [r.host for r in robots] == ["10.0.0.9", "10.0.0.10", "10.0.0.11"]


@pytest.mark.parametrize(
    ("call", "body"),
    [
        ("create", {"robotName": "A"}),
        ("create/batch", [{"robotName": "A"}]),
        ("create/auto-batch", {"robotNamePrefix": "A", "count": 1}),
        ("update/config", {"robotName": R1, "remark": "x"}),
        ("update/config/batch", {"robotNames": [R1], "config": {"remark": "x"}}),
        ("remove", {"robotNames": [R1]}),
    ],
)
async def test_robots_are_those_of_the_scene_in_the_path(call: str, body: Any) -> None:
    there = site(*opened(R1, R2))
    before = dict(there.handler.fleet.robots)
    answer = await there.post(f"/api/fleet/scenes/nowhere/robot/{call}", body)
    assert (answer.status_code, answer.json()["code"]) == (400, "errSceneNotFound")
    assert there.handler.fleet.robots == before
    assert (await there.post(f"{OF_SCENE}/{call}", body)).status_code == 200
    after = there.handler.fleet.robots
    changed = {key for key in before | after if after.get(key) != before.get(key)}
    named = {R1} if before.keys() >= after.keys() else {"A", "A-01"}
    assert {key.rpartition("/")[2] for key in changed} <= named
    assert len(changed) == 1


YARD = SceneId("2" * 24)
BY_NAME: dict[str, tuple[str, dict[str, Any]]] = {
    "remove": (f"scenes/{SCENE}/robot/remove", {}),
    "update/config/batch": (
        f"scenes/{SCENE}/robot/update/config/batch",
        {"config": {"remark": "x"}},
    ),
    "off-duty": ("robots/off-duty", {"sceneId": SCENE, "offDuty": True}),
    "reconnect": ("robots/reconnect", {"sceneId": SCENE}),
    "master": ("robots/master", {"sceneId": SCENE, "on": True}),
    "clear-alarm": (f"robots/{SCENE}/clear-alarm", {}),
    "set-soft-emc": (f"robots/{SCENE}/set-soft-emc", {"enable": True}),
    "disabled": (f"robots/{SCENE}/disabled", {"disabled": True}),
    "auto-recovery": (f"robots/{SCENE}/auto-recovery", {}),
}


@pytest.mark.parametrize("call", BY_NAME)
async def test_a_call_reaches_the_robots_that_it_names_in_the_scene_that_it_names(
    call: str,
) -> None:
    """Robots of the same names are in another scene too."""
    yard = tuple(msgspec.structs.replace(event, scene=YARD) for event in opened(R1, R2))
    away: list[AnyEvent] = []
    if call == "reconnect":
        away = [RobotDisconnected(scene=s, robot=r) for s in (SCENE, YARD) for r in (R1, R2)]
        away += [RobotGivenUp(scene=s, robot=r) for s in (SCENE, YARD) for r in (R1, R2)]
    there = site(*opened(R1, R2), *yard, *away)
    before = dict(there.handler.fleet.robots)
    path, fields = BY_NAME[call]
    answer = await there.post(f"/api/fleet/{path}", {"robotNames": [R2], **fields})
    assert answer.status_code == 200, answer.text
    after = there.handler.fleet.robots
    assert {key for key in before if after.get(key) != before[key]} == {robot_key(SCENE, R2)}
    if answer.content:
        assert list(answer.json()) == [R2]
