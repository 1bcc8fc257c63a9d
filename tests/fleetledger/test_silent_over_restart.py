"""Robots that do not answer keep their ground over a restart of the whole server."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ledger.ids import SceneId
from ledger.telemetry_read import last_plans
from tests.fleetledger.server import EVENT_S_MAX, Server, serving, small_scene

Rows = dict[str, dict[str, Any]]


def until(server: Server, wanted: Callable[[Rows], bool]) -> Rows:
    """Ask for all robots until they are as wanted."""
    deadline = time.monotonic() + EVENT_S_MAX
    while True:
        rows: Rows = server.get("/api/fleet/robots/all-all", sceneId=server.scene)
        if wanted(rows):
            return rows
        assert time.monotonic() < deadline, rows
        time.sleep(0.1)  # telemetry and plans have no event to wait for


def at_rest(rows: Rows) -> bool:
    return all(row["tReady"] and row["spaces"] and not row["unTravelled"] for row in rows.values())


def written(data: Path, scene: str) -> int:
    """How many robots at rest the log on disk knows."""
    plans = last_plans(data / "telemetry", SceneId(scene)).values()
    return sum(plan.ready and bool(plan.spaces) and not plan.untravelled for plan in plans)


def test_after_a_kill_robots_that_stay_silent_hold_the_ground_they_had(tmp_path: Path) -> None:
    data, scene = tmp_path / "data", str(small_scene(tmp_path))
    with serving(data, "--auth", "none", "--simulate", "--scene", scene) as server:
        before = until(server, at_rest)
        until(server, lambda rows: written(data, server.scene) == len(rows))
        server.kill()
    with serving(data, "--auth", "none") as server:  # nobody drives the robots
        after = until(server, lambda rows: not any(row["tReady"] for row in rows.values()))
    assert len(before) == 3
    for name, row in before.items():
        assert after[name]["spaces"] == row["spaces"], name
        assert (after[name]["x"], after[name]["y"]) == (row["x"], row["y"])
