"""A way for one robot past those around it: who may be moved for it, how much is searched, and how
far the way is followed.
"""

from scheduler.traffic.lacam import Search, Stand, Way
from scheduler.traffic.planner import Proposal
from scheduler.traffic.world import Agent, World

# Robots that may be moved for one, and successors looked at with so many: 13 µs each in plain
# Python (measured), so all three together take no longer than a quarter of a second.
REGIONS = ((6, 1_000), (14, 3_000), (30, 12_000))
WAY_MAX = 12  # moves of the stuck robot from which its region grows
NEARER_S = 3.0  # of driving, that a way has to gain: a move or two


def search(world: World, nearest: list[int]) -> tuple[Proposal | None, bool, list[int]]:
    """A way for the first of them; else whether there can be none, and who was looked at."""
    around = nearest[:1]
    for robots, expansions in REGIONS:
        around = nearest[:robots]
        found = Search(world, around).run(expansions)
        if found.way is not None:
            return found.way, True, around
        if len(nearest) <= robots:
            return None, found.proven, around
    return None, False, around


def until_nearer(world: World, agent: Agent, way: Way, least_s: float) -> Way:
    """The way up to where the robot is nearer to its goal than it ever was, with nobody on the next
    moves from there. From then on it is again one of many: followed to the goal, ways closed so
    much ground to all others that a busy floor did a third less (measured).
    """
    assert agent.goal is not None
    roadmap, at = world.roadmap, {other.name: other.place for other in world.agents}
    for k, (name, moves) in enumerate(way):
        if not moves:
            continue
        at[name], heading = roadmap.moves.end[moves[-1]], roadmap.heading_end[moves[-1]]
        if name != agent.name:
            continue
        left_s = agent.costs.cost_s(at[name], heading, agent.goal)
        onward = needs_of_way(world, agent, (at[name], heading), WAY_MAX)
        others = (place for other, place in at.items() if other != name)
        if left_s <= least_s - NEARER_S and not any(onward >> place & 1 for place in others):
            return way[: k + 1]
    return way


def region(world: World, k: int) -> list[int]:
    """All robots that may be moved, by their distance in moves from the way of robot k; itself
    first, then who stands right on it.
    """
    roadmap, agent = world.roadmap, world.agents[k]
    near: list[int] = [agent.place]
    seen = {agent.place}
    bits = needs_of_way(world, agent, (agent.place, agent.heading_rad), WAY_MAX)
    for place in range(len(roadmap.places.point)):
        if bits >> place & 1 and place not in seen:
            seen.add(place)
            near.append(place)
    at = {other.place: n for n, other in enumerate(world.agents) if not other.fixed}
    found = [k]
    for place in near:
        other = at.get(place)
        if other is not None and other != k:
            found.append(other)
        if len(found) > REGIONS[-1][0]:
            break
        for move in (*roadmap.leaving[place], *roadmap.arriving[place]):
            for end in (roadmap.moves.end[move], roadmap.moves.start[move]):
                if end not in seen:
                    seen.add(end)
                    near.append(end)
    return found


def way(world: World, agent: Agent, stand: Stand, moves_max: int) -> list[tuple[int, float, int]]:
    """Its best way from there on the map, whoever is there: places, headings, and the moves."""
    assert agent.goal is not None
    place, heading = stand
    roadmap, found = world.roadmap, list[tuple[int, float, int]]()
    for _ in range(moves_max):
        ways = [] if place == agent.goal else agent.costs.ways(place, heading, agent.goal)
        if not ways:
            break
        move = min(ways)[1]
        found.append((place, heading, move))
        place, heading = roadmap.moves.end[move], roadmap.heading_end[move]
    return found


def needs_of_way(world: World, agent: Agent, stand: Stand, moves_max: int) -> int:
    """Bits of the places that this way needs."""
    bits = 0
    for _, _, move in way(world, agent, stand, moves_max):
        bits |= world.roadmap.moves.need[move] | world.more_need.get(move, 0)
    return bits
