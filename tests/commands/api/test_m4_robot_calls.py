import json

import pytest

from ledger.events import RobotRemoved
from ledger.ids import SceneId, robot_key
from ledger.scene import ConnectionType
from tests.commands.api.application import site
from tests.commands.site import ORDER, R1, R2, SCENE, assigned, created, opened, task
from tests.golden import example

OF_SCENE = f"/api/fleet/scenes/{SCENE}/robot"
GOOD = {"ok": True, "result": {}, "errMsg": None}


async def test_the_example_of_one_robot_is_taken() -> None:
    there = site()
    answer = await there.post(f"{OF_SCENE}/create", example("m4", "robots-create.request"))
    assert (answer.status_code, answer.content) == (200, b"")
    config = there.handler.fleet.robots[robot_key(SCENE, "AMB-01")].config
    assert config.connection is ConnectionType.FLEET_TO_ROBOT
    assert (config.host, config.group, config.port_first) == ("192.168.10.205", 1, None)
    assert (config.remark, config.gateway_user, config.plus_one) == (None, None, False)


async def test_the_example_of_several_robots_is_taken() -> None:
    there = site()
    body = example("m4", "robots-create-batch.request")
    answer = await there.post(f"{OF_SCENE}/create/batch", body)
    assert (answer.status_code, answer.content) == (200, b"")
    assert [r.name for r in there.handler.fleet.robots.values()] == ["AMB-02", "AMB-03"]
    again = await there.post(f"{OF_SCENE}/create/batch", [{"robotName": "new"}, *body])
    assert (again.status_code, again.json()["code"]) == (400, "errRobotNameTaken")
    assert len(there.handler.fleet.robots) == 2


async def test_the_example_of_a_series_is_taken_with_its_synonym_of_the_address() -> None:
    there = site()
    body = example("m4", "robots-create-auto-batch.request")
    assert (await there.post(f"{OF_SCENE}/create/auto-batch", body)).status_code == 200
    robots = [robot.config for robot in there.handler.fleet.robots.values()]
    assert [r.name for r in robots] == [f"AMB-{n:02}" for n in range(1, 11)]
    assert [r.host for r in robots] == [f"192.168.10.{n}" for n in range(205, 215)]


async def test_the_documented_address_wins_over_its_synonym() -> None:
    there = site()
    body = {"robotNamePrefix": "A", "count": 1, "robotIpStart": "10.0.0.1", "robotIp": "10.0.0.9"}
    await there.post(f"{OF_SCENE}/create/auto-batch", body)
    assert there.handler.fleet.robots[robot_key(SCENE, "A-01")].config.host == "10.0.0.1"


@pytest.mark.parametrize("image", ["x", {"a": [1]}, 7, [None]])
async def test_a_picture_is_kept_whatever_it_is(image: object) -> None:
    there = site()
    await there.post(f"{OF_SCENE}/create", {"robotName": "A", "image": image})
    kept = there.handler.fleet.robots[robot_key(SCENE, "A")].config.image
    assert kept is not None
    assert json.loads(kept) == image


async def test_a_robot_needs_a_name() -> None:
    answer = await site().post(f"{OF_SCENE}/create", {})
    assert answer.status_code == 400
    assert "robotName" in answer.json()["message"]


async def test_the_example_of_removal_is_taken() -> None:
    there = site(*opened("AMB-01", "AMB-02"))
    answer = await there.post(f"{OF_SCENE}/remove", example("m4", "robots-remove.request"))
    assert (answer.status_code, answer.content) == (200, b"")
    assert not there.handler.fleet.robots


async def test_a_robot_with_orders_is_not_removed() -> None:
    there = site(*opened(R1), created(ORDER, task()), assigned())
    answer = await there.post(f"{OF_SCENE}/remove", {"robotNames": [R1]})
    assert answer.status_code == 400
    assert ORDER in answer.json()["message"]


async def test_the_example_of_disabling_is_taken() -> None:
    there = site(*opened("Fork-02"))
    path = f"/api/fleet/robots/{SCENE}/disabled"
    answer = await there.post(path, example("m4", "robots-disabled.request"))
    assert (answer.status_code, answer.content) == (200, b"")
    assert there.handler.fleet.robots[robot_key(SCENE, "Fork-02")].config.disabled


async def test_the_example_of_going_off_duty_answers_for_each_robot() -> None:
    body = example("m4", "robots-off-duty.request")
    there = site(*opened("AMB-01", "AMB-02"))
    answer = await there.post("/api/fleet/robots/off-duty", body | {"sceneId": SCENE})
    assert answer.json() == {"AMB-01": GOOD, "AMB-02": GOOD}
    assert all(robot.off_duty for robot in there.handler.fleet.robots.values())


async def test_off_duty_is_false_where_it_is_not_said_and_goes_robot_by_robot() -> None:
    there = site(*opened(R1, R2), RobotRemoved(scene=SCENE, robot=R2))
    body = {"sceneId": SCENE, "robotNames": [R1, R2]}
    await there.post("/api/fleet/robots/off-duty", body | {"offDuty": True})
    answer = await there.post("/api/fleet/robots/off-duty", body)
    assert answer.json()[R1] == GOOD
    assert not answer.json()[R2]["ok"]
    assert not there.handler.fleet.robots[robot_key(SCENE, R1)].off_duty


async def test_bins_are_cleared_robot_by_robot() -> None:
    there = site(*opened(R1))
    path = f"/api/fleet/robots/{SCENE}/clear-bins"
    answer = await there.post(path, {"robotNames": [R1, R2]})
    assert answer.json()[R1] == GOOD
    assert not answer.json()[R2]["ok"]


async def test_an_unknown_scene_has_no_robots() -> None:
    path = f"/api/fleet/robots/{SceneId('S')}/disabled"
    answer = await site().post(path, {"robotNames": [], "disabled": True})
    assert (answer.status_code, answer.json()["code"]) == (400, "errSceneNotFound")
