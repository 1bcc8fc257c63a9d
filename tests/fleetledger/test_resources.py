"""Reserved ground on a real server: had, held against others, and not leaked by a crash."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx

from tests.fleetledger.server import serving, small_scene

URL = "/api/fleet/external-map-res"
EVERYTHING = [{"x": -500, "y": -500}, {"x": 500, "y": -500}, {"x": 500, "y": 500}]
HALL = {
    "unitId": "hall",
    "owner": "WMS",
    "spatialZones": [{"points": [*EVERYTHING, {"x": -500, "y": 500}], "type": "Rect"}],
}


def test_ground_is_had_released_and_not_leaked_by_a_crash(tmp_path: Path) -> None:
    options = ("--auth", "none", "--simulate", "--scene", str(small_scene(tmp_path)))
    with serving(tmp_path / "data", *options) as server:
        points = server.get(f"/api/fleet/scenes/{server.scene}/map")["areas"][0]["points"]
        free = {"unitId": "free", "owner": "WMS", "pointNames": [points[0]["name"]]}
        assert server.post(f"{URL}/request", [free]) == {"ok": True}
        assert server.post(f"{URL}/request", [free]) == {"ok": True}
        other = server.client.post(f"{URL}/request", json=[free | {"owner": "MES"}])
        assert (other.status_code, other.json()["code"]) == (400, "errExternalMapResHeld")
        with ThreadPoolExecutor(1) as pool:
            asking = pool.submit(server.client.post, f"{URL}/request", json=[HALL])
            server.until(lambda e: e["type"] == "MapResourcesAsked" and "hall" in str(e["units"]))
            server.kill()  # while robots stand where somebody waits for the ground
            assert isinstance(asking.exception(), httpx.HTTPError)
    with serving(tmp_path / "data", *options) as server:
        lapsed = server.until(lambda e: e["type"] == "MapResourcesReleased")
        assert (lapsed["units"], lapsed["lapsed"], lapsed["by"]) == (["hall"], True, "serve")
        held = server.post(f"/api/fleet/scenes/{server.scene}/query-all", {})["externalMapRes"]
        assert [(unit["unitId"], unit["granted"]) for unit in held] == [("free", True)]
        server.post(f"{URL}/release", ["free", "hall"])
        assert server.post(f"{URL}/request", [free | {"owner": "MES"}]) == {"ok": True}
