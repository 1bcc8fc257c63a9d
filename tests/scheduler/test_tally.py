from hypothesis import given
from hypothesis import strategies as st

from ledger.ids import PointName, RobotName, SceneId
from ledger.waits import CycleSeen, Wait, WaitReason, WaitSum
from scheduler.tally import STRETCH_MS, SUMS_MAX, Tally

SCENE = SceneId("0123456789abcdef01234567")
A, B, C = RobotName("A"), RobotName("B"), RobotName("C")


def wait(robot: RobotName, *blockers: RobotName, since_ms: int = 0, **more: object) -> Wait:
    given = {"reason": WaitReason.BEHIND_ROBOT, "place": PointName("P")} | more
    return Wait(robot=robot, since_ms=since_ms, blockers=blockers, **given)  # type: ignore[arg-type]


def test_what_is_waited_for_the_same_is_summed_up_from_when_the_robot_stood():
    tally = Tally(0)
    for now_ms in (2_000, 3_000, 4_000):
        tally.take([wait(A, B, since_ms=1_000)], now_ms)
    tally.take([], 5_000)
    for now_ms in (10_000, 12_000):
        tally.take([wait(A, B, since_ms=9_000)], now_ms)
    noted = tally.due(SCENE, STRETCH_MS)
    assert noted is not None
    assert noted.waits == (
        WaitSum(
            robot=A,
            reason=WaitReason.BEHIND_ROBOT,
            blockers=(B,),
            place=PointName("P"),
            times=2,
            total_ms=6_000,
            longest_ms=3_000,
        ),
    )
    assert (noted.from_ms, noted.left_out_ms, noted.cycles) == (0, 0, ())


def test_what_was_before_the_beginning_is_not_counted():
    tally = Tally(10_000)
    tally.take([wait(A, B, since_ms=9_500)], 12_000)
    noted = tally.due(SCENE, 10_000 + STRETCH_MS)
    assert noted is not None
    assert (noted.waits[0].total_ms, noted.waits[0].longest_ms) == (2_000, 2_000)


def test_another_reason_is_another_wait_from_its_beginning_on():
    tally = Tally(0)
    tally.take([wait(A, B, since_ms=0)], 3_000)
    tally.take([wait(A, since_ms=0, reason=WaitReason.DOOR)], 5_000)
    tally.take([wait(A, since_ms=0, reason=WaitReason.DOOR)], 9_000)
    noted = tally.due(SCENE, STRETCH_MS)
    assert noted is not None
    assert [(w.reason, w.total_ms, w.longest_ms) for w in noted.waits] == [
        (WaitReason.DOOR, 4_000, 4_000),
        (WaitReason.BEHIND_ROBOT, 3_000, 3_000),
    ]


def test_sums_are_given_once_in_a_stretch_and_only_where_somebody_waited():
    tally = Tally(0)
    assert tally.due(SCENE, STRETCH_MS) is None
    tally.take([wait(A, since_ms=STRETCH_MS)], STRETCH_MS + 9_000)
    assert tally.due(SCENE, 2 * STRETCH_MS - 1) is None
    assert tally.due(SCENE, 2 * STRETCH_MS) is not None
    assert tally.due(SCENE, 3 * STRETCH_MS) is None


def test_a_wait_over_the_end_of_a_stretch_is_counted_in_both_and_no_time_twice():
    tally = Tally(0)
    total_ms = 0
    for now_ms in range(1_000, 2 * STRETCH_MS + 1, 1_000):
        tally.take([wait(A, B, since_ms=1_000)], now_ms)
        noted = tally.due(SCENE, now_ms)
        if noted is not None:
            total_ms += noted.waits[0].total_ms
            assert noted.waits[0].times == 1
            assert noted.waits[0].longest_ms == now_ms - 1_000
    assert total_ms == 2 * STRETCH_MS - 1_000


def test_robots_that_wait_for_each_other_for_long_are_told_when_they_do_no_more():
    tally = Tally(0)
    ring = [wait(A, B), wait(B, A), wait(C, B)]
    for now_ms in (1_000, 2_000):
        tally.take(ring, now_ms)
    tally.take([wait(C, B)], 3_000)
    for now_ms in (4_000, 6_000, 8_000, 10_000):
        tally.take(ring, now_ms)
    tally.take([], 11_000)
    noted = tally.due(SCENE, STRETCH_MS)
    assert noted is not None
    assert noted.cycles == (CycleSeen(robots=(A, B), from_ms=4_000, until_ms=11_000),)
    assert tally.counts(SCENE, 0).cycles == 1


def test_counts_go_on_when_traffic_is_made_anew():
    tally = Tally(0)
    tally.count(3, {"Goals": 5})
    tally.count(4, {"Goals": 9, "Pace": 1})
    tally.count(1, {"Goals": 2})  # a map was replaced
    counts = tally.counts(SCENE, 7)
    assert (counts.pushes, counts.plannings, counts.at_ms) == (5, {"Goals": 11, "Pace": 1}, 7)
    tally.take([wait(A)], 9_000)
    noted = tally.due(SCENE, STRETCH_MS)
    assert noted is not None
    assert (noted.pushes, noted.plannings) == (5, {"Goals": 11, "Pace": 1})


def test_what_was_done_for_the_stuck_is_counted_beside_plannings():
    tally = Tally(0)
    tally.count(0, {"Goals": 1}, {"searches": 3, "rescues": 2})
    tally.count(0, {"Goals": 1}, {"searches": 1, "rescues": 0})  # a map was replaced
    counts = tally.counts(SCENE, 7)
    assert counts.ladder == {"rescues": 2, "searches": 4}
    assert counts.plannings == {"Goals": 1}


@given(st.lists(st.integers(0, 5_000), min_size=1, max_size=400))
def test_no_time_is_lost_however_much_is_left_out(steps: list[int]):
    tally, now_ms, total_ms = Tally(0), 0, 0
    for number, step in enumerate(steps):
        begins_ms = now_ms
        now_ms += step
        tally.take([wait(RobotName(f"R{number}"), since_ms=begins_ms)], now_ms)
        total_ms += step
    noted = tally.due(SCENE, now_ms + STRETCH_MS)
    assert noted is not None
    assert len(noted.waits) <= SUMS_MAX
    assert noted.left_out_ms + sum(w.total_ms for w in noted.waits) == total_ms
