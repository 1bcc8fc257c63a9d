"""Who waits for whom: waits of robots as traffic names them, their chains and their cycles."""

from collections.abc import Iterable, Mapping, Sequence
from enum import StrEnum

from ledger.ids import PointName, RobotName, SceneId
from ledger.scene import Value


class WaitReason(StrEnum):
    """Why a robot stands although it has somewhere to go."""

    # for others
    BEHIND_ROBOT = "BehindRobot"  # its next ground is another's, or another's turn comes before
    GOAL_BUSY = "GoalBusy"  # somebody stands on its goal who cannot be sent away
    ROBOT_FIXED = "RobotFixed"  # on its way somebody stands who cannot be sent away
    ROBOT_LOST = "RobotLost"  # on its way somebody stands who does not answer
    POCKET_TOKEN = "PocketToken"  # a dead end has to empty before it may enter
    YIELDING = "Yielding"  # its way is wanted by robots that come first, or would close a ring
    PUSHED = "Pushed"  # it has made way, and stands where it was sent
    DOOR = "Door"  # a door is shut, or does not work
    RESERVED_GROUND = "ReservedGround"  # ground is reserved for somebody else
    # for nobody else
    NO_WAY = "NoWay"  # the map has no way to its goal
    NOT_ANSWERING = "NotAnswering"  # it is lost itself
    NOT_PLACED = "NotPlaced"  # it stands where traffic cannot move it
    STOPPED = "Stopped"  # by a person, its own guard, or whoever holds control of it
    LATE = "Late"  # it has been granted ground, and does not drive


def awaited(reason: WaitReason, blockers: tuple[RobotName, ...]) -> tuple[RobotName, ...]:
    """Give those whom it waits for: not the one that it makes way for, which waits for it."""
    return () if reason is WaitReason.PUSHED else blockers


class Wait(Value, frozen=True, kw_only=True):
    """One robot that waits. Blockers are named as in `link.Plan.blocked_by`: robots, and after
    EXTERNAL the owner of reserved ground, after DOOR the name of a door; empty = nobody else.
    """

    robot: RobotName
    since_ms: int  # it has stood from then on, for whatever reasons
    reason: WaitReason
    blockers: tuple[RobotName, ...] = ()
    place: PointName | None = None  # the point that it cannot get to next

    @property
    def awaited(self) -> tuple[RobotName, ...]:
        """Whom it waits for."""
        return awaited(self.reason, self.blockers)


class Chain(Value, frozen=True, kw_only=True):
    """Who waits for whom, from a robot that nobody waits for down to what all of it hangs on."""

    waits: tuple[Wait, ...]  # each for the next one
    root: RobotName | None  # waits for nobody, named as blockers are; None = the last wait says why
    closed: bool = False  # the last one waits for one before: they wait for each other


class Counts(Value, frozen=True, kw_only=True):
    """How often what has happened in the traffic of a scene, since the scheduler's start."""

    scene: SceneId
    at_ms: int
    plannings: dict[str, int] = {}  # by what made them due
    pushes: int = 0
    cycles: int = 0  # of robots that waited for each other, for a while
    # Searches for a way out of being stuck, ways found (rescues), and robots a person was told of.
    ladder: dict[str, int] = {}
    breaches: int = 0  # times that the guard saw what must not be


def chains(waits: Iterable[Wait]) -> list[Chain]:
    """Follow each wait that nobody waits for, the longest waiting blocker first; who waits longest
    in a chain decides its place. Of robots that wait for each other, one chain begins at one.
    """
    by_robot = {wait.robot: wait for wait in waits}
    blocking = {name for wait in by_robot.values() for name in wait.awaited}
    left = dict(by_robot)
    found = []
    for names in ([name for name in by_robot if name not in blocking], by_robot):
        for name in names:
            if name in left:
                chain = _follow(by_robot, name)
                found.append(chain)
                for wait in chain.waits:
                    left.pop(wait.robot, None)
    found.sort(key=lambda c: (min(wait.since_ms for wait in c.waits), c.waits[0].robot))
    return found


def _follow(by_robot: Mapping[RobotName, Wait], name: RobotName) -> Chain:
    links: dict[RobotName, Wait] = {}
    while True:
        wait = links[name] = by_robot[name]
        waiting = [by_robot[other] for other in wait.awaited if other in by_robot]
        if not waiting:
            root = wait.awaited[0] if wait.awaited else None
            return Chain(waits=tuple(links.values()), root=root)
        name = min(waiting, key=lambda other: (other.since_ms, other.robot)).robot
        if name in links:
            return Chain(waits=tuple(links.values()), root=name, closed=True)


def cycles(edges: Mapping[RobotName, Sequence[RobotName]]) -> list[tuple[RobotName, ...]]:
    """Give the robots that wait for each other, each lot sorted: the strongly connected parts of
    the graph from robots to their blockers (Tarjan 1972, without recursion).
    """
    index: dict[RobotName, int] = {}
    low: dict[RobotName, int] = {}
    stack: list[RobotName] = []
    on_stack: set[RobotName] = set()
    found: list[tuple[RobotName, ...]] = []
    for start in edges:
        path = [] if start in index else [(start, iter(edges[start]))]
        if path:
            index[start] = low[start] = len(index)
            stack.append(start)
            on_stack.add(start)
        while path:
            name, others = path[-1]
            for other in others:
                if other in edges and other not in index:
                    index[other] = low[other] = len(index)
                    stack.append(other)
                    on_stack.add(other)
                    path.append((other, iter(edges[other])))
                    break
                if other in on_stack:
                    low[name] = min(low[name], index[other])
            else:
                path.pop()
                if path:
                    low[path[-1][0]] = min(low[path[-1][0]], low[name])
                if low[name] == index[name]:
                    part = stack[stack.index(name) :]
                    del stack[-len(part) :]
                    on_stack.difference_update(part)
                    if len(part) > 1:
                        found.append(tuple(sorted(part)))
    return sorted(found)


class WaitSum(Value, frozen=True, kw_only=True):
    """How long one robot has waited for the same, at the same place, in a stretch of time."""

    robot: RobotName
    reason: WaitReason
    blockers: tuple[RobotName, ...] = ()
    place: PointName | None = None
    times: int = 1
    total_ms: int = 0
    longest_ms: int = 0  # of one time


class CycleSeen(Value, frozen=True, kw_only=True):
    """Robots that waited for each other, and until when; None = they still did."""

    robots: tuple[RobotName, ...]
    from_ms: int
    until_ms: int | None = None
