"""Acknowledged orders a second over HTTP, beside the disk's own rate in the same run.

The server runs as a user starts it; the load is a process of its own on the same two cores.
"""

import sys
from pathlib import Path

from bench.load import load, post, syncs_per_s
from bench.server import Running, running
from sim.warehouses import for_robots

CONNECTIONS = (1, 8, 32, 64)
SECONDS = 4.0
CONTROL_S = 1.0
WARM_S = 5.0


def _rows(server: Running, what: str, folder: Path) -> list[dict[str, float | str]]:
    bins = [
        b["name"]
        for a in server.get(f"/api/fleet/scenes/{server.scene}/map")["areas"]
        for b in a["bins"]
    ]
    load_step = {"location": bins[0], "rbkArgs": {"binTask": "Load"}, "forLoad": True}
    unload_step = {"location": bins[-1], "rbkArgs": {"binTask": "Unload"}, "forUnload": True}

    order = {"sceneId": server.scene, "stepFixed": True, "steps": [load_step, unload_step]}
    request = post("/api/fleet/orders/create", order)
    load(server.port, request, 8, WARM_S)  # the scheduler is still reading its map at first
    rows: list[dict[str, float | str]] = []
    for connections in CONNECTIONS:
        before = syncs_per_s(folder, CONTROL_S)
        figures = load(server.port, request, connections, SECONDS)
        after = syncs_per_s(folder, CONTROL_S)
        rows.append(
            {
                "what": f"create, {what}",
                "connections": float(connections),
                "orders_per_s": figures.per_s,
                "p50_ms": figures.p50_ms,
                "p99_ms": figures.p99_ms,
                "failed": float(figures.failed),
                "control_syncs_per_s": (before + after) / 2,
            }
        )
        print(
            ", ".join(f"{k} {v:,.2f}" if isinstance(v, float) else v for k, v in rows[-1].items())
        )
    return rows


def main() -> list[dict[str, float | str]]:
    """Measure an idle fleet, then 100 robots driving."""
    rows: list[dict[str, float | str]] = []
    with running(for_robots(20, 1)) as server:
        rows += _rows(server, "no robots", server.data.parent)
    if "--quick" not in sys.argv:
        with running(for_robots(100, 1), "--simulate") as server:
            rows += _rows(server, "100 robots driving", server.data.parent)
    return rows


if __name__ == "__main__":
    main()
