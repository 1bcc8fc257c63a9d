"""`noRbkMsgLog` on a real server: what robots of such a scene said is not there afterwards."""

import msgspec

from ledger.scene_config import SceneConfig
from tests.conformance.plant import Plant
from tests.fleetledger.server import order_body, small_file


def test_a_scene_that_keeps_no_messages_shows_no_robots_of_the_past(plant: Plant) -> None:
    server = plant.server
    config = SceneConfig(robot_message_log_off=True, parking_paused=True)
    file = msgspec.structs.replace(small_file(robots=1), name="quiet", config=config)
    quiet = server.post("/api/fleet/scenes/import", msgspec.to_builtins(file))["id"]
    bins = [str(b.name) for b in file.areas[0].bins]
    order = server.post("/api/fleet/orders/create", order_body(quiet, bins[0], bins[1]))["orderId"]
    then = server.until_finished(order)["at_ms"]  # it has reported for long by now
    (robot,) = (str(r.name) for r in file.robots)
    seen = {
        (scene, when): "x" in server.get("/api/fleet/robots/all-all", sceneId=scene, **asked)[robot]
        for scene in (plant.scene, quiet)
        for when, asked in (("now", {}), ("then", {"asOf": then}))
    }
    server.post("/api/fleet/scenes/remove", {"ids": [quiet]})
    assert seen == {
        (plant.scene, "now"): True,
        (plant.scene, "then"): True,
        (quiet, "now"): True,
        (quiet, "then"): False,
    }
