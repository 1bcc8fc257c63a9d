"""Who waits for whom at a moment, and what all of it hangs on, in plain words."""

from collections.abc import Callable, Iterable

from ledger.ids import PointName, RobotName, SceneId
from ledger.link import DOOR, EXTERNAL, Plan
from ledger.waits import Chain, Wait, WaitReason, chains
from replay.wire import Wire

STALE_MS = 15_000  # plans are told, and written, more often: whoever intended this has gone

_WORDS = {
    WaitReason.BEHIND_ROBOT: "waits for {who} to drive on",
    WaitReason.GOAL_BUSY: "waits for {who} to leave {place}",
    WaitReason.ROBOT_FIXED: "waits for {who}, who cannot be sent away",
    WaitReason.ROBOT_LOST: "waits for {who}, who does not answer",
    WaitReason.POCKET_TOKEN: "waits for {who} to leave the dead end at {place}",
    WaitReason.YIELDING: "lets {who} go first",
    WaitReason.PUSHED: "makes way for {who}",
    WaitReason.DOOR: "waits for {who}",
    WaitReason.RESERVED_GROUND: "waits for {who}",
    WaitReason.NO_WAY: "has no way to {place}",
    WaitReason.NOT_ANSWERING: "does not answer",
    WaitReason.NOT_PLACED: "stands where it cannot be moved",
    WaitReason.STOPPED: "is stopped",
    WaitReason.LATE: "may drive, and stands",
}


class WaitFrame(Wire, frozen=True, kw_only=True):
    """One robot that waits."""

    robot: RobotName
    since_ms: int
    reason: WaitReason
    words: str  # what it does, the robot's name before them
    blockers: tuple[RobotName, ...]  # robots; `external:` with an owner, `door:` with a name
    place: PointName | None  # the point that it cannot get to next


class ChainFrame(Wire, frozen=True, kw_only=True):
    """Robots that wait one for the next, and what the last one waits for."""

    robots: tuple[RobotName, ...]
    since_ms: int  # the longest wait in it
    root: RobotName | None  # what all of it hangs on, named as blockers are; None = the last robot
    root_words: str  # what the root does; empty if it is no robot
    closed: bool  # the root is one of them: they wait for each other
    words: str


class Waiting(Wire, frozen=True, kw_only=True):
    """Who waits for whom in a scene at a moment."""

    at_ms: int
    live: bool
    position: int
    scene: SceneId | None
    waits: tuple[WaitFrame, ...]
    chains: tuple[ChainFrame, ...]  # the longest wait first
    cycles: tuple[tuple[RobotName, ...], ...]  # robots that wait for each other


def name_of(blocker: str) -> str:
    """Say who or what is waited for."""
    if blocker.startswith(DOOR):
        return f"door '{blocker.removeprefix(DOOR)}'"
    if blocker.startswith(EXTERNAL):
        return f"ground reserved for '{blocker.removeprefix(EXTERNAL)}'"
    return blocker


def wait_words(wait: Wait) -> str:
    """Say what a robot waits for; its name belongs before the words."""
    who = " and ".join(name_of(name) for name in wait.blockers) or "others"
    return _WORDS[wait.reason].format(who=who, place=wait.place or "its goal")


def waits_of(plans: Iterable[Plan | None], at_ms: int) -> list[Wait]:
    """Take the waits out of what was intended at a moment."""
    fresh = (plan for plan in plans if plan is not None and at_ms - plan.at_ms <= STALE_MS)
    return [plan.wait for plan in fresh if plan.wait is not None]


def wait_frames(waits: Iterable[Wait]) -> tuple[WaitFrame, ...]:
    """Say each wait in words."""
    return tuple(
        WaitFrame(
            robot=wait.robot,
            since_ms=wait.since_ms,
            reason=wait.reason,
            words=wait_words(wait),
            blockers=wait.blockers,
            place=wait.place,
        )
        for wait in waits
    )


def chain_frames(
    waits: Iterable[Wait], does: Callable[[RobotName], str], at_ms: int
) -> tuple[ChainFrame, ...]:
    """Follow the waits to what they hang on; `does` says what a robot that does not wait does."""
    return tuple(_frame(chain, does, at_ms) for chain in chains(waits))


def _frame(chain: Chain, does: Callable[[RobotName], str], at_ms: int) -> ChainFrame:
    outside = chain.root is None or chain.root.startswith((DOOR, EXTERNAL))
    root_words = "" if outside or chain.closed or chain.root is None else does(chain.root)
    said = [
        f"{wait.robot} {wait_words(wait)} (since {max(0, at_ms - wait.since_ms) // 1000} s)"
        for wait in chain.waits
    ]
    if root_words:
        said.append(f"{chain.root} {root_words}")
    if chain.closed:
        said.append("they wait for each other")
    return ChainFrame(
        robots=tuple(wait.robot for wait in chain.waits),
        since_ms=min(wait.since_ms for wait in chain.waits),
        root=chain.root,
        root_words=root_words,
        closed=chain.closed,
        words=", ".join(said),
    )
