from typing import Any

import pytest

from ledger.codec import encode
from ledger.events import RobotReconfigured
from ledger.ids import RobotName, robot_key
from ledger.scene import ConnectionType, RobotConfig
from tests.commands.api.application import Site, site
from tests.commands.site import ORDER, R1, R2, SCENE, assigned, created, opened, task
from tests.golden import example

OF_SCENE = f"/api/fleet/scenes/{SCENE}/robot"
GOOD = {"ok": True, "result": {}, "errMsg": None}
GATEWAY = {"connectionType": "GwWs", "gwAuthId": "user"}
SECRET = "open sesame"


def config(there: Site, name: str) -> RobotConfig:
    return there.handler.fleet.robots[robot_key(SCENE, RobotName(name))].config


async def test_the_example_of_an_update_is_taken() -> None:
    there = site(*opened("AMB-01"))
    body = example("m4", "robots-update-config.request")
    answer = await there.post(f"{OF_SCENE}/update/config", body)
    assert (answer.status_code, answer.content) == (200, b"")
    assert config(there, "AMB-01") == RobotConfig(
        name="AMB-01",
        group=1,
        connection=ConnectionType.FLEET_TO_ROBOT,
        host="192.168.10.205",
        plus_one=False,
    )
    position = there.handler.fleet.position
    assert (await there.post(f"{OF_SCENE}/update/config", body)).status_code == 200
    assert there.handler.fleet.position == position


async def test_the_example_of_a_batch_is_taken() -> None:
    there = site(*opened("AMB-01", "AMB-02"))
    body = example("m4", "robots-update-config-batch.request")
    answer = await there.post(f"{OF_SCENE}/update/config/batch", body)
    assert (answer.status_code, answer.json()) == (200, {"AMB-01": GOOD, "AMB-02": GOOD})
    assert config(there, "AMB-01").host == config(there, "AMB-02").host == "192.168.10.205"


async def test_a_set_up_is_whole_and_a_batch_is_partial() -> None:
    there = site(*opened(R1))
    full = {"robotName": R1, "groupId": 1, "tags": ["a"], "remark": "r", "selfBinNum": 2}
    await there.post(f"{OF_SCENE}/update/config", full | {"disabled": True, "vendor": "Hik"})
    before = config(there, R1)
    assert (before.disabled, before.vendor.value, before.simulated) == (True, "Hik", False)
    nulls = dict.fromkeys((*full, "disabled", "vendor", "image", "connectionType", "ssl"))
    body = {"robotNames": [R1], "config": nulls | {"remark": "new"}}
    assert (await there.post(f"{OF_SCENE}/update/config/batch", body)).json() == {R1: GOOD}
    after = config(there, R1)
    assert (after.remark, after.tags, after.bin_count, after.disabled) == ("new", ("a",), 2, True)
    await there.post(f"{OF_SCENE}/update/config", {"robotName": R1})
    assert config(there, R1) == RobotConfig(name=R1)


async def test_a_robot_that_cannot_be_set_up_fails_alone() -> None:
    there = site(*opened(R1, R2), created(ORDER, task()), assigned())
    body = {"robotNames": [R2, "nobody", R1], "config": {"selfBinNum": 4}}
    answer = await there.post(f"{OF_SCENE}/update/config/batch", body)
    assert list(answer.json()) == [R2, "nobody", R1]
    assert answer.json()[R2] == GOOD
    assert "nobody" in answer.json()["nobody"]["errMsg"]
    assert ORDER in answer.json()[R1]["errMsg"]
    assert (config(there, R1).bin_count, config(there, R2).bin_count) == (1, 4)


@pytest.mark.parametrize(
    ("call", "body", "code"),
    [
        ("update/config", {}, "errRobotNameInvalid"),
        ("update/config", {"robotName": ""}, "errRobotNameInvalid"),
        ("update/config", {"robotName": "nobody"}, "NoSuchRobot"),
        ("update/config", {"robotName": R1, "groupId": 9}, "errRobotGroupNotFound"),
        ("update/config", {"robotName": R1, "vendor": "Other"}, "errFieldInvalid"),
        ("update/config", {"robotName": R1, "selfBinNum": 0}, "errRobotConfigInvalid"),
        ("update/config", {"robotName": R1, **GATEWAY}, "errRobotConfigInvalid"),
        ("update/config/batch", {"robotNames": [R1]}, "errFieldMissing"),
        ("update/config/batch", {"config": {}}, "errFieldMissing"),
        ("update/config/batch", {"robotNames": [R1], "config": None}, "errFieldInvalid"),
    ],
)
async def test_what_is_wrong_is_refused_whole(call: str, body: dict[str, Any], code: str) -> None:
    there = site(*opened(R1))
    before = config(there, R1)
    answer = await there.post(f"{OF_SCENE}/{call}", body)
    assert (answer.status_code, answer.json()["code"]) == (400, code)
    assert config(there, R1) == before


