"""Access over HTTP, in process, with time of the test's own."""

from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleetledger.access import api
from fleetledger.access.callers import ANYBODY, Anybody, claimed, from_own_page
from fleetledger.access.guesses import USER_FREE
from fleetledger.access.registry import user_added
from fleetledger.access.sessions import IDLE_MS
from fleetledger.api import build
from ledger.events import (
    AccessRefused,
    KeyAdded,
    Role,
    SignedIn,
    SignedOut,
    UserAdded,
    UserChanged,
    UserRemoved,
)
from tests.fleetledger.access.doors import Doors

URL = "http://localhost:5800"
PASSWORD = "correct horse battery"


async def _wait(position: int) -> bool:
    return True


class Plant:
    """A server's access with an admin's key, and clients of it."""

    def __init__(self, data: Path, *, enforced: bool = True) -> None:
        self.doors = Doors(data, enforced=enforced)
        self.access = self.doors.access
        key = self.access.file.first_key()
        assert key is not None
        self.admin = {"xyy-app-id": "fleetledger", "xyy-app-key": key}
        app = build(
            [api.router(self.access)],
            callers=self.access.callers,
            refused=self.access.refusals.refused,
            position=lambda: 7,
            wait=_wait,
            when=lambda position, then: then(None),
        )
        self._transport = httpx.ASGITransport(app, client=("10.0.0.1", 1))
        self.client = httpx.AsyncClient(transport=self._transport, base_url=URL)

    def browser(self) -> httpx.AsyncClient:
        return httpx.AsyncClient(
            transport=self._transport, base_url=URL, headers={"sec-fetch-site": "same-origin"}
        )

    async def post(self, path: str, body: object = None, **headers: str) -> httpx.Response:
        answer = await self.client.post(path, json=body, headers=headers)
        self.client.cookies.clear()  # this one is a program
        return answer

    async def done(self, path: str, body: object, **headers: str) -> Any:
        answer = await self.post(path, body, **(headers or self.admin))
        assert answer.status_code == 200, answer.text
        return answer.json() if answer.content else None

    async def add(self, name: str, role: str = "viewer") -> None:
        body = {"username": name, "role": role, "password": PASSWORD}
        await self.done("/api/access/users/add", body)

    async def sign_in(self, name: str, password: str = PASSWORD) -> dict[str, str]:
        """Sign in and give the headers of further calls."""
        body = {"username": name, "password": password}
        said = await self.done("/api/sign-in", body)
        assert set(said) == {"userId", "userToken"}
        return {"x-xzz-qyq": said["userId"], "x-xzz-qyx": said["userToken"]}

    async def ping(self, **headers: str) -> Any:
        answer = await self.client.get("/api/ping", headers=headers)
        return answer.json() if answer.status_code == 200 else answer.status_code


@pytest.fixture
async def plant(tmp_path: Path) -> AsyncIterator[Plant]:
    plant = Plant(tmp_path)
    async with plant.client:
        yield plant


async def test_ping_tells_who_one_is(plant: Plant) -> None:
    await plant.add("anna", "operator")

    assert await plant.ping() == 401
    assert await plant.ping(**plant.admin) == {
        "id": "fleetledger",
        "username": "fleetledger",
        "roAdmin": True,
        "permissions": ["view", "operate", "administer"],
    }
    assert await plant.ping(**await plant.sign_in("anna")) == {
        "id": "anna",
        "username": "anna",
        "roAdmin": False,
        "permissions": ["view", "operate"],
    }


async def test_a_browser_is_known_by_cookies_until_it_signs_out(plant: Plant) -> None:
    await plant.add("anna")
    body = {"username": "anna", "password": PASSWORD}
    async with plant.browser() as browser:
        answer = await browser.post("/api/sign-in", json=body)
        user, token = answer.headers.get_list("set-cookie")
        assert user.startswith("xzz-qyq-5800=anna; ")
        assert token.startswith(f"xzz-qyx-5800={answer.json()['userToken']}; ")
        assert "HttpOnly" in token
        assert all("SameSite=strict" in cookie for cookie in (user, token))
        assert (await browser.get("/api/ping")).json()["id"] == "anna"
        kept = dict(browser.cookies)
        assert (await browser.post("/api/sign-out")).status_code == 200
        assert (await browser.get("/api/ping")).status_code == 401
        cookie = "; ".join(f"{name}={value}" for name, value in kept.items())
        assert await plant.ping(cookie=cookie) == 401


