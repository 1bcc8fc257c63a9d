"""Every question can be asked of any past moment: none that the application has is left out."""

import re
from pathlib import Path
from typing import Any

import httpx
import pytest

from fleetledger.access.roles import VIEWER
from ledger.moment import time_text
from tests.fleetledger.server import Server, serving, small_scene

ORDERS = {"entityName": "TransportOrder", "query": {"type": "All"}}
PAGE = {**ORDERS, "pageNo": 1, "pageSize": 10}

# what is asked of each; {scene}, {robot}, {order} stand for those of the server
ASKED: dict[str, Any] = {
    "POST /api/entity/find/many": ORDERS,
    "POST /api/entity/find/page": PAGE,
    "POST /api/entity/find/one": ORDERS,
    "POST /api/entity/find/count": ORDERS,
    "POST /api/entity/find/batch": [
        {"type": "Page", "req": PAGE},
        {"type": "Many", "req": ORDERS},
        {"type": "One", "req": ORDERS},
    ],
    "POST /api/fleet/scenes/{}/calc-move-costs": {"{robot}": ["{bin}"]},
    "POST /api/fleet/scenes/{}/query-all": {},
    "GET /api/fleet/orders/query-order-detail": {"orderId": "{order}"},
    "GET /api/fleet/robots/all-all": {"sceneId": "{scene}"},
    "GET /api/fleet/robots/query-point": {"sceneId": "{scene}", "robotName": "{robot}"},
    "GET /api/fleet/robots/{}/maps/{}": {},
    "GET /api/fleet/scenes/list": {},
    "GET /api/fleet/scenes/schema/{}": {},
    "GET /api/fleet/scenes/{}/map": {},
    "GET /api/fleet/scenes/{}/config": {},
    "GET /api/fleet/scenes/{}/ready-status": {},
    "GET /api/fleet/scenes/{}/list-points-bins": {},
    "GET /api/fleet/scenes/{}/door": {},
    "GET /api/fleet/scenes/{}/lift": {},
    "GET /api/replay/frame": {},
    "GET /api/replay/map": {"sceneId": "{scene}"},
    "GET /api/replay/order-story": {"orderId": "{order}"},
    "GET /api/replay/waits": {"sceneId": "{scene}"},
}
NOT_ASKED = {
    "GET /api/ping": "tells whether the server answers now",
    "GET /metrics": "figures of this process",
    "GET /api/ledger/position": "the newest one",
    "GET /api/ledger/events": "the past itself, by position",
    "GET /api/ledger/state": "takes `at` and `position`",
    "GET /api/access/users": "not in the ledger, its audit is",
    "GET /api/access/keys": "not in the ledger, its audit is",
    "GET /api/fleet/scenes/{}/callbacks": "tells of a secret, which is not in the ledger",
    "GET /api/fleet/scenes/{}/callbacks/waiting": "what was accepted is not in it either",
    "POST /api/sql": "the statement says of when",
    "POST /api/sign-out": "no question",
    "POST /api/access/password": "no question",
}
GONE = {
    "errSceneNotFound",
    "NoSuchRobot",
    "errOrderNotFound",
    "errSceneUnknown",  # of the console
    "errOrderUnknown",
}


def named(path: str) -> str:
    return "/".join("{}" if part.startswith("{") else part for part in path.split("/"))


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder: Path = tmp_path_factory.mktemp("as-of")
    options = ("--auth", "none", "--simulate", "--speed", "10", "--scene", str(small_scene(folder)))
    with serving(folder / "data", *options) as server:
        yield server


@pytest.fixture(scope="module")
def known(server: Server) -> dict[str, str]:
    bins = server.get(f"/api/fleet/scenes/{server.scene}/list-points-bins")["bins"]
    order = server.order(bins[0], bins[1])
    server.until_finished(order)
    robot = next(iter(server.get("/api/fleet/robots/all-all", sceneId=server.scene)))
    return {"scene": server.scene, "robot": robot, "order": order, "bin": bins[0]}


def filled(value: Any, known: dict[str, str]) -> Any:
    if isinstance(value, str):
        for name, word in known.items():
            value = value.replace(f"{{{name}}}", word)
        return value
    if isinstance(value, dict):
        return {filled(k, known): filled(v, known) for k, v in value.items()}
    return [filled(v, known) for v in value] if isinstance(value, list) else value