def told(there: Site) -> bytes:
    return b"\n".join(map(encode, there.ledger.read(0)))


async def test_a_secret_is_kept_and_not_told() -> None:
    there = site(*opened(R1))
    good = {"robotName": "A", **GATEWAY, "gwAuthSecret": SECRET}
    await there.post(f"{OF_SCENE}/create", good)
    await there.post(f"{OF_SCENE}/create/batch", [good | {"robotName": "B"}, {"robotName": "C"}])
    series = GATEWAY | {"robotNamePrefix": "D", "count": 2, "gwAuthSecret": SECRET}
    await there.post(f"{OF_SCENE}/create/auto-batch", series)
    await there.post(f"{OF_SCENE}/update/config", good | {"robotName": R1, "gwAuthSecret": "two"})
    body = {"robotNames": ["A", "B", "nobody"], "config": {"gwAuthSecret": "three"}}
    await there.post(f"{OF_SCENE}/update/config/batch", body)
    kept = {"A": "three", "B": "three", "D-01": SECRET, "D-02": SECRET, R1: "two"}
    assert there.secrets == {(SCENE, RobotName(name)): secret for name, secret in kept.items()}
    assert {name for name in (*kept, "C") if config(there, name).gateway_secret_kept} == set(kept)
    assert SECRET.encode() not in told(there)
    assert b"three" not in told(there)


async def test_the_kept_secret_serves_later_set_ups() -> None:
    there = site(*opened(R1))
    first = {"robotName": R1, **GATEWAY, "gwAuthSecret": SECRET}
    await there.post(f"{OF_SCENE}/update/config", first)
    for later in ({}, {"gwAuthSecret": ""}, {"gwAuthSecret": None}):
        body = {"robotName": R1, **GATEWAY, "remark": str(later), **later}
        assert (await there.post(f"{OF_SCENE}/update/config", body)).status_code == 200
        assert config(there, R1).gateway_secret_kept
    assert there.secrets == {(SCENE, R1): SECRET}


async def test_a_refused_command_keeps_no_secret() -> None:
    there = site(*opened(R1))
    for call, body in (
        ("create", {"robotName": R1}),
        ("create", {"robotName": "A", "groupId": 9}),
        ("update/config", {"robotName": "nobody"}),
    ):
        answer = await there.post(f"{OF_SCENE}/{call}", {**body, **GATEWAY, "gwAuthSecret": SECRET})
        assert answer.status_code == 400
        assert SECRET not in answer.text
    assert there.secrets == {}


@pytest.mark.parametrize("key", [{}, {"Idempotency-Key": "k"}])
async def test_a_full_disk_leaves_the_secrets_as_they_were(key: dict[str, str]) -> None:
    there = site(*opened(R1))
    there.fill_disk()
    body = {**GATEWAY, "gwAuthSecret": SECRET}
    for call, name in (("create", "A"), ("update/config", R1)):
        answer = await there.post(f"{OF_SCENE}/{call}", body | {"robotName": name}, headers=key)
        assert (answer.status_code, answer.json()["code"]) == (503, "errDiskFull")
    assert there.secrets == {}


async def test_a_repeated_key_does_not_bring_an_old_secret_back() -> None:
    there = site(*opened(R1))
    body = {"robotName": R1, **GATEWAY, "gwAuthSecret": "old"}
    path, once = f"{OF_SCENE}/update/config", {"headers": {"Idempotency-Key": "k"}}
    await there.post(path, body, **once)
    await there.post(path, body | {"gwAuthSecret": "new"})
    again = await there.post(path, body, **once)
    assert again.status_code == 200
    assert there.secrets == {(SCENE, R1): "new"}
    assert sum(isinstance(e, RobotReconfigured) for e in there.ledger.read(0)) == 2
