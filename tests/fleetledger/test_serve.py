"""The server as its users meet it: started, asked, stopped, started again."""

import json
import re
import select
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path

import httpx
import msgspec
import pytest
from websockets.sync.client import connect

from commands.imports.scene_json import write_scene
from tests.fleetledger.server import (
    START_S_MAX,
    Server,
    command,
    serving,
    small_file,
    small_scene,
    still_there,
)
from tests.laws.onlooker import bins_of

OPEN = ("--auth", "none")
BINS = bins_of(small_file())


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """One server with robots, for all that only ask."""
    folder = tmp_path_factory.mktemp("site")
    options = ("--simulate", "--speed", "10", "--rdscore-port", "0", "--scene")
    with serving(folder / "data", *OPEN, *options, str(small_scene(folder))) as server:
        server.until_finished(server.order(BINS[0], BINS[-1]))
        yield server


def refused(data: Path, *options: str) -> str:
    """Start a server that must not start; gives what it says about it."""
    done = subprocess.run(
        command(data, *options), capture_output=True, text=True, timeout=START_S_MAX
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    return " ".join(done.stderr.split())


def test_it_lives_and_ends_cleanly(tmp_path: Path) -> None:
    data, scene = tmp_path / "data", small_scene(tmp_path)
    with serving(data, *OPEN, "--simulate", "--scene", str(scene)) as server:
        assert re.fullmatch(r"ready http://127\.0\.0\.1:\d+\n", server.line)
        assert len(server.children) == 2
        first = server.scene
        assert "in use by process" in (second := refused(data, *OPEN))
        assert "Stop the other server first" in second
        assert server.get("/api/ping")["id"] == "anonymous"
        assert server.stop() == 0
        assert server.process.stdout is not None
        assert server.process.stdout.read() == "", "more than one line on standard output"
        assert still_there(server.children) == []
    with serving(data, *OPEN) as server:
        assert server.scene == first, "the folder knows its scene"
        newest = server.get("/api/ledger/position")
        assert server.stop() == 0
    with serving(data, *OPEN, "--scene", str(scene)) as server:
        assert server.scene == first
        assert server.get("/api/ledger/position") == newest, "the same file is no news"
        server.stop()
    scene.write_bytes(write_scene(small_file(robots=4)))
    with serving(data, *OPEN, "--scene", str(scene)) as server:
        assert [s["id"] for s in server.get("/api/fleet/scenes/list")] == [first]
        news = server.get("/api/ledger/events", after=newest["position"])
        kinds = {event["type"] for event in news if event["scene"] == first}
        assert {"SceneMapReplaced", "RobotAdded"} <= kinds
        server.stop()


def test_the_first_start_gives_a_key_once_and_asks_for_it_ever_after(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with serving(data, "--auth", "keys", "--log-json") as server:
        shown = [json.loads(line) for line in server.log.read_text().splitlines()]
        pairs = [line for line in shown if "xyy-app-key" in line]
        assert len(pairs) == 1
        pair = {name: pairs[0][name] for name in ("xyy-app-id", "xyy-app-key")}
        assert server.client.get("/api/fleet/scenes/list").status_code == 401
        wrong = {**pair, "xyy-app-key": "wrong"}
        assert server.client.get("/api/fleet/scenes/list", headers=wrong).status_code == 401
        assert server.client.get("/api/fleet/scenes/list", headers=pair).json() == []
        assert server.client.get("/metrics").status_code == 401
        assert server.stop() == 0
    with serving(data, "--log-json") as server:
        answer = server.client.get("/api/ping", headers=pair)
        assert answer.json()["id"] == "fleetledger"
        assert server.stop() == 0
    assert server.log.read_text().count("xyy-app-key") == 1
    assert pair["xyy-app-key"] not in (data / "access.json").read_text()


def test_what_cannot_be_served_is_refused_in_words(tmp_path: Path) -> None:
    data = tmp_path / "data"
    assert "only allowed on a loopback host" in refused(data, *OPEN, "--host", "0.0.0.0")
    assert "speed" in refused(data, *OPEN, "--speed", "0")
    assert not data.exists(), "nothing was made for a refused start"
    nonsense = tmp_path / "nonsense.json"
    nonsense.write_text('{"name": 7}')
    assert "`$.name`" in refused(data, *OPEN, "--scene", str(nonsense))
    assert "missing.json" in refused(data, *OPEN, "--scene", str(tmp_path / "missing.json"))
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        assert port in refused(data, *OPEN, "--port", port)


def test_the_past_is_answered_as_it_was(site: Server) -> None:
    made = site.order(BINS[1], BINS[2])
    finished = site.until_finished(made)
    events = site.get("/api/ledger/events", limit=10_000)
    created = next(e for e in events if e["type"] == "OrderCreated" and e["order"] == made)
    body = {"entityName": "TransportOrder", "query": None}
    for at_ms, status in ((created["at_ms"], "ToBeAllocated"), (finished["at_ms"], "Done")):
        rows = site.client.post("/api/entity/find/many", json=body, params={"asOf": at_ms}).json()
        assert {row["id"]: row["status"] for row in rows}[made] == status
    before = created["at_ms"] - 1
    rows = site.client.post("/api/entity/find/many", json=body, params={"asOf": before}).json()
    assert made not in {row["id"] for row in rows}
    state = site.get("/api/ledger/state", at=before)
    assert made not in state["orders"]
    now = site.get("/api/fleet/robots/all-all", sceneId=site.scene)
    robots = site.get("/api/fleet/robots/all-all", asOf=before, sceneId=site.scene)
    assert robots.keys() == now.keys()


def test_a_query_waits_for_the_position_it_names(site: Server) -> None:
    body = {"entityName": "TransportOrder", "query": None}
    sent = site.client.post(
        "/api/fleet/orders/create", json={"sceneId": site.scene, "keyLocations": [BINS[0]]}
    )
    position = sent.headers["X-Ledger-Position"]
    found = site.client.post(
        "/api/entity/find/many", json=body, headers={"X-Wait-Position": position}
    )
    assert sent.json()["orderId"] in {row["id"] for row in found.json()}
    assert int(found.headers["X-Ledger-Position"]) >= int(position)
    wrong = site.client.get("/api/ping", headers={"X-Wait-Position": "soon"})
    assert (wrong.status_code, wrong.json()["code"]) == (400, "errFieldInvalid")
    site.post("/api/fleet/orders/cancel-all", {"sceneId": site.scene})


def test_it_shows_its_figures_and_describes_itself(site: Server) -> None:
    figures = site.client.get("/metrics").text
    assert re.search(r"^fleetledger_ledger_position [1-9]", figures, re.MULTILINE)
    assert "fleetledger_http_calls_total" in figures
    assert site.client.get("/docs").status_code == 200
    paths = site.get("/openapi.json")["paths"]
    assert "/api/fleet/orders/create" in paths
    assert "/api/entity/find/page" in paths
    assert site.client.get("/").status_code == 200


def test_errors_have_one_shape(site: Server) -> None:
    for answer in (
        site.client.get("/api/nowhere"),
        site.client.post("/api/fleet/orders/create", content=b"{"),
        site.client.delete("/api/fleet/orders/create"),
    ):
        assert 400 <= answer.status_code < 500
        assert answer.json().keys() == {"code", "message", "args"}


def rdscore_ports(site: Server) -> tuple[int, int]:
    line = next(x for x in site.log.read_text().splitlines() if "rdscore dialect" in x)
    http, websocket = (
        re.search(rf"{name}=(\d+)", line) for name in ("http_port", "websocket_port")
    )
    assert http is not None and websocket is not None
    return int(http[1]), int(websocket[1])


def test_the_second_dialect_answers_and_pushes(site: Server) -> None:
    http, websocket = rdscore_ports(site)
    status = httpx.get(f"http://127.0.0.1:{http}/robotsStatus").json()
    assert len(status["report"]) == 3
    wrong = httpx.get(f"http://127.0.0.1:{http}/robotsStatus", params={"devices": "toaster"})
    assert wrong.json()["code"] == 50002
    with connect(f"ws://127.0.0.1:{websocket}/robotsStatus") as socket_:
        frames = [json.loads(socket_.recv(timeout=10)) for _ in range(12)]
    created = [frame["create_on"] for frame in frames]
    assert len(set(created)) == len(created), "a frame came twice"
    assert created == sorted(created)
    assert all(frame.keys() == status.keys() for frame in frames)


def test_a_stream_of_events_goes_on_as_they_happen(site: Server) -> None:
    newest = site.get("/api/ledger/position")["position"]
    with site.client.stream(
        "GET", f"/api/ledger/events?after={newest}", headers={"accept": "text/event-stream"}
    ) as stream:
        made = site.order(BINS[3], BINS[4])
        for line in stream.iter_lines():
            if line.startswith("data: "):
                event = json.loads(line.removeprefix("data: "))
                if event["type"] == "OrderCreated" and event["order"] == made:
                    break
    assert event["position"] > newest


def test_it_stops_in_time_though_clients_hang_on(tmp_path: Path) -> None:
    with serving(tmp_path / "data", *OPEN, "--rdscore-port", "0") as server:
        _, websocket = rdscore_ports(server)
        stream = socket.create_connection(("127.0.0.1", server.port))
        stream.sendall(
            b"GET /api/ledger/events HTTP/1.1\r\nhost: x\r\naccept: text/event-stream\r\n\r\n"
        )
        assert select.select([stream], [], [], 30)[0]
        with connect(f"ws://127.0.0.1:{websocket}/robotsStatus"):
            assert server.stop() == 0
        stream.close()


def test_several_scenes_may_follow_one_flag(tmp_path: Path) -> None:
    first = small_scene(tmp_path)
    second = tmp_path / "second.json"
    second.write_bytes(write_scene(msgspec.structs.replace(small_file(), name="Annex")))

    with serving(tmp_path / "data", "--auth", "none", "--scene", str(first), str(second)) as server:
        names = {scene["name"] for scene in server.get("/api/fleet/scenes/list")}

    assert names == {small_file().name, "Annex"}
