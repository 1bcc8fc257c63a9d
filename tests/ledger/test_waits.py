from hypothesis import given
from hypothesis import strategies as st

from ledger.ids import RobotName
from ledger.waits import Wait, WaitReason, chains, cycles

NAMES = [RobotName(f"R{k}") for k in range(7)]
OUTSIDE = RobotName("external:maintenance")


def wait(
    robot: str,
    *blockers: str,
    since_ms: int = 0,
    reason: WaitReason = WaitReason.BEHIND_ROBOT,
) -> Wait:
    return Wait(
        robot=RobotName(robot),
        since_ms=since_ms,
        reason=reason,
        blockers=tuple(map(RobotName, blockers)),
    )


def said(waits: list[Wait]) -> list[tuple[list[str], str | None, bool]]:
    return [([w.robot for w in c.waits], c.root, c.closed) for c in chains(waits)]


def edges_of(waits: list[Wait]) -> dict[RobotName, tuple[RobotName, ...]]:
    return {wait.robot: wait.blockers for wait in waits}


WAITS = st.dictionaries(
    st.sampled_from(NAMES),
    st.tuples(st.lists(st.sampled_from([*NAMES, OUTSIDE]), max_size=3, unique=True), st.integers()),
).map(lambda found: [wait(name, *others, since_ms=t) for name, (others, t) in found.items()])


def test_a_chain_leads_from_who_is_waited_for_by_nobody_to_what_it_hangs_on():
    waits = [wait("R12", "R07", since_ms=14), wait("R07", OUTSIDE, since_ms=3)]
    assert said(waits) == [(["R12", "R07"], OUTSIDE, False)]


def test_two_chains_may_end_alike_and_the_longest_wait_comes_first():
    waits = [wait("R1", "R3", since_ms=9), wait("R2", "R3", since_ms=5), wait("R3", since_ms=7)]
    assert said(waits) == [(["R2", "R3"], None, False), (["R1", "R3"], None, False)]


def test_robots_that_wait_for_each_other_are_one_closed_chain():
    waits = [wait("R1", "R2"), wait("R2", "R3"), wait("R3", "R1"), wait("R4", "R2")]
    assert said(waits) == [(["R4", "R2", "R3", "R1"], "R2", True)]
    assert said(waits[:3]) == [(["R1", "R2", "R3"], "R1", True)]
    assert cycles(edges_of(waits)) == [("R1", "R2", "R3")]


@given(WAITS)
def test_every_wait_is_in_a_chain_and_each_link_is_a_wait_for_the_next(waits: list[Wait]):
    found = chains(waits)
    assert {w.robot for c in found for w in c.waits} == {w.robot for w in waits}
    for chain in found:
        names = [w.robot for w in chain.waits]
        assert len(set(names)) == len(names)
        for one, after in zip(chain.waits, names[1:], strict=False):
            assert after in one.blockers
        waiting = {w.robot for w in waits}
        assert chain.closed == (chain.root in names)
        assert chain.closed or chain.root not in waiting


@given(WAITS)
def test_cycles_are_those_who_can_be_reached_from_each_other(waits: list[Wait]):
    edges = {w.robot: set(w.blockers) & {other.robot for other in waits} for w in waits}
    reach = {name: set(others) for name, others in edges.items()}
    for _ in edges:
        for others in reach.values():
            others.update(*(edges[other] for other in tuple(others)))
    lots = {
        tuple(sorted(b for b in edges if b in reach[a] and a in reach[b]))
        for a in edges
        if a in reach[a]
    }
    assert cycles(edges_of(waits)) == sorted(lot for lot in lots if len(lot) > 1)


def test_who_makes_way_does_not_wait_for_the_one_that_it_makes_way_for():
    pushed = wait("A", "B", reason=WaitReason.PUSHED)
    waiting = wait("B", "A")
    (chain,) = chains([pushed, waiting])
    assert [w.robot for w in chain.waits] == ["B", "A"]
    assert not chain.closed and chain.root is None
    assert cycles({w.robot: w.awaited for w in (pushed, waiting)}) == []
