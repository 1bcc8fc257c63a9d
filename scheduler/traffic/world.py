"""What a planner looks at: robots with their places and goals, and what is closed just now."""

from collections.abc import Collection, Mapping

import msgspec

from scheduler.traffic.ahead import Ahead
from scheduler.traffic.costs import INFINITE, Costs
from scheduler.traffic.geometry import turn_rad
from scheduler.traffic.pockets import DEEPER_M
from scheduler.traffic.roadmap import Roadmap


class Agent(msgspec.Struct, kw_only=True):
    """One robot as the planner sees it: where its committed moves end, and what it wants."""

    name: str
    place: int
    heading_rad: float
    costs: Costs
    goal: int | None = None
    fixed: bool = False  # working, lost, or rolling to its goal: neither moves nor is pushed
    impatience_s: float = 0.0
    leaving: bool = False  # ground that somebody waits for: all around it may be dead ends


class Closure(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Where nobody may go any more."""

    cells: frozenset[int] = frozenset()  # compiled cells that the ground overlaps
    moves: frozenset[int] = frozenset()
    turns: frozenset[int] = frozenset()  # points where nobody can turn
    places: int = 0  # bits of the places where nobody can rest

    def holds(self, place: int | None) -> bool:
        """Is the place, if it is one, on the ground."""
        return place is not None and bool(self.places >> place & 1)


class World(msgspec.Struct, kw_only=True):
    """A snapshot to plan on. `agents` come in the order of rank; each place has one at most."""

    roadmap: Roadmap
    agents: list[Agent]
    closed_moves: frozenset[int] = frozenset()  # they lead over ground that will not become free
    closed_turns: frozenset[int] = frozenset()  # points where for that reason nobody can turn
    closed_places: int = 0  # bits
    closed_by: Mapping[str, Closure] = {}  # robot -> what of that its ground closes
    # Bodies that stand otherwise than the map foresees: what else must be empty, by move and by
    # point of a turn.
    more_need: dict[int, int] = {}
    more_turning: dict[int, int] = {}
    # How far who is pushed may drive, and has to (linkMinDistance, linkMaxDistance).
    push_m_min: float = 0.0
    push_m_max: float = INFINITE
    # For planners that look ahead: the moment, and what is under way by robot.
    now_ms: int = 0
    ahead: Mapping[str, Ahead] = {}


def standing_still(world: World, names: Collection[str]) -> World:
    """The same with these robots where they are, whoever comes."""
    agents = [
        msgspec.structs.replace(agent, fixed=True) if agent.name in names else agent
        for agent in world.agents
    ]
    return msgspec.structs.replace(world, agents=agents)


def room(
    world: World, place: int, heading_rad: float, moves: tuple[int, ...], goal: int | None
) -> int:
    """Bits of the places that must be empty for an operation, turns before and after included."""
    roadmap = world.roadmap
    bits = 0
    for move in moves:
        if turn_rad(heading_rad, roadmap.heading_start[move]):
            bits |= turning_room(world, place)
        bits |= roadmap.moves.need[move] | world.more_need.get(move, 0)
        place, heading_rad = roadmap.moves.end[move], roadmap.heading_end[move]
    if place == goal and roadmap.final_turn_rad(place, heading_rad):
        bits |= turning_room(world, place)
    return bits


def in_way(world: World, place: int, heading_rad: float, move: int) -> tuple[str, ...]:
    """Robots whose ground closes a move to all others: lost ones, and those between stops."""
    if not world.closed_by:
        return ()
    turns = bool(turn_rad(heading_rad, world.roadmap.heading_start[move]))
    point = world.roadmap.places.point[place]
    need = room(world, place, heading_rad, (move,), None) & ~(1 << place)
    return tuple(
        name
        for name, closed in world.closed_by.items()
        if move in closed.moves or (turns and point in closed.turns) or need & closed.places
    )


def may_be_pushed(world: World, moves: tuple[int, ...]) -> bool:
    """Is an operation of a robot that makes way neither shorter nor longer than such may be."""
    if world.push_m_min <= 0.0 and world.push_m_max == INFINITE:
        return True
    roadmap = world.roadmap
    paths = (path for move in moves for path in roadmap.moves.paths[move])
    length_m = sum(roadmap.net.traces.length_m[path] for path in paths)
    return world.push_m_min <= length_m <= world.push_m_max


def turning_room(world: World, place: int) -> int:
    """Bits of the places that must be empty for a turn in place."""
    places = world.roadmap.places
    return places.turning[place] | world.more_turning.get(places.point[place], 0)


def has_token(roadmap: Roadmap, pocket: int, goal: int | None, goals_inside: list[int]) -> bool:
    """May a robot with this goal enter the pocket while robots with those goals are in it; a robot
    without one counts as having it where it is.
    """
    pockets = roadmap.pockets
    if not goals_inside:
        return True
    if goal is None or pockets.pocket[goal] != pocket:
        return False
    least = pockets.depth_m[goal] + DEEPER_M
    return all(
        pockets.pocket[other] == pocket and pockets.depth_m[other] > least for other in goals_inside
    )
