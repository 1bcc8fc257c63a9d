from ledger.ids import OrderId, RobotName, SceneId
from ledger.link import Plan
from ledger.state import Order
from ledger.waits import Wait, WaitReason
from tests.stands import MOVING_MS, SHORT_MS, Stands, bound_ms, explained

SCENE = SceneId("s")
A, B, C = (RobotName(name) for name in "ABC")


def plan(name, reason=None, *blockers):
    wait = None
    if reason is not None:
        wait = Wait(robot=name, since_ms=0, reason=reason, blockers=blockers, place=None)
    return Plan(scene=SCENE, robot=name, at_ms=0, ready=True, wait=wait)


def plans(*given):
    return {one.robot: one for one in given}


def test_a_wait_has_a_cause_where_its_chain_ends_at_one():
    ring = plans(plan(A, WaitReason.BEHIND_ROBOT, B), plan(B, WaitReason.BEHIND_ROBOT, A))
    assert explained(ring, ()) == set()
    assert explained(ring, {B}) == {A, B}
    queue = plans(plan(A, WaitReason.BEHIND_ROBOT, B), plan(B, WaitReason.POCKET_TOKEN, C), plan(C))
    assert explained(queue, ()) == {A, B}


def test_a_stand_is_counted_from_the_last_motion_and_from_the_end_of_a_cause():
    waits = plans(plan(A, WaitReason.YIELDING), plan(B, WaitReason.BEHIND_ROBOT, A))
    stands, moved_ms = Stands(), {A: 0, B: 5_000}
    stands.look([A, B], moved_ms, waits, (), 20_000)
    assert stands.unnamed_ms == 20_000  # of A
    stands.look([A, B], moved_ms, waits, {A}, 90_000)
    assert stands.unnamed_ms == 20_000
    stands.look([A, B], moved_ms, waits, (), 130_000)
    assert stands.unnamed_ms == 40_000
    assert stands.unnamed == (A, waits[A])


def test_a_cause_counts_for_who_has_nowhere_to_go_while_it_lasts():
    stands, moved_ms = Stands(), {A: 0}
    stands.look([], moved_ms, {}, {A}, 200_000)
    stands.look([A], moved_ms, plans(plan(A)), (), 210_000)
    assert stands.unnamed_ms == 10_000


def test_who_gets_an_order_after_a_rest_has_stood_since_then_only():
    def order(robot, assigned_ms):
        made = {"created_ms": 0, "created_by": "", "modified_ms": 0, "modified_by": ""}
        number = OrderId(f"{robot}{assigned_ms}")
        return Order(id=number, scene=SCENE, robot=robot, assigned_ms=assigned_ms, **made)

    moved_ms = {A: 0, B: 0, C: 90_000}
    orders = [order(A, 130_000), order(A, 140_000), order(C, 60_000), order(None, None)]
    assert bound_ms(moved_ms, orders) == {A: 130_000, B: 0, C: 90_000}


def test_who_moves_stands_not_and_is_a_cause_for_those_behind():
    waits = plans(plan(A), plan(B, WaitReason.BEHIND_ROBOT, A))
    stands = Stands()
    stands.look([A, B], {A: 50_001 - MOVING_MS, B: 0}, waits, (), 50_000)
    assert stands.unnamed_ms == 0
    assert Stands.long({A: 0, B: 1}, SHORT_MS + 1) == [A]
