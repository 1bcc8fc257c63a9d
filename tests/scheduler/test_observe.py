"""Which robots answer."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ledger.ids import RobotName, robot_key
from ledger.proposals import ConnectRobot, DisconnectRobot
from ledger.scene import RobotConfig
from ledger.scene_config import SceneConfig
from ledger.state import Robot
from scheduler.observe import Sighting, is_seen, lost_after_ms, observe
from tests.scheduler.small_site import SCENE

NAME = RobotName("A")
KEY = robot_key(SCENE, NAME)
SILENT_MS = lost_after_ms(SceneConfig())


def robot(*, online: bool) -> Robot:
    return Robot(
        scene=SCENE, config=RobotConfig(name=NAME), online=online, bins=(), idle_since_ms=0
    )


sightings = st.builds(
    Sighting,
    reported_ms=st.none() | st.integers(0, 100_000),
    alive=st.sampled_from([None, True, False]),
)


@given(st.booleans(), st.none() | sightings, st.integers(0, 100_000))
def test_what_the_ledger_knows_follows_what_is_seen(
    online: bool, sighting: Sighting | None, now_ms: int
) -> None:
    known = {} if sighting is None else {KEY: sighting}
    long_ago_ms = now_ms - SILENT_MS - 1
    found = observe([robot(online=online)], known, SILENT_MS, long_ago_ms, now_ms)
    seen = is_seen(sighting, SILENT_MS, now_ms)
    if seen == online:
        assert found == ()
    else:
        assert [type(p) for p in found] == [ConnectRobot if seen else DisconnectRobot]


@pytest.mark.parametrize(
    ("reported_ms", "alive", "seen"),
    [(5_000, True, True), (5_000, None, True), (5_000, False, False), (None, True, False),
     (-5_001, True, False), (-5_000, True, True)],
)  # fmt: skip
def test_a_robot_answers_if_it_reports_and_its_token_is_not_gone(
    reported_ms: int | None, alive: bool | None, seen: bool
) -> None:
    assert is_seen(Sighting(reported_ms=reported_ms, alive=alive), SILENT_MS, 5_000) is seen


def test_a_robot_known_from_before_our_start_gets_time_to_speak_up() -> None:
    before = robot(online=True)
    assert observe([before], {}, SILENT_MS, 0, SILENT_MS) == ()
    assert len(observe([before], {}, SILENT_MS, 0, SILENT_MS + 1)) == 1
    assert len(observe([before], {KEY: Sighting(alive=False)}, SILENT_MS, 0, 1)) == 1


@given(st.integers(1, 100), st.integers(10, 60_000))
def test_one_late_report_loses_nobody_however_the_scene_is_set(missed: int, every_ms: int) -> None:
    config = SceneConfig(state_failures_to_reconnect=missed, state_fetch_ms=every_ms)
    silent_ms = lost_after_ms(config)
    assert silent_ms >= missed * every_ms
    assert silent_ms > every_ms + 1_000
    assert lost_after_ms(SceneConfig()) == 10_000
