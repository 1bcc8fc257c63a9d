from pathlib import Path

from fleetledger.access.registry import User
from fleetledger.access.sessions import (
    AGE_MS,
    FILE_NAME,
    IDLE_MS,
    OF_USER_MAX,
    USED_APART_MS,
    Sessions,
)
from ledger.events import Role

ANNA = User(role=Role.VIEWER, password="hash", stamp="s1")


class Clock:
    now_ms = 1_000_000_000

    def __call__(self) -> int:
        return self.now_ms


async def test_a_session_outlives_a_restart_and_only_its_digest_is_kept(tmp_path: Path) -> None:
    sessions = Sessions(tmp_path, Clock())
    token = sessions.begin("anna", ANNA)
    await sessions.keep()

    again = Sessions(tmp_path, Clock())

    found = again.session(token)
    assert found is not None
    assert (found.user, found.stamp) == ("anna", "s1")
    assert token not in (tmp_path / FILE_NAME).read_text()
    assert (tmp_path / FILE_NAME).stat().st_mode & 0o077 == 0
    assert again.session(token + "x") is None
    assert again.session("") is None


async def test_a_session_ends_when_it_is_not_used_and_when_it_is_old(tmp_path: Path) -> None:
    clock = Clock()
    sessions = Sessions(tmp_path, clock)
    idle, busy = sessions.begin("anna", ANNA), sessions.begin("anna", ANNA)
    begun_ms = clock.now_ms

    clock.now_ms = begun_ms + IDLE_MS - 1
    assert sessions.session(busy) is not None
    clock.now_ms = begun_ms + IDLE_MS
    assert sessions.session(idle) is None
    while clock.now_ms < begun_ms + AGE_MS:
        assert sessions.session(busy) is not None
        clock.now_ms += IDLE_MS // 2
    assert sessions.session(busy) is None


async def test_use_is_kept_now_and_then(tmp_path: Path) -> None:
    clock = Clock()
    sessions = Sessions(tmp_path, clock)
    token = sessions.begin("anna", ANNA)
    await sessions.keep()
    clock.now_ms += USED_APART_MS
    sessions.session(token)
    await sessions.keep()

    clock.now_ms += IDLE_MS - 1
    assert Sessions(tmp_path, clock).session(token) is not None


async def test_an_ended_one_stays_ended(tmp_path: Path) -> None:
    sessions = Sessions(tmp_path, Clock())
    token = sessions.begin("anna", ANNA)
    await sessions.keep()
    sessions.end(token)
    await sessions.keep()

    assert sessions.session(token) is None
    assert Sessions(tmp_path, Clock()).session(token) is None


async def test_the_sessions_of_a_user_are_few_and_the_unused_one_goes(tmp_path: Path) -> None:
    clock = Clock()
    sessions = Sessions(tmp_path, clock)
    first = sessions.begin("anna", ANNA)
    others = []
    for _ in range(OF_USER_MAX):
        clock.now_ms += 1
        others.append(sessions.begin("anna", ANNA))

    assert sessions.session(first) is None
    assert all(sessions.session(token) is not None for token in others)


async def test_those_of_users_who_may_not_any_more_are_forgotten(tmp_path: Path) -> None:
    sessions = Sessions(tmp_path, Clock())
    gone, stays = sessions.begin("anna", ANNA), sessions.begin("bob", ANNA)

    sessions.tidy(lambda session: session.user == "bob")

    assert sessions.session(gone) is None
    assert sessions.session(stays) is not None


async def test_a_clock_set_back_signs_nobody_out_and_prolongs_nothing(tmp_path: Path) -> None:
    clock = Clock()
    clock.now_ms = 400 * AGE_MS
    sessions = Sessions(tmp_path, clock)
    used, kept = sessions.begin("anna", ANNA), sessions.begin("anna", ANNA)
    await sessions.keep()
    clock.now_ms = AGE_MS  # years back
    assert sessions.session(used) is not None
    clock.now_ms += IDLE_MS
    assert sessions.session(used) is None, "not for the years until the clock has caught up"
    clock.now_ms = AGE_MS
    again = Sessions(tmp_path, clock)
    assert again.session(kept) is not None
    clock.now_ms += IDLE_MS
    assert again.session(kept) is None
    again.tidy(lambda session: True)
    assert again.session(kept) is None
