"""Orders for the demo: seeded loads between bins, sent over HTTP like anybody's."""

import http.client
import json
import random
import threading
from typing import Any

import structlog

log = structlog.get_logger()

OPEN_ORDERS_PER_ROBOT = 3  # no more are sent while so many wait: a demo should not drown
TIMEOUT_S = 10.0


class OrderStream:
    """Sends orders at a steady rate in a thread of its own until stopped."""

    def __init__(self, port: int, *, per_minute: float, robots: int, seed: int) -> None:
        """Take where to send, how many orders a minute of wall time, and for how many robots."""
        self._port = port
        self._pause_s = 60.0 / per_minute if per_minute else float("inf")
        self._open_max = OPEN_ORDERS_PER_ROBOT * robots
        self._random = random.Random(seed)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="orders", daemon=True)

    def start(self) -> None:
        """Begin to send."""
        if self._pause_s != float("inf"):
            self._thread.start()

    def stop(self) -> None:
        """Send no more."""
        self._stop.set()

    def _run(self) -> None:
        try:
            scene = self._call("GET", "/api/fleet/scenes/list")[0]["id"]
            places = self._call("GET", f"/api/fleet/scenes/{scene}/map")
            bins = [b["name"] for area in places["areas"] for b in area["bins"]]
            while not self._stop.is_set():
                if self._open() < self._open_max:
                    self._send(scene, *self._random.sample(bins, 2))
                self._stop.wait(self._pause_s)
        except (OSError, http.client.HTTPException, RuntimeError) as trouble:
            if not self._stop.is_set():
                log.error("no more demo orders", reason=str(trouble))

    def _open(self) -> int:
        status = {
            "type": "General",
            "field1": "status",
            "operator": "In",
            "value": ["ToBeAllocated", "Allocated", "Executing", "Pending"],
        }
        body = {"entityName": "TransportOrder", "query": status}
        return int(self._call("POST", "/api/entity/find/count", body)["count"])

    def _send(self, scene: str, source: str, target: str) -> None:
        load = {
            "location": source,
            "rbkArgs": {"binTask": "Load"},
            "forLoad": True,
            "withdrawOrderAllowed": True,
        }
        unload = {"location": target, "rbkArgs": {"binTask": "Unload"}, "forUnload": True}
        order = {"sceneId": scene, "stepFixed": True, "steps": [load, unload]}
        self._call("POST", "/api/fleet/orders/create", order)

    def _call(self, method: str, path: str, body: object = None) -> Any:
        connection = http.client.HTTPConnection("127.0.0.1", self._port, timeout=TIMEOUT_S)
        try:
            raw = None if body is None else json.dumps(body)
            connection.request(method, path, raw, {"content-type": "application/json"})
            answer = connection.getresponse()
            text = answer.read()
        finally:
            connection.close()
        if answer.status != 200:
            raise RuntimeError(f"{method} {path}: {answer.status} {text[:200]!r}")
        return json.loads(text)
