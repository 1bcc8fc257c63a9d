"""Random calls, right and wrong, over HTTP to a whole server with simulated robots.

A reference model says of each what must come of it; after each run the ledger, folded anew from its
files, gives the same bytes as the server's live state.
"""

import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any, ClassVar

import hypothesis
import msgspec
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    rule,
    run_state_machine_as_test,
)

from ledger.snapshot import restore
from ledger.verify import verify
from tests.fleetledger.server import Server, serving, small_file
from tests.laws.reference import CELL_M, Model, Order, Robot

ORDERS, ROBOTS, GROUND = "/api/fleet/orders", "/api/fleet/robots", "/api/fleet/external-map-res"
RUNS, STEPS = 10, 40
STEPS_LONG = 100
NUMBER = st.integers(0, 2**16)
FAR_M = 1_000.0
READY_S_MAX = 30.0
OK = {"ok": True, "result": {}, "errMsg": None}
WRONG_ORDERS: tuple[tuple[dict[str, Any], str], ...] = (
    ({"steps": [{"location": "nowhere"}]}, "errLocationNotFound"),
    ({"steps": []}, "errOrderWithoutGoal"),
    ({"steps": [{"location": "ST-01", "forLoad": True, "forUnload": True}]}, "errStepLoads"),
    ({"expectedRobotNames": ["nobody"]}, "NoSuchRobot"),
    ({"expectedRobotGroups": ["none"]}, "errRobotGroupNotFound"),
    ({"externalId": "x" * 51}, "errExternalIdTooLong"),
    ({"containerTypeName": "ship"}, "errContainerTypeNotFound"),
    ({"priority": "high"}, "errFieldInvalid"),
    ({"steps": {"location": "ST-01"}}, "errFieldInvalid"),
    ({"steps": [{"location": "ST-01", "rbkArgs": {"binTask": "Juggle"}}]}, "errBinTask"),
    ({"sceneId": "gone"}, "errSceneNotFound"),
)