async def test_cookies_of_any_page_port_will_do_beside_those_of_others(plant: Plant) -> None:
    await plant.add("anna")
    headers = await plant.sign_in("anna")
    token = headers["x-xzz-qyx"]
    cookie = (
        "Pycharm-e4ba248e=346b9c2a; xzz-qyq-81=bob; xzz-qyx-81=wrong; "
        f"xzz-qyq-5173=anna; xzz-qyx-5173={token}; "
    )

    assert (await plant.ping(cookie=cookie))["id"] == "anna"
    assert await plant.ping(cookie=f"xzz-qyq-1=anna; xzz-qyx-2={token}") == 401
    assert await plant.ping(cookie=f"xzz-qyq-1=bob; xzz-qyx-1={token}") == 401
    assert await plant.ping(cookie="; ;=; xzz-qyx-1; \x7f") == 401


async def test_wrong_headers_are_not_made_good_by_a_cookie(plant: Plant) -> None:
    await plant.add("anna")
    token = (await plant.sign_in("anna"))["x-xzz-qyx"]
    cookie = f"xzz-qyq-1=anna; xzz-qyx-1={token}"

    assert await plant.ping(cookie=cookie, **{"xyy-app-id": "wms", "xyy-app-key": "x"}) == 401
    assert await plant.ping(cookie=cookie, **{"x-xzz-qyq": "anna"}) == 401


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 200),  # a program that sends cookies, as the vendor's examples do
        ({"origin": URL}, 200),
        ({"origin": "https://localhost:5800"}, 200),  # a proxy that speaks TLS stands before us
        ({"origin": "http://localhost:5801"}, 403),
        ({"origin": "http://evil.example"}, 403),
        ({"origin": "null"}, 403),
        ({"sec-fetch-site": "same-site", "origin": URL}, 403),
    ],
)
async def test_no_other_sites_page_changes_anything_by_a_browsers_cookies(
    plant: Plant, headers: dict[str, str], status: int
) -> None:
    await plant.add("anna")
    token = (await plant.sign_in("anna"))["x-xzz-qyx"]
    cookie = f"xzz-qyq-1=anna; xzz-qyx-1={token}"

    answer = await plant.post("/api/sign-out", None, cookie=cookie, **headers)

    assert answer.status_code == status


async def test_whatever_is_wrong_signing_in_fails_alike(plant: Plant) -> None:
    await plant.add("anna")
    await plant.add("bob")
    await plant.done("/api/access/users/update", {"username": "bob", "disabled": True})

    tries = [("anna", "wrong"), ("bob", PASSWORD), ("eve", PASSWORD), ("\ud800", "\udfff")]
    answers = [
        await plant.client.post(
            "/api/sign-in", content=f'{{"username": {_json(n)}, "password": {_json(p)}}}'
        )
        for n, p in tries
    ]

    assert {answer.status_code for answer in answers} == {400}
    assert len({answer.text for answer in answers[:3]}) == 1
    assert answers[0].json()["code"] == "errSignInFailed"


def _json(text: str) -> str:
    return '"' + "".join(f"\\u{ord(character):04x}" for character in text) + '"'


async def test_a_guesser_must_wait_and_even_the_right_one_is_not_looked_at(plant: Plant) -> None:
    await plant.add("anna")
    wrong = {"username": "anna", "password": "wrong"}
    for _ in range(USER_FREE):
        assert (await plant.post("/api/sign-in", wrong)).status_code == 400

    right = {"username": "anna", "password": PASSWORD}
    refused = await plant.post("/api/sign-in", right)
    assert refused.status_code == 429
    assert refused.headers["Retry-After"] == "1"
    plant.doors.pass_s(1)
    assert (await plant.post("/api/sign-in", right)).status_code == 200
    assert (await plant.post("/api/sign-in", right)).status_code == 200


