import asyncio
import json
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import commands.api.callbacks
from fleetledger.http import ThinRoute
from ledger.callbacks import CallbackConfig, CallbackStatus
from ledger.events import CallbacksConfigured, CommandAnswered
from tests.commands.api.application import Site, site
from tests.commands.api.test_fuzz import anything
from tests.commands.site import SCENE

PATH = f"/api/fleet/scenes/{SCENE}/callbacks"
URL = "http://wms.example/orders"
OURS = "made-by-us-0123456789"
THEIRS = "theirs-0123456789"
DEFAULTS = {
    "enableOrderCallback": False,
    "callbackStatusList": [],
    "callbackUrlList": [],
    "retryTimes": 10,
    "retryInterval": 1.0,
}
ENABLE = {"enableOrderCallback": True, "callbackUrlList": [URL]}


class Kept:
    """Secrets in memory, with how often they were put."""

    def __init__(self) -> None:
        self.secrets: dict[str, str] = {}
        self.puts = 0

    def get(self, name: str) -> str | None:
        return self.secrets.get(name)

    def put(self, name: str, value: str) -> None:
        self.secrets[name] = value
        self.puts += 1


def opened() -> tuple[Site, Kept]:
    there, kept = site(), Kept()
    there.app.include_router(
        commands.api.callbacks.router(there.handler, there.durable, ThinRoute, kept, lambda: OURS)
    )
    return there, kept


def in_ledger(there: Site) -> str:
    return msgspec.json.encode(list(there.ledger.read(0))).decode()


async def test_without_settings_nobody_is_told() -> None:
    there, _ = opened()
    answer = await there.get(PATH)
    assert (answer.status_code, answer.json()) == (200, DEFAULTS)


async def test_all_settings_are_kept_and_answered() -> None:
    there, kept = opened()
    body = {
        "enableOrderCallback": True,
        "callbackStatusList": ["Done", "Cancelled", "Withdrawing", "Done"],
        "callbackUrlList": [URL, "https://other.example/"],
        "retryTimes": 3,
        "retryInterval": 2.5,
        "secret": THEIRS,
    }
    answer = await there.post(PATH, body)
    wanted = {
        **body,
        "callbackStatusList": ["Done", "Cancelled", "Withdrawing"],
        "secret": "set",
    }
    assert (answer.status_code, answer.json()) == (200, wanted)
    assert (await there.get(PATH)).json() == wanted
    assert kept.secrets == {f"callback/{SCENE}": THEIRS}
    assert there.handler.fleet.scenes[SCENE].callbacks == CallbackConfig(
        enabled=True,
        statuses=(CallbackStatus.DONE, CallbackStatus.CANCELLED, CallbackStatus.WITHDRAWING),
        urls=(URL, "https://other.example/"),
        retries_max=3,
        retry_s=2.5,
    )
    assert THEIRS not in in_ledger(there)


async def test_what_is_left_out_stays_as_it_is() -> None:
    there, _ = opened()
    await there.post(PATH, {**ENABLE, "retryTimes": 7})
    answer = await there.post(PATH, {"retryInterval": 5, "retryTimes": None})
    assert answer.json() == {
        **DEFAULTS,
        **ENABLE,
        "retryTimes": 7,
        "retryInterval": 5.0,
        "secret": "set",
    }
    assert (await there.post(PATH, {"callbackStatusList": []})).json()["callbackUrlList"] == [URL]


async def test_a_secret_of_our_making_is_shown_once() -> None:
    there, kept = opened()
    assert (await there.post(PATH, ENABLE)).json()["secret"] == OURS
    assert kept.secrets == {f"callback/{SCENE}": OURS}
    assert (await there.post(PATH, ENABLE)).json()["secret"] == "set"
    assert (await there.get(PATH)).json()["secret"] == "set"
    assert OURS not in in_ledger(there)


async def test_no_secret_is_made_for_what_is_not_enabled() -> None:
    there, kept = opened()
    assert "secret" not in (await there.post(PATH, {"callbackUrlList": [URL]})).json()
    assert kept.secrets == {}


