"""`/wsm` of a real server, asked with a client that is not ours."""

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from tests.fleetledger.server import Server, serving, small_file, small_scene

OPTIONS = ("--auth", "none", "--simulate", "--speed", "10")
SUBSCRIBE = "Fleetledger::Scene::Subscribe"
SNAPSHOT, DELTA = "Fleetledger::Scene::Snapshot", "Fleetledger::Scene::Delta"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("wsm")
    with serving(folder / "data", "--scene", str(small_scene(folder)), *OPTIONS) as server:
        yield server


def opened(server: Server, query: str = "", **more: Any) -> ClientConnection:
    url = f"{server.url.replace('http', 'ws')}/wsm{query}"
    return connect(url, compression=None, max_size=None, **more)


def frame(socket: ClientConnection) -> Any:
    read = json.loads(socket.recv(timeout=30))
    return read | {"content": json.loads(read["content"])}


def ask(socket: ClientConnection, action: str, content: Any, id_: str = "1") -> Any:
    body = {"id": id_, "action": action, "content": json.dumps(content)}
    socket.send(json.dumps(body))
    while (read := frame(socket))["replyToId"] != id_:
        pass
    return read


def test_an_order_is_followed_from_frame_to_frame_to_its_end(server: Server) -> None:
    bins = [b.name for b in small_file().areas[0].bins]
    with opened(server) as socket:
        assert ask(socket, SUBSCRIBE, {"sceneId": server.scene})["action"] == f"{SUBSCRIBE}::Reply"
        while (read := frame(socket))["action"] != SNAPSHOT:
            pass
        seq, statuses = read["content"]["seq"], []
        order = server.order(bins[0], bins[1])
        while not statuses or statuses[-1] is not None:
            read = frame(socket)
            assert read["action"] in (DELTA, SNAPSHOT)
            if read["action"] == DELTA:
                assert read["content"]["seq"] == seq + 1
                orders = read["content"].get("orders", {})
                if order in orders:
                    statuses.append(orders[order] and orders[order]["status"])
            seq = read["content"]["seq"]
        assert statuses[-2:] == ["Executing", None]
        detail = ask(socket, "Fleet::OrderDetail::Query", {"orderId": order})
        assert detail["action"] == "Fleet::OrderDetail::Reply"
        assert detail["content"]["status"] == "Done"


def test_the_socket_answers_what_http_answers(server: Server) -> None:
    asked = {"excluded": ["robots", "replyTimestamp", "trafficDebug", "trafficConditions"]}
    with opened(server, "?naming=appended") as socket:
        reply = ask(socket, "Fleet::Scene", {"sceneId": server.scene} | asked)
    assert reply["action"] == "Fleet::Scene::Reply"
    assert reply["content"] == server.post(f"/api/fleet/scenes/{server.scene}/query-all", asked)


def test_pings_are_answered_and_bad_frames_do_no_harm(server: Server) -> None:
    with opened(server) as socket:
        assert socket.ping().wait(10)
        for bad in ("{", "[" * 60_000, "x" * 70_000, b"{}", ""):
            socket.send(bad)
            assert frame(socket)["action"] == "::Error"
        reply = ask(socket, "Fleet3::AllRobotsUiReports::Query", {"sceneId": server.scene})
        assert reply["content"].keys() == {r.name for r in small_file().robots}


def test_a_frame_beyond_all_measure_closes_the_connection(server: Server) -> None:
    with opened(server) as socket:
        socket.send("x" * 1_100_000)
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=10)
        assert closed.value.rcvd is not None and closed.value.rcvd.code == 1009


def test_only_who_is_known_is_answered_and_open_sockets_stop_no_server(tmp_path: Path) -> None:
    scene = small_scene(tmp_path)
    with serving(tmp_path / "data", "--scene", str(scene)) as server:
        log = server.log.read_text()
        words = dict(part.split("=", 1) for part in log.split() if "xyy-app-" in part)
        key = words["xyy-app-key"].strip("'")
        headers = {"xyy-app-id": "fleetledger", "xyy-app-key": key}
        server.client.headers.update(headers)
        for wrong in ({}, headers | {"xyy-app-key": "guess"}):
            with opened(server, additional_headers=wrong) as socket:  # the handshake succeeds
                read = frame(socket)
                assert (read["action"], read["content"]["error"]) == ("::Error", 401)
                with pytest.raises(ConnectionClosed):
                    socket.recv(timeout=10)
        with opened(server, additional_headers=headers) as socket:
            ask(socket, SUBSCRIBE, {"sceneId": server.scene})
            began = time.monotonic()
            assert server.stop() == 0
            assert time.monotonic() - began < 5
            with pytest.raises(ConnectionClosed):
                while True:
                    socket.recv(timeout=10)