async def test_a_session_ends_with_its_time_its_password_and_its_user(plant: Plant) -> None:
    for name in ("anna", "bob", "carl", "dora"):
        await plant.add(name)
    idle = await plant.sign_in("anna")
    plant.doors.now_ms += IDLE_MS
    changed, disabled, removed = [await plant.sign_in(name) for name in ("bob", "carl", "dora")]
    update = {"username": "bob", "password": "another password"}
    await plant.done("/api/access/users/update", update)
    await plant.done("/api/access/users/update", {"username": "carl", "disabled": True})
    await plant.done("/api/access/users/remove", {"username": "dora"})
    await plant.add("dora")
    await plant.done("/api/access/users/update", {"username": "carl", "disabled": False})

    assert [await plant.ping(**h) for h in (idle, changed, disabled, removed)] == [401] * 4
    assert (await plant.ping(**await plant.sign_in("bob", "another password")))["id"] == "bob"


async def test_another_role_counts_at_once_and_ends_no_session(plant: Plant) -> None:
    await plant.add("anna")
    headers = await plant.sign_in("anna")
    assert (await plant.client.get("/api/access/users", headers=headers)).status_code == 403

    await plant.done("/api/access/users/update", {"username": "anna", "role": "admin"})

    answer = await plant.client.get("/api/access/users", headers=headers)
    assert answer.json() == [{"username": "anna", "role": "admin", "disabled": False}]


async def test_a_person_changes_the_own_password_by_saying_it(plant: Plant) -> None:
    await plant.add("anna")
    headers = await plant.sign_in("anna")
    path, new = "/api/access/password", "a new password"

    wrong = await plant.post(path, {"password": "wrong", "newPassword": new}, **headers)
    short = await plant.post(path, {"password": PASSWORD, "newPassword": "short"}, **headers)
    app = await plant.post(path, {"password": PASSWORD, "newPassword": new}, **plant.admin)
    assert [a.status_code for a in (wrong, short, app)] == [400, 400, 403]
    await plant.done(path, {"password": PASSWORD, "newPassword": new}, **headers)

    assert await plant.ping(**headers) == 401
    assert (await plant.ping(**await plant.sign_in("anna", new)))["id"] == "anna"


async def test_keys_turn_without_a_gap_and_without_a_restart(plant: Plant) -> None:
    made = await plant.done("/api/access/keys/add", {"appId": "wms", "role": "operator"})
    old = {"xyy-app-id": "wms", "xyy-app-key": made["appKey"]}
    assert (await plant.ping(**old))["permissions"] == ["view", "operate"]

    turned = await plant.done("/api/access/keys/rotate", {"appId": "wms", "graceMinutes": 10})
    new = old | {"xyy-app-key": turned["appKey"]}
    assert [(await plant.ping(**pair))["id"] for pair in (old, new)] == ["wms", "wms"]
    listed = await plant.client.get("/api/access/keys", headers=plant.admin)
    assert [key["oldKeyValidUntil"] for key in listed.json()] == [
        None,
        plant.doors.now_ms + 600_000,
    ]
    plant.doors.pass_s(600)
    assert await plant.ping(**old) == 401
    assert (await plant.ping(**new))["id"] == "wms"
    await plant.done("/api/access/keys/remove", {"appId": "wms"})
    assert await plant.ping(**new) == 401


