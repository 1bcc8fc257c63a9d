"""Which robots answer."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ledger.ids import RobotName, robot_key
from ledger.proposals import ConnectRobot, DisconnectRobot
from ledger.scene import RobotConfig
from ledger.state import Robot
from scheduler.observe import REPORT_AGE_MS_MAX, Sighting, is_seen, observe
from tests.scheduler.small_site import SCENE

NAME = RobotName("A")
KEY = robot_key(SCENE, NAME)


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
    long_ago_ms = now_ms - REPORT_AGE_MS_MAX - 1
    found = observe([robot(online=online)], known, long_ago_ms, now_ms)
    seen = is_seen(sighting, now_ms)
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
    assert is_seen(Sighting(reported_ms=reported_ms, alive=alive), 5_000) is seen


def test_a_robot_known_from_before_our_start_gets_time_to_speak_up() -> None:
    before = robot(online=True)
    assert observe([before], {}, 0, REPORT_AGE_MS_MAX) == ()
    assert len(observe([before], {}, 0, REPORT_AGE_MS_MAX + 1)) == 1
    assert len(observe([before], {KEY: Sighting(alive=False)}, 0, 1)) == 1