def ask(server: Server, known: dict[str, str], call: str, as_of: object, how: str = "query") -> Any:
    """Ask one of ASKED, of a moment that is named in the URL or in the header."""
    method, path = call.split()
    parts = iter([known["scene"], known["robot"]])
    path = "/".join(next(parts) if part == "{}" else part for part in path.split("/"))
    fields = filled(ASKED[call], known)
    url = {} if as_of is None or how != "query" else {"asOf": str(as_of)}
    headers = {"asOf": str(as_of)} if as_of is not None and how == "header" else {}
    if method == "GET":
        return server.client.get(path, params={**fields, **url}, headers=headers)
    return server.client.post(path, params=url, json=fields, headers=headers)


def test_no_question_is_left_out(server: Server) -> None:
    paths = server.get("/openapi.json")["paths"]
    viewers = {
        " ".join([line.split()[0], named(line.split()[1])]) for line in VIEWER.split("\n")[1:-1]
    }
    found = {
        call
        for path, methods in paths.items()
        for method in methods
        if (call := f"{method.upper()} {named(path)}").startswith("GET ") or call in viewers
    }
    assert found == ASKED.keys() | NOT_ASKED.keys()


def told(answer: httpx.Response) -> bytes:
    """The answer, but for the time at which it was given (of the console's frame)."""
    return re.sub(rb'"nowMs":[0-9]+', b"", answer.content)


@pytest.mark.parametrize("call", ASKED)
def test_a_moment_is_heeded(server: Server, known: dict[str, str], call: str) -> None:
    """Before the first event there was nothing; the future and nonsense are refused."""
    now = ask(server, known, call, None)
    assert now.status_code == 200, now.text
    first_ms = server.get("/api/ledger/events", limit=1)[0]["at_ms"]
    nothing = ask(server, known, call, first_ms - 1)
    if nothing.status_code == 200:
        assert nothing.headers["x-ledger-position"] == "0"
        assert nothing.content != now.content
    else:
        assert nothing.status_code in (400, 404)
        assert nothing.json()["code"] in GONE, nothing.text
    by_text = ask(server, known, call, time_text(first_ms - 1))
    assert (by_text.status_code, told(by_text)) == (nothing.status_code, told(nothing))
    wrong = ask(server, known, call, "soon")
    assert (wrong.status_code, wrong.json()["code"]) == (400, "errFieldInvalid")
    if "/replay/" not in call:  # the console's slider: beyond its end is now; nothing by header
        by_header = ask(server, known, call, first_ms - 1, "header")
        assert (by_header.status_code, by_header.content) == (nothing.status_code, nothing.content)
        ahead = ask(server, known, call, "2200-01-01")
        assert (ahead.status_code, ahead.json()["code"]) == (400, "errAsOfInFuture")


def test_what_has_ended_is_seen_as_it_was(server: Server, known: dict[str, str]) -> None:
    """A finished order with the robot and step of that moment, and the robot with its load."""
    events = server.get("/api/ledger/events", limit=10_000)
    of_order = [e for e in events if e.get("order") == known["order"]]
    started = next(e for e in of_order if e["type"] == "StepStarted" and e["step"] == 1)
    as_of = started["at_ms"]
    detail = ask(server, known, "GET /api/fleet/orders/query-order-detail", as_of).json()
    assert detail["status"] == "Executing"
    (row,) = ask(server, known, "POST /api/entity/find/many", as_of).json()
    assert (row["id"], row["status"]) == (known["order"], "Executing")
    robots = ask(server, known, "GET /api/fleet/robots/all-all", as_of).json()
    carrier = robots[started["robot"]]
    assert known["order"] in carrier["orders"]
    assert carrier["bins"][0]["status"] == "Filled"
    assert carrier["x"] is not None


def test_the_whole_state_of_then_is_the_very_bytes_that_were_given_then(
    server: Server, known: dict[str, str]
) -> None:
    given: dict[int, bytes] = {}
    for _ in range(5):
        order = server.order(known["bin"], known["bin"].replace("-L", "-R"))
        server.until(lambda e, o=order: e.get("order") == o)  # type: ignore[misc]
        state = server.client.get("/api/ledger/state")
        given[int(state.headers["x-ledger-position"])] = state.content
    assert len(given) > 1
    for position, content in given.items():
        again = server.client.get("/api/ledger/state", params={"position": position})
        assert again.content == content
        event = server.get("/api/ledger/events", after=position - 1, limit=2)
        if len(event) == 2 and event[1]["at_ms"] > event[0]["at_ms"]:
            then = server.client.get("/api/ledger/state", params={"at": event[0]["at_ms"]})
            assert then.content == content