async def test_everything_is_in_the_audit_and_nothing_secret(plant: Plant, tmp_path: Path) -> None:
    await plant.add("anna")
    headers = await plant.sign_in("anna")
    await plant.post("/api/sign-in", {"username": "anna", "password": "wrong"})
    await plant.post("/api/access/keys/add", {"appId": "x", "role": "admin"}, **headers)
    made = await plant.done("/api/access/keys/add", {"appId": "wms", "role": "operator"})
    await plant.post("/api/sign-out", None, **headers)
    await plant.done("/api/access/users/update", {"username": "anna", "role": "operator"})
    await plant.done("/api/access/users/remove", {"username": "anna"})
    await plant.access.close()

    told = plant.doors.told()
    assert [type(event) for event in told] == [
        KeyAdded,
        UserAdded,
        SignedIn,
        KeyAdded,
        SignedOut,
        UserChanged,
        UserRemoved,
        AccessRefused,
        AccessRefused,
    ]
    by = [event.by for event in told]
    assert (
        by
        == ["serve", "fleetledger", "anna", "fleetledger", "anna"]
        + ["fleetledger"] * 2
        + ["fleetledger-gate"] * 2
    )
    failed, forbidden = told[-2:]
    assert isinstance(failed, AccessRefused)
    assert isinstance(forbidden, AccessRefused)
    assert (failed.caller, failed.address, failed.code) == ("anna", "10.0.0.1", "errSignInFailed")
    assert (forbidden.call, forbidden.code) == ("POST /api/access/keys/add", "errForbidden")
    kept = repr(told) + "".join(path.read_text() for path in tmp_path.iterdir())
    for secret in (PASSWORD, "wrong", headers["x-xzz-qyx"], made["appKey"]):
        assert secret not in kept


async def test_what_the_command_line_changed_is_in_force_and_in_the_audit(plant: Plant) -> None:
    other = plant.doors.opened()
    other.file.change(user_added("anna", Role.ADMIN, "hash", "s"), "fleetledger-cli (root)")

    await plant.access._look(tell=False)

    assert "anna" in plant.access.file.registry.users
    assert [(e.by, type(e)) for e in plant.doors.told()][-1] == (
        "fleetledger-cli (root)",
        UserAdded,
    )
    assert plant.access.file.registry.untold == ()


async def test_without_access_control_all_may_and_none_changes_access(tmp_path: Path) -> None:
    plant = Plant(tmp_path, enforced=False)
    async with plant.client:
        assert (await plant.ping())["roAdmin"]
        body = {"appId": "back-door", "role": "admin"}
        refused = await plant.post("/api/access/keys/add", body)
        assert (refused.status_code, refused.json()["code"]) == (403, "errAccessOff")
        assert "back-door" not in plant.access.file.registry.keys


async def test_a_websocket_learns_who_follows(tmp_path: Path) -> None:
    plant = Plant(tmp_path)
    await plant.add("anna", "operator")
    token = (await plant.sign_in("anna"))["x-xzz-qyx"]
    cookie = f"xzz-qyq-1=anna; xzz-qyx-1={token}"
    seen = []
    for headers in (plant.admin, {"cookie": cookie, "origin": URL}, {}, {"cookie": cookie}):
        seen.append(await _followed(plant, {**headers, "host": "localhost:5800"}))
    elsewhere = {"cookie": cookie, "origin": "http://evil.example", "host": "localhost:5800"}
    seen.append(await _followed(plant, elsewhere))
    await plant.client.aclose()

    assert seen == [
        ("fleetledger", Role.ADMIN),
        ("anna", Role.OPERATOR),
        ("", None),
        ("anna", Role.OPERATOR),
        ("", None),
    ]


async def _followed(plant: Plant, headers: dict[str, str]) -> tuple[str, Role | None]:
    scope: dict[str, Any] = {
        "type": "websocket",
        "path": "/wsm",
        "headers": [(name.encode(), value.encode()) for name, value in headers.items()],
        "client": ("10.0.0.1", 1),
    }
    gate: Any = plant._transport.app
    gate._name_follower(scope)
    return scope["state"]["user"], scope["state"]["role"]


@given(st.dictionaries(st.sampled_from([b"cookie", b"x-xzz-qyq", b"xyy-app-id"]), st.binary()))
def test_no_header_confuses_the_gate(headers: dict[bytes, bytes]) -> None:
    assert len(claimed(headers)) <= 100
    assert from_own_page(headers)
    assert Anybody().caller(headers).role is ANYBODY.role
