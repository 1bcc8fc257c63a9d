"""Golden requests with something changed, thousands of them, against a whole server.

Whatever comes: never a 500, never a hang, and what the ledger holds is what the server knows.
"""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

import httpx
import msgspec

from fleetledger.openapi import EXAMPLES_OF, examples
from ledger.snapshot import restore
from ledger.verify import verify
from tests.fleetledger.mutations import adapted, mutated
from tests.fleetledger.server import Server, serving, small_file, small_scene

REQUESTS_LONG = 8_000
REQUESTS = 2_500
ANSWERED = {200, 400, 401, 403, 404, 405, 413, 429}
SECONDS_MAX = 30.0
ORDERS_KEPT = 40
OF_OURS: dict[str, Any] = {
    "/api/entity/find/count": {"entityName": "TransportOrder", "query": {"type": "All"}},
    "/api/entity/find/batch": [{"type": "Many", "req": {"entityName": "TransportOrder"}}],
    "/api/fleet/scenes/{sceneId}/config": {"dispatchMethod": "KM", "chargingConfig": {}},
    "/api/fleet/scenes/{sceneId}/query-all": {
        "excluded": ["orders"],
        "orderQueryType": "AllOrders",
    },
    "/api/fleet/scenes/{sceneId}/calc-move-costs": {"AMB-01": ["ST-01"]},
    "/api/fleet/scenes/{sceneId}/dispatch-pause": {"paused": False},
    "/api/fleet/scenes/{sceneId}/callbacks": {"enableOrderCallback": False, "retryTimes": 3},
    "/api/fleet/scenes/{sceneId}/basic/patch": {"name": "hall", "displayOrder": 2},
    "/api/fleet/scenes/create": {"name": "second"},
    "/api/fleet/robots/pause-nav": {"sceneId": "", "robotNames": ["AMB-01"]},
    "/api/fleet/robots/resume-nav": {"sceneId": "", "robotNames": ["AMB-01"]},
    "/api/fleet/robots/cancel-nav": {"sceneId": "", "robotNames": ["AMB-01"]},
    "/api/fleet/orders/set-suspended": {"orderIds": ["TO20250806-000030"]},
    "/api/fleet/orders/unset-suspended": {"orderIds": ["TO20250806-000030"]},
    "/api/fleet/devices/doors/open-batch": {"sceneId": "", "ids": [1], "remark": ""},
    "/api/fleet/devices/lifts/keep-open": {"sceneId": "", "liftId": 1, "toAreaId": 0},
    "/api/fleet/robots/{sceneId}/clear-bins": {"robotNames": ["AMB-01"]},
    "/api/sign-in": {"username": "alice", "password": "secret"},
}


class Fuzzer:
    """Sends changed requests of one seed to one server."""

    def __init__(self, server: Server, seed: int) -> None:
        self.random = Random(seed)
        self.server = server
        self.seeds = list(OF_OURS.items())
        for group, path in EXAMPLES_OF.items():
            self.seeds += [(path, given["value"]) for given in examples(group, "request").values()]
        scene, area = server.scene, small_file().areas[0]
        self.orders: list[str] = ["TO20250806-000030"]
        robots = [str(robot.name) for robot in small_file().robots]
        places = [str(b.name) for b in area.bins] + [str(p.name) for p in area.points[:5]]
        self.real: dict[str, Sequence[str]] = {
            "sceneId": [scene],
            "orderId": self.orders,
            "orderIds": self.orders,
            "robotName": robots,
            "robotNames": robots,
            "expectedRobotNames": robots,
            "location": places,
            "keyLocations": places,
            "pointNames": [str(p.name) for p in area.points],
            "pathKeys": [str(p.key) for p in area.paths],
            "areaName": [area.name],
        }
        self.names = [scene, *robots, *places]

    def send(self) -> httpx.Response:
        """Send one; the answer is one of ours."""
        path, body = self.random.choice(self.seeds)
        path = path.replace("{sceneId}", self.random.choice((self.server.scene, "nowhere")))
        path = path.replace("{robotName}", "AMB-01")
        raw = mutated(self.random, adapted(self.random, body, self.real), self.names)
        headers = {"Idempotency-Key": f"k{self.random.randrange(50)}"}
        if self.random.random() < 0.9:
            headers = {}
        answer = self.server.client.post(path, content=raw, headers=headers, timeout=SECONDS_MAX)
        assert answer.status_code in ANSWERED, (answer.status_code, path, raw[:2_000])
        if answer.status_code >= 400:
            assert answer.json().keys() == {"code", "message", "args"}, (path, answer.text)
        elif path.endswith("orders/create") and len(self.orders) < ORDERS_KEPT:
            self.orders.append(answer.json()["orderId"])
        return answer


def fuzz(folder: Path, seed: int, requests: int) -> None:
    scene = small_scene(folder)
    data = folder / "data"
    options = ("--auth", "none", "--simulate", "--speed", "20", "--scene", str(scene))
    with serving(data, *options) as server:
        fuzzer = Fuzzer(server, seed)
        statuses = [fuzzer.send().status_code for _ in range(requests)]
        assert statuses.count(200) > requests / 20, "nearly everything was refused: fuzz deeper"
        assert server.stop() == 0
        assert "errServerBug" not in server.log.read_text()
        assert "Traceback" not in server.log.read_text(), server.log
    report = verify(data)
    assert report.sound, report
    kept = restore(data / "ledger", data / "snapshots").canonical()
    folded = restore(data / "ledger", data / "nothing-here").canonical()
    assert msgspec.json.decode(kept) == msgspec.json.decode(folded)


def test_almost_right_requests_never_fail_the_server(tmp_path: Path) -> None:
    fuzz(tmp_path, seed=1, requests=REQUESTS)


def stage(seed: int) -> None:
    """For the soak: other requests each time."""
    with tempfile.TemporaryDirectory() as folder:
        fuzz(Path(folder), seed=seed, requests=REQUESTS_LONG)
