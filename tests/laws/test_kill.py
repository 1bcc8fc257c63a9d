"""Kill -9 under load: what was acknowledged is there, once, and the fleet goes on."""

import itertools
import tempfile
import threading
from pathlib import Path
from random import Random

import httpx
from typer.testing import CliRunner

from fleetledger.cli import app
from tests.fleetledger.server import (
    Server,
    order_body,
    serving,
    small_file,
    small_scene,
    still_there,
)
from tests.laws.onlooker import bins_of

CLIENTS = 4
CREATE = "/api/fleet/orders/create"
BINS = bins_of(small_file())
OPTIONS = ("--simulate", "--auth", "none", "--speed", "20")


class Clients:
    """Threads that send orders until the server is gone; they keep what it acknowledged."""

    def __init__(self, server: Server, round_: int, rng: Random) -> None:
        self.acknowledged: dict[str, str] = {}  # Idempotency-Key -> order
        self.unanswered: list[str] = []
        self.enough = threading.Event()
        self.problems: list[str] = []
        self._wanted = rng.randint(1, 400)
        self._server, self._scene = server, server.scene
        self._threads = [
            threading.Thread(target=self._send, args=(f"{round_}-{n}", Random(rng.random())))
            for n in range(CLIENTS)
        ]
        for thread in self._threads:
            thread.start()

    def body(self, key: str) -> dict[str, object]:
        """The order of a key: the same each time."""
        source, target = Random(key).sample(BINS, 2)
        return order_body(self._scene, source, target)

    def _send(self, name: str, rng: Random) -> None:
        with httpx.Client(base_url=self._server.url, timeout=30) as client:
            for number in itertools.count():
                key = f"{name}-{number}"
                try:
                    answer = client.post(
                        CREATE,
                        json=self.body(key),
                        headers={"Idempotency-Key": key},
                    )
                except httpx.TransportError:
                    self.unanswered.append(key)
                    return
                if answer.status_code != 200:
                    self.problems.append(answer.text)
                    self.enough.set()
                    return
                self.acknowledged[key] = answer.json()["orderId"]
                if len(self.acknowledged) >= self._wanted:
                    self.enough.set()

    def join(self) -> None:
        for thread in self._threads:
            thread.join(60)
        assert not self.problems


def _rounds(tmp_path: Path, seed: int, rounds: int) -> None:
    rng, data, scene = Random(seed), tmp_path / "data", small_scene(tmp_path)
    options: tuple[str, ...] = (*OPTIONS, "--scene", str(scene))
    orders: dict[str, str] = {}  # all that was ever acknowledged, by Idempotency-Key
    clients: Clients | None = None
    for round_ in range(rounds):
        with serving(data, *options) as server:
            if clients is not None:
                _nothing_is_lost(server, orders, clients, rng)
                _goes_on(server, orders)
            clients = Clients(server, round_, rng)
            assert clients.enough.wait(60)
            server.kill()
            clients.join()
            assert still_there(server.children, 30.0) == []
        _is_sound(data)
        options = OPTIONS  # the folder knows its scene
    assert clients is not None
    with serving(data, *options) as server:
        _nothing_is_lost(server, orders, clients, rng)
        _goes_on(server, orders)
        assert server.stop() == 0
        assert still_there(server.children, 30.0) == []


def _nothing_is_lost(server: Server, orders: dict[str, str], clients: Clients, rng: Random) -> None:
    """All acknowledged orders are there; what got no answer may be sent again with its key."""
    assert not set(orders.values()) & set(clients.acknowledged.values())
    orders |= clients.acknowledged
    unasked = _business(server) - set(orders.values())
    assert len(unasked) <= len(clients.unanswered)
    for key in [*clients.unanswered, *rng.sample(sorted(clients.acknowledged), 1)]:
        made = server.post(CREATE, clients.body(key), **{"Idempotency-Key": key})
        assert orders.setdefault(key, made["orderId"]) == made["orderId"]
    assert _business(server) == set(orders.values()), "lost or doubled"


def _business(server: Server) -> set[str]:
    return {id_ for id_, row in server.found().items() if row["kind"] == "Business"}


def _is_sound(data: Path) -> None:
    checked = CliRunner().invoke(app, ["verify", str(data)])
    assert checked.exit_code == 0, checked.output
    assert "sound" in checked.output


def _goes_on(server: Server, orders: dict[str, str]) -> None:
    """One more order, before all that wait, is carried out by the robots as they are."""
    source, target = BINS[0], BINS[-1]
    body = order_body(server.scene, source, target) | {"priority": 1000}
    made = server.post(CREATE, body)["orderId"]
    orders[f"more {made}"] = made
    server.until_finished(made)


def test_acknowledged_orders_survive_kill_9_and_the_fleet_goes_on(tmp_path: Path) -> None:
    _rounds(tmp_path, seed=1, rounds=2)


def stage(seed: int) -> None:
    """For the soak: more rounds, other moments."""
    with tempfile.TemporaryDirectory() as folder:
        _rounds(Path(folder), seed, rounds=3)