async def test_a_repeated_key_changes_no_secret_and_keeps_none_in_the_ledger() -> None:
    there, kept = opened()
    key = {"Idempotency-Key": "k"}
    first = await there.post(PATH, ENABLE, headers=key)
    assert first.json()["secret"] == OURS
    assert first.headers["X-Ledger-Position"] == str(there.ledger.durable)
    await there.post(PATH, {"secret": THEIRS})
    again = await there.post(PATH, ENABLE, headers=key)
    assert again.json()["secret"] == "set"
    assert (kept.secrets[f"callback/{SCENE}"], kept.puts) == (THEIRS, 2)
    assert OURS not in in_ledger(there)
    kinds = [type(event) for event in there.ledger.read(0)][1:]
    assert kinds == [CallbacksConfigured, CommandAnswered]


@pytest.mark.parametrize("key", [{}, {"Idempotency-Key": "k"}])
@pytest.mark.parametrize(
    ("body", "word"),
    [
        ({"enableOrderCallback": True}, "callbackUrlList"),
        ({"enableOrderCallback": 1}, "enableOrderCallback"),
        ({"callbackUrlList": ["gopher://x"]}, "callbackUrlList.0"),
        ({"callbackUrlList": [URL] * 11}, "callbackUrlList"),
        ({"callbackUrlList": ["http://x/" + "x" * 2_000]}, "callbackUrlList.0"),
        ({"callbackStatusList": ["Finished"]}, "callbackStatusList.0"),
        ({"callbackStatusList": ["Done"] * 51}, "callbackStatusList"),
        ({"retryTimes": 1.5}, "retryTimes"),
        ({"retryTimes": 10**30}, "retryTimes"),
        ({"retryInterval": 0}, "retryInterval"),
        (b'{"retryInterval": NaN}', "retryInterval"),
        (b'{"retryInterval": Infinity}', "retryInterval"),
        ({"secret": "short"}, "secret"),
        ({"secret": ""}, "secret"),
        ({"secret": "x" * 201}, "secret"),
        ({"secret": "with a space in it all"}, "secret"),
        (b'{"secret": "\\ud800aaaaaaaaaaaaaaaaaa"}', "JSON"),
    ],
)
async def test_what_is_refused_changes_nothing(body: Any, word: str, key: dict[str, str]) -> None:
    there, kept = opened()
    if isinstance(body, dict):
        body = {"secret": THEIRS, **body}
    answer = await there.post(PATH, body, headers=key)
    assert answer.status_code == 400
    assert answer.json().keys() == {"code", "message", "args"}
    assert word in answer.json()["message"]
    assert THEIRS not in answer.text
    assert kept.secrets == {}
    assert there.handler.fleet.scenes[SCENE].callbacks == CallbackConfig()


@pytest.mark.parametrize("key", [{}, {"Idempotency-Key": "k"}])
@pytest.mark.parametrize("body", [ENABLE, ENABLE | {"secret": THEIRS}, {"secret": THEIRS}])
async def test_a_full_disk_leaves_the_secret_as_it_was(body: Any, key: dict[str, str]) -> None:
    there, kept = opened()
    there.fill_disk()
    answer = await there.post(PATH, body, headers=key)
    assert (answer.status_code, answer.json()["code"]) == (503, "errDiskFull")
    assert kept.secrets == {}
    assert there.handler.fleet.scenes[SCENE].callbacks == CallbackConfig()


async def test_a_scene_that_is_not_there_has_no_settings() -> None:
    there, kept = opened()
    for path in ("/api/fleet/scenes/no/callbacks", "/api/fleet/scenes/%20/callbacks"):
        for answer in (await there.get(path), await there.post(path, {"secret": THEIRS})):
            assert answer.status_code == 400
            assert answer.json()["code"] in ("errSceneNotFound", "errSceneIdBlank")
    assert kept.secrets == {}


@settings(max_examples=100, deadline=None)
@given(
    st.fixed_dictionaries(
        {},
        optional=dict.fromkeys((*DEFAULTS, "secret"), anything | st.lists(st.text(), max_size=3)),
    )
    | anything
)
def test_no_body_is_ever_answered_by_a_failure(body: Any) -> None:
    there, _ = opened()
    answer = asyncio.run(there.post(PATH, json.dumps(body).encode()))
    assert answer.status_code in (200, 400)
    if answer.status_code == 400:
        assert answer.json().keys() == {"code", "message", "args"}
