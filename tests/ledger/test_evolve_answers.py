import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ledger import evolve_answers
from ledger.events import AnswersWindowSet, AnyEvent, CommandAnswered, stamped
from ledger.evolve import evolve, fold
from ledger.evolve_answers import answer_to
from ledger.ids import CommandId, SceneId
from ledger.snapshot import check, to_bytes
from ledger.state import AnswersWindow, Fleet
from tests.strategies import DAY_MS

NOWHERE = SceneId("")
DAY_LONG_MS = 24 * 3_600_000


def answered(key: str, at_ms: int, body: str = "{}") -> AnyEvent:
    event = CommandAnswered(scene=NOWHERE, digest="d", status=200, body=body)
    return stamped(event, 1, at_ms, "alice", CommandId(key))


def window(count_max: int, age_s_max: int, at_ms: int = 0) -> AnyEvent:
    event = AnswersWindowSet(scene=NOWHERE, count_max=count_max, age_s_max=age_s_max)
    return stamped(event, 1, at_ms, "serve", CommandId("w"))


def test_before_any_server_says_otherwise_ten_thousand_answers_are_kept_for_a_day() -> None:
    assert AnswersWindow() == AnswersWindow(count_max=10_000, age_ms_max=DAY_LONG_MS)
    fleet = fold(Fleet(), (answered(f"k{n}", n) for n in range(10_001)))
    assert len(fleet.answers) == 10_000
    assert "k0" not in fleet.answers


def test_an_answer_is_given_to_the_end_of_its_age_and_no_longer() -> None:
    fleet = fold(Fleet(), [window(10, 60), answered("k", DAY_MS)])
    assert answer_to(fleet, CommandId("k"), DAY_MS + 60_000) is not None
    assert answer_to(fleet, CommandId("k"), DAY_MS + 60_001) is None
    assert answer_to(fleet, CommandId("other"), DAY_MS) is None
    evolve(fleet, answered("later", DAY_MS + 60_000))
    assert list(fleet.answers) == ["k", "later"]
    evolve(fleet, answered("latest", DAY_MS + 60_001))
    assert list(fleet.answers) == ["later", "latest"]


def test_a_narrower_window_forgets_at_once_and_a_wider_one_brings_nothing_back() -> None:
    fleet = fold(Fleet(), (answered(f"k{n}", n * 1000) for n in range(5)))
    evolve(fleet, window(2, 60, 4000))
    assert list(fleet.answers) == ["k3", "k4"]
    evolve(fleet, window(100, 3600, 4000))
    assert list(fleet.answers) == ["k3", "k4"]
    evolve(fleet, window(100, 1, 5500))
    assert list(fleet.answers) == []
    assert fleet.answers_chars == 0


def test_a_key_that_is_answered_anew_counts_as_the_newest() -> None:
    fleet = fold(Fleet(), [window(2, 10), answered("a", 0), answered("b", 9_000)])
    evolve(fleet, answered("a", 10_500))  # the first has just expired
    assert list(fleet.answers) == ["b", "a"]
    evolve(fleet, answered("c", 10_600))
    assert list(fleet.answers) == ["a", "c"]


def test_large_answers_are_bounded_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evolve_answers, "CHARS_MAX", 100)
    fleet = fold(Fleet(), (answered(f"k{n}", n, "x" * 30) for n in range(5)))
    assert list(fleet.answers) == ["k2", "k3", "k4"]
    assert fleet.answers_chars == 90
    evolve(fleet, answered("huge", 5, "x" * 1000))
    assert list(fleet.answers) == ["huge"], "the newest is always kept"


@given(
    st.lists(
        st.one_of(
            st.builds(answered, st.sampled_from("abcdef"), st.integers(0, 50), st.text(max_size=5)),
            st.builds(window, st.integers(1, 4), st.integers(1, 3)),
        ),
        max_size=30,
    )
)
def test_the_fold_is_the_same_over_a_snapshot_at_any_place(events: list[AnyEvent]) -> None:
    at_ms, ordered = 0, []
    for position, event in enumerate(events, 1):
        at_ms += event.at_ms * 100
        ordered.append(msgspec.structs.replace(event, position=position, at_ms=at_ms))
    whole = fold(Fleet(), ordered)
    for cut in range(len(ordered)):
        _, body = check(to_bytes(fold(Fleet(), ordered[:cut])))
        again = fold(msgspec.json.decode(body, type=Fleet), ordered[cut:])
        assert list(again.answers) == list(whole.answers)
        assert again.canonical() == whole.canonical()
    assert whole.answers_chars == sum(len(answer.body) for answer in whole.answers.values())
    assert len(whole.answers) <= whole.answers_window.count_max