class HttpMachine(RuleBasedStateMachine):
    """Commands and questions against one scene, new for each run."""

    server: ClassVar[Server]
    numbers: ClassVar[Iterator[int]] = count(1)

    @initialize(robots=st.integers(2, 4))
    def open(self, robots: int) -> None:
        file = msgspec.structs.replace(small_file(robots), name=f"hall {next(self.numbers)}")
        self.model = Model()
        self.scene = str(self.good("/api/fleet/scenes/import", msgspec.to_builtins(file))["id"])
        self.model.robots = {str(r.name): Robot(simulated=True) for r in file.robots}
        self.bins = [str(b.name) for b in file.areas[0].bins]
        deadline = time.monotonic() + READY_S_MAX
        while not self.ready():
            assert time.monotonic() < deadline, "traffic has not placed the robots"

    def ready(self) -> bool:
        robots = self.server.get(f"{ROBOTS}/all-all", sceneId=self.scene)
        online = bool(robots) and all(row["online"] for row in robots.values())
        return online and bool(self.server.get(f"/api/fleet/scenes/{self.scene}/ready-status"))

    def call(self, path: str, body: Any) -> tuple[int, Any]:
        answer = self.server.client.post(path, json=body)
        assert answer.status_code in (200, 400), (path, body, answer.text)
        return answer.status_code, answer.json() if answer.content else None

    def good(self, path: str, body: Any) -> Any:
        status, answer = self.call(path, body)
        assert status == 200, (path, body, answer)
        return answer

    def bad(self, path: str, body: Any, code: str) -> None:
        status, answer = self.call(path, body)
        assert status == 400, (path, body, answer)
        assert answer["code"].startswith(code), (path, body, answer)

    def some(self, names: Any, number: int) -> str | None:
        known = sorted(names)
        return known[number % len(known)] if known else None

    def step(self, where: int, task: str = "Load") -> dict[str, Any]:
        loads = {"forLoad": task == "Load", "forUnload": task == "Unload"}
        return {"location": self.bins[where % len(self.bins)], "rbkArgs": {"binTask": task}} | loads

    @rule(
        a=NUMBER, b=NUMBER, sealed=st.booleans(), priority=st.integers(-5, 5), named=st.booleans()
    )
    def create(self, a: int, b: int, sealed: bool, priority: int, named: bool) -> None:
        external = f"wms-{a}" if named else None
        body = {
            "sceneId": self.scene,
            "externalId": external,
            "priority": priority,
            "stepFixed": sealed,
            "steps": [self.step(a), self.step(b, "Unload")],
        }
        made = self.good(f"{ORDERS}/create", body)
        assert made["externalId"] == external
        assert made["orderId"] not in self.model.orders
        self.model.orders[made["orderId"]] = Order(2, sealed, priority, external)

    @rule(wrong=st.sampled_from(WRONG_ORDERS))
    def create_wrongly(self, wrong: tuple[dict[str, Any], str]) -> None:
        fields, code = wrong
        body = {"sceneId": self.scene, "stepFixed": True, "steps": [self.step(0)]} | fields
        self.bad(f"{ORDERS}/create", body, code)

    @rule(n=NUMBER, where=NUMBER)
    def add_a_step(self, n: int, where: int) -> None:
        order = self.some(self.model.orders, n)
        if order is None:
            return
        body = {"orderId": order, "steps": [self.step(where)]}
        if self.model.may_change(order):
            self.good(f"{ORDERS}/add-steps", body)
            self.model.orders[order].steps += 1
        else:
            self.bad(f"{ORDERS}/add-steps", body, "errOrder")

    @rule(n=NUMBER)
    def seal(self, n: int) -> None:
        order = self.some(self.model.orders, n)
        if order is None:
            return
        if self.model.may_change(order):
            self.good(f"{ORDERS}/complete-order", {"orderId": order})
            self.model.orders[order].sealed = True
        elif self.model.orders[order].cancelled:
            self.bad(f"{ORDERS}/complete-order", {"orderId": order}, "errOrderTerminal")

    @rule(n=NUMBER, m=NUMBER)
    def cancel(self, n: int, m: int) -> None:
        orders = [o for o in (self.some(self.model.orders, k) for k in (n, m)) if o is not None]
        if not orders:
            return
        results = self.good(f"{ORDERS}/cancel-batch", {"orderIds": [*orders, "none"]})
        assert [results[o]["ok"] for o in (*orders, "none")] == [*(True for _ in orders), False]
        status = self.found(*orders)
        for order in orders:
            if status[order]["status"] == "Cancelled":
                self.model.orders[order].cancelled = True
            else:
                assert status[order]["status"] == "Done"

    @rule(n=NUMBER, priority=st.integers(-5, 5))
    def prioritise(self, n: int, priority: int) -> None:
        order = self.some(self.model.orders, n)
        if order is None:
            return
        body = {"orderIds": [order], "priority": priority}
        if self.model.may_change(order):
            self.good(f"{ORDERS}/update-priority-batch", body)
            self.model.orders[order].priority = priority
        elif self.model.orders[order].cancelled:
            self.bad(f"{ORDERS}/update-priority-batch", body, "errOrderTerminal")

    @rule(n=NUMBER, suspended=st.booleans())
    def suspend(self, n: int, suspended: bool) -> None:
        order = self.some(self.model.orders, n)
        if order is None or not self.model.may_change(order):
            return
        call = "set-suspended" if suspended else "unset-suspended"
        assert self.good(f"{ORDERS}/{call}", {"orderIds": [order]}) == {order: OK}
        self.model.orders[order].suspended = suspended

    @rule(n=NUMBER, on=st.booleans())
    def off_duty(self, n: int, on: bool) -> None:
        robot = self.some(self.model.robots, n)
        assert robot is not None
        body = {"sceneId": self.scene, "robotNames": [robot, "nobody"], "offDuty": on}
        results = self.good(f"{ROBOTS}/off-duty", body)
        assert (results[robot]["ok"], results["nobody"]["ok"]) == (True, False)
        self.model.robots[robot].off_duty = on

    @rule(n=NUMBER, on=st.booleans())
    def disable(self, n: int, on: bool) -> None:
        robot = self.some(self.model.robots, n)
        assert robot is not None
        path = f"{ROBOTS}/{self.scene}/disabled"
        assert self.good(path, {"robotNames": [robot], "disabled": on}) is None
        self.bad(path, {"robotNames": [robot, "nobody"], "disabled": not on}, "NoSuchRobot")
        self.model.robots[robot].disabled = on

    @rule(n=NUMBER, call=st.sampled_from(("set-soft-emc", "clear-alarm", "auto-recovery")))
    def tell(self, n: int, call: str) -> None:
        robot = self.some(self.model.robots, n)
        body: dict[str, Any] = {"robotNames": [robot, "nobody"]}
        if call == "set-soft-emc":
            body["enable"] = n % 2 == 0
        results = self.good(f"{ROBOTS}/{self.scene}/{call}", body)
        assert list(results) == [robot, "nobody"]
        assert not results["nobody"]["ok"]

    @rule(n=NUMBER)
    def add_a_robot(self, n: int) -> None:
        name, path = f"Spare-{n % 5}", f"/api/fleet/scenes/{self.scene}/robot/create"
        if name in self.model.robots:
            self.bad(path, {"robotName": name}, "errRobotNameTaken")
        else:
            self.good(path, {"robotName": name})
            self.model.robots[name] = Robot(simulated=False)

    @rule(n=NUMBER)
    def remove_a_robot(self, n: int) -> None:
        spare = [name for name, robot in self.model.robots.items() if not robot.simulated]
        robot = self.some(spare, n)
        if robot is not None:
            path = f"/api/fleet/scenes/{self.scene}/robot/remove"
            self.good(path, {"robotNames": [robot]})
            del self.model.robots[robot]
            self.bad(path, {"robotNames": [robot]}, "NoSuchRobot")

    @rule(n=NUMBER, remark=st.sampled_from(("a", "b", "")))
    def set_up_a_robot(self, n: int, remark: str) -> None:
        robot = self.some(self.model.robots, n)
        path = f"/api/fleet/scenes/{self.scene}/robot/update/config/batch"
        body = {"robotNames": [robot, "nobody"], "config": {"remark": remark}}
        results = self.good(path, body)
        assert [results[name]["ok"] for name in (robot, "nobody")] == [True, False]

    @rule(unit=st.integers(0, 4), owner=st.sampled_from("ab"), x=st.integers(0, 2))
    def reserve(self, unit: int, owner: str, x: int) -> None:
        id_ = f"{self.scene}-{unit}"
        left = FAR_M + 2 * CELL_M * x
        corners = [(0.0, 0.0), (CELL_M, 0.0), (CELL_M, CELL_M), (0.0, CELL_M)]
        points = [{"x": left + a, "y": FAR_M + b} for a, b in corners]
        zone = {"type": "Rect", "points": points}
        body = [{"unitId": id_, "owner": owner, "sceneId": self.scene, "spatialZones": [zone]}]
        if self.model.free_for(id_, owner, x):
            assert self.good(f"{GROUND}/request", body) == {"ok": True}
            self.model.units[id_] = (owner, x)
        else:
            self.bad(f"{GROUND}/request", body, "errExternalMapRes")

    @rule(unit=st.integers(0, 4))
    def release(self, unit: int) -> None:
        id_ = f"{self.scene}-{unit}"
        assert self.good(f"{GROUND}/release", [id_]) is None
        self.model.units.pop(id_, None)

    @rule(cost=st.floats(0, 100), paused=st.booleans())
    def configure(self, cost: float, paused: bool) -> None:
        path = f"/api/fleet/scenes/{self.scene}/config"
        wanted = {"withdrawnMinCost": cost, "parkingPaused": paused}
        assert self.good(path, wanted) is None
        self.bad(path, {"withdrawnMinCost": "dear"}, "errFieldInvalid")
        self.bad(path, {"noOpLog": True}, "errSceneConfig")
        assert self.server.get(path).items() >= wanted.items()

    def found(self, *ids: str) -> dict[str, Any]:
        return self.server.found(*ids)

    @invariant()
    def orders_are_as_the_model_has_them(self) -> None:
        if not hasattr(self, "model") or not self.model.orders:
            return
        rows = self.found(*self.model.orders)
        assert rows.keys() == self.model.orders.keys(), "an acknowledged order is missing"
        for id_, order in self.model.orders.items():
            row = rows[id_]
            known = (order.sealed, order.priority, order.steps, order.external_id)
            fields = ("stepFixed", "priority", "stepNum", "externalId")
            assert tuple(row[f] for f in fields) == known, id_
            assert (row["status"] == "Cancelled") is order.cancelled, id_
            assert order.sealed or row["status"] != "Done", id_

    @invariant()
    def robots_are_as_the_model_has_them(self) -> None:
        if not hasattr(self, "model"):
            return
        seen = self.server.get(f"{ROBOTS}/all-all", sceneId=self.scene)
        wanted = {name: r.off_duty for name, r in self.model.robots.items() if not r.disabled}
        assert {name: row["offDuty"] for name, row in seen.items()} == wanted

    def teardown(self) -> None:
        if not hasattr(self, "scene"):
            return
        self.good(f"{ORDERS}/cancel-all", {"sceneId": self.scene})
        live = self.server.client.get("/api/ledger/state").content
        position = msgspec.json.decode(live)["position"]
        data = self.server.data
        folded = restore(data / "ledger", data / "no-snapshots", position=position)
        assert folded.canonical() == live, "the ledger tells another story than the server"
        self.good(f"/api/fleet/scenes/{self.scene}/disable", {"disabled": True})


def run(tmp_path: Any, runs: int, steps: int, seed: int | None = None) -> None:
    data = tmp_path / "data"
    options = ("--auth", "none", "--simulate", "--speed", "20")
    with serving(data, *options) as server:
        HttpMachine.server = server
        run_state_machine_as_test(
            HttpMachine if seed is None else hypothesis.seed(seed)(HttpMachine),
            settings=settings(
                max_examples=runs,
                stateful_step_count=steps,
                deadline=None,
                phases=[Phase.generate],  # robots go on in the meantime: no run repeats itself
                database=None,
                suppress_health_check=list(HealthCheck),
            ),
        )
        with suppress(AttributeError):
            del HttpMachine.server
        assert server.stop() == 0
    assert verify(data).sound


def test_a_server_does_what_its_clients_may_expect(tmp_path: Any) -> None:
    run(tmp_path, RUNS, STEPS)


def stage(seed: int) -> None:
    """For the soak: other calls each time, and more of them in a row."""
    with tempfile.TemporaryDirectory() as folder:
        run(Path(folder), RUNS, STEPS_LONG, seed)
