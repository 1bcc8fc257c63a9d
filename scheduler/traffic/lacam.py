"""A way out for one robot that is stuck, found by complete search over where all around it may be.

LaCAM (Okumura, AAAI 2023): a search over configurations, each with one place for every robot, whose
successors a planner like PIBT makes under constraints that are added one by one. Here a constraint
is one move of one robot. As whoever is not constrained stays unless it is pushed, the constraints
of a configuration include every single move that can be driven now, and any plan is a sequence of
such: so the search is complete, and when nothing is left to look at there is no way.

Only the stuck robot is to arrive. The others are interchangeable, which makes the search small:
configurations that differ only in who of them is where count as one.
"""

import heapq
from collections.abc import Iterator, Sequence
from typing import TypeAlias

import msgspec

from scheduler.traffic.costs import INFINITE
from scheduler.traffic.geometry import turn_rad
from scheduler.traffic.moves import heading_bin
from scheduler.traffic.world import World, may_be_pushed, room, turning_room

# Price in seconds of the way that is left, for each constraint that a configuration has had: small
# values look long around the nearest one, large ones at everything alike.
TRIED_S = 2.0
OCCUPIED_S = 5.0  # a push is taken after the moves that need none
BACK_S = 2.0  # a pushed robot rather goes where the stuck one does not want to pass
# Price of each robot on the best way of the stuck one: they have to be brought off it, which the
# length of the way does not tell.
IN_WAY_S = 5.0
FAR_S = 1e4  # there is no way from such a place
WAY_MAX = 200  # moves looked at along it
TRIES_MAX = 60  # candidates looked at for one successor
FREELY = -1  # heading of a robot that can turn where it is, whoever is around

Stand: TypeAlias = tuple[int, float]  # place, heading
Way: TypeAlias = list[tuple[str, tuple[int, ...]]]  # as `pibt.propose` gives it


NO_MORE = (-1, ())


class Found(msgspec.Struct, frozen=True, kw_only=True):
    """What a search came to: a way; or none, and whether there can be none (`proven`)."""

    way: Way | None
    proven: bool
    expanded: int


class Option(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """One move of one robot from where it stands; no moves = a turn in place on its goal."""

    price: float
    moves: tuple[int, ...]
    need: int
    to: Stand


Constraint: TypeAlias = tuple[int, Sequence[Option]]  # of one robot: what it drives in a row


class _Node(msgspec.Struct, kw_only=True):
    stands: tuple[Stand, ...]
    before: int  # number of the configuration that it came from
    driven: list[tuple[int, tuple[int, ...]]]  # by whom, what, in order
    left_s: float
    constraints: Iterator["Constraint | None"]
    tried: int = 0


class Search:
    """For the first of `movers`, past the others of them; everybody else stays where it is."""

    def __init__(self, world: World, movers: Sequence[int]) -> None:
        """`movers` are numbers in `world.agents`; the first one must have a goal."""
        self.world = world
        self.roadmap = world.roadmap
        self.agents = [world.agents[k] for k in movers]
        goal = self.agents[0].goal
        assert goal is not None
        self.goal = goal
        self.blocked = world.closed_places
        for k, agent in enumerate(world.agents):
            if k not in movers:
                self.blocked |= 1 << agent.place
        kinds = list({id(agent.costs): None for agent in self.agents})
        self._kind = [kinds.index(id(agent.costs)) for agent in self.agents]
        self._options: dict[tuple[int, int, float], list[Option]] = {}
        self._ways: dict[Stand, int] = {}
        self._headings: dict[tuple[int, float], float] = {}
        self._alike: dict[tuple[int, Stand], int] = {}  # robot and stand -> number of its class
        self._classes: dict[tuple[int, int, float], int] = {}

    def run(self, expansions_max: int) -> Found:
        """Look at so many successors at the most."""
        start = tuple((agent.place, agent.heading_rad) for agent in self.agents)
        nodes = [self._node(start, -1, [])]
        known = {self._key(start)}
        if self._arrived(start):
            return Found(way=[], proven=True, expanded=0)
        heap = [(nodes[0].left_s, 0)]
        for expanded in range(1, expansions_max + 1):
            if not heap:
                return Found(way=None, proven=True, expanded=expanded - 1)
            _, number = heapq.heappop(heap)
            node = nodes[number]
            constraint = next(node.constraints, NO_MORE)
            if constraint is NO_MORE:
                continue
            node.tried += 1
            heapq.heappush(heap, (node.left_s + TRIED_S * node.tried, number))
            driven: list[tuple[int, tuple[int, ...]]] = []
            stands = self._driven(node.stands, constraint, driven)
            if stands is None:
                continue
            key = self._key(stands)
            if key in known:
                continue
            known.add(key)
            nodes.append(self._node(stands, number, driven))
            if self._arrived(stands):
                return Found(way=self._way(nodes), proven=True, expanded=expanded)
            heapq.heappush(heap, (nodes[-1].left_s, len(nodes) - 1))
        return Found(way=None, proven=False, expanded=expansions_max)

    def _way(self, nodes: list[_Node]) -> Way:
        steps: list[list[tuple[int, tuple[int, ...]]]] = []
        number = len(nodes) - 1
        while number >= 0:
            steps.append(nodes[number].driven)
            number = nodes[number].before
        return [(self.agents[k].name, moves) for step in reversed(steps) for k, moves in step]

    def _node(
        self, stands: tuple[Stand, ...], before: int, driven: list[tuple[int, tuple[int, ...]]]
    ) -> _Node:
        place, heading = stands[0]
        left_s = min(self.agents[0].costs.cost_s(place, heading, self.goal), FAR_S)
        taken = 0
        for other, _ in stands[1:]:
            taken |= 1 << other
        return _Node(
            stands=stands,
            before=before,
            driven=driven,
            left_s=left_s + IN_WAY_S * (self.way(place, heading) & taken).bit_count(),
            constraints=self._constraints(stands),
        )

    def way(self, place: int, heading: float) -> int:
        """Bits of the places that the stuck robot needs on its best way from there."""
        found = self._ways.get((place, heading))
        if found is not None:
            return found
        passed: list[tuple[Stand, int]] = []
        stand = place, heading
        bits = 0
        for _ in range(WAY_MAX):
            options = self.options(0, *stand)
            if stand[0] == self.goal or not options:
                break
            passed.append((stand, options[0].need))
            stand = options[0].to
            bits = self._ways.get(stand, 0)
            if bits:
                break
        for stand, need in reversed(passed):
            bits |= need
            self._ways[stand] = bits
        return self._ways.setdefault((place, heading), bits)

    def _constraints(self, stands: tuple[Stand, ...]) -> Iterator[Constraint | None]:
        """None = the stuck robot as it likes. Then each robot off its way, in one go; that is not
        needed for completeness, but finds in hundreds of steps what else takes a hundred thousand.
        Then each move of each robot.
        """
        yield None
        way = self.way(*stands[0])
        for k, (place, _) in enumerate(stands):
            if k and way >> place & 1:
                off = self._off(k, stands, way)
                if len(off) > 1:
                    yield k, off
        for k, (place, heading) in enumerate(stands):
            for option in self.options(k, place, heading):
                yield k, (option,)

    def _off(self, k: int, stands: tuple[Stand, ...], way: int) -> list[Option]:
        """The fewest moves of a robot that bring it off a way, but not past the stuck one."""
        closed = 1 << stands[0][0]
        todo: list[tuple[Stand, list[Option]]] = [(stands[k], [])]
        seen = {stands[k][0]}
        for stand, before in todo:
            for option in self.options(k, *stand):
                if option.need & closed or option.to[0] in seen:
                    continue
                seen.add(option.to[0])
                if not way >> option.to[0] & 1:
                    return [*before, option]
                todo.append((option.to, [*before, option]))
        return []

    def _driven(
        self,
        stands: tuple[Stand, ...],
        constraint: Constraint | None,
        driven: list[tuple[int, tuple[int, ...]]],
    ) -> tuple[Stand, ...] | None:
        """Where all stand after a constraint; None if it cannot be met."""
        if constraint is None:
            step = _Step(self, stands)
            if not step.clear(0, 0, 0):
                return None
            driven += step.driven
            return tuple(step.stands)
        k, options = constraint
        for option in options:
            step = _Step(self, stands)
            if not step.perform(k, option, 0, 0):
                return None
            driven += step.driven
            stands = tuple(step.stands)
        return stands

    def _arrived(self, stands: tuple[Stand, ...]) -> bool:
        place, heading = stands[0]
        return place == self.goal and not self.roadmap.final_turn_rad(place, heading)

    def _key(self, stands: tuple[Stand, ...]) -> tuple[int, ...]:
        """Robots of a kind that have changed places are the same."""
        alike = self._alike
        try:
            own, *others = [alike[stand] for stand in enumerate(stands)]
        except KeyError:
            for k, (place, heading) in enumerate(stands):
                found = self._kind[k], place, self._heading(k, place, heading)
                alike[k, (place, heading)] = self._classes.setdefault(found, len(self._classes))
            return self._key(stands)
        return own, *sorted(others)

    def _heading(self, k: int, place: int, heading: float) -> float:
        """Headings that make no difference are one."""
        key = k, place
        free = self._headings.get(key)
        if free is None:
            world, point = self.world, self.roadmap.places.point[place]
            can = self.roadmap.turning[place] and self.agents[k].costs.can_turn(place)
            can = can and point not in world.closed_turns
            free = self._headings[key] = FREELY if can and not turning_room(world, place) else 0.0
        return free if free == FREELY else float(heading_bin(heading))

    def options(self, k: int, place: int, heading: float) -> list[Option]:
        """What a robot can drive from there past those that never move; the best first."""
        key = k, place, heading
        found = self._options.get(key)
        if found is None:
            found = self._options[key] = self._find(k, place, heading)
        return found

    def _find(self, k: int, place: int, heading: float) -> list[Option]:
        agent, roadmap, world = self.agents[k], self.roadmap, self.world
        costs = agent.costs
        found: list[Option] = []
        for move in (None, *roadmap.leaving[place]):
            moves = () if move is None else (move,)
            end, to = place, heading
            if move is None:
                if place != agent.goal or not roadmap.final_turn_rad(place, heading):
                    continue
                if not costs.can_turn(place):
                    continue
                price = 0.0
            else:
                if move in world.closed_moves or move in costs.closed_moves:
                    continue
                price = costs.departure_s(place, heading, move) + costs.move_s[move]
                turn = turn_rad(heading, roadmap.heading_start[move])
                if price == INFINITE or (
                    turn and roadmap.places.point[place] in world.closed_turns
                ):
                    continue
                end, to = roadmap.moves.end[move], roadmap.heading_end[move]
                if k == 0:
                    price = costs.onward_s(place, heading, move, self.goal)
                elif end >= roadmap.places.stops or costs.trap[move]:
                    continue
                if k and not may_be_pushed(world, moves):
                    continue
            if price == INFINITE:
                continue
            if end == agent.goal and roadmap.final_turn_rad(end, to):
                demanded = roadmap.net.points[roadmap.places.point[end]].heading_rad
                assert demanded is not None
                to = demanded
            need = room(world, place, heading, moves, agent.goal) & ~(1 << place)
            if not need & self.blocked:
                found.append(Option(price=price, moves=moves, need=need, to=(end, to)))
        found.sort(key=lambda option: (option.price, option.moves))
        return found


class _Step:
    """One successor: the constraint, whoever has to make way for it, and nothing else."""

    def __init__(self, search: Search, stands: tuple[Stand, ...]) -> None:
        self.search = search
        self.stands = list(stands)
        self.at = {place: k for k, (place, _) in enumerate(stands)}
        self.waiting = 0
        for place, _ in stands:
            self.waiting |= 1 << place
        self.settled = 0
        self.driven: list[tuple[int, tuple[int, ...]]] = []
        self.tries = 0
        self.wanted = search.way(*stands[0])

    def clear(self, k: int, forbidden: int, ancestors: int) -> bool:
        """Let a robot move as it likes, so that it ends where nobody above it needs room."""
        options = self.search.options(k, *self.stands[k])
        for option in sorted(options, key=self._price(k)):
            self.tries += 1
            if self.tries > TRIES_MAX:
                return False
            if self.perform(k, option, forbidden, ancestors):
                return True
        return False

    def _price(self, k: int) -> "_Price":
        return _Price(self.waiting, self.wanted if k else 0)

    def perform(self, k: int, option: Option, forbidden: int, ancestors: int) -> bool:
        here, end = 1 << self.stands[k][0], 1 << option.to[0]
        if end & forbidden or option.need & (ancestors | self.settled):
            return False
        mark = list(self.stands), self.waiting, self.settled, len(self.driven)
        while hit := option.need & self.waiting & ~here:
            other = self.at[(hit & -hit).bit_length() - 1]
            if not self.clear(other, forbidden | option.need, ancestors | here):
                self.stands, self.waiting, self.settled = mark[0], mark[1], mark[2]
                del self.driven[mark[3] :]
                return False
        self.driven.append((k, option.moves))
        self.stands[k] = option.to
        self.waiting &= ~here
        self.settled |= end
        return True


class _Price:
    """Orders what a robot may drive: free ways first, and off the stuck one's own."""

    def __init__(self, waiting: int, wanted: int) -> None:
        self.waiting, self.wanted = waiting, wanted

    def __call__(self, option: Option) -> tuple[float, tuple[int, ...]]:
        end = 1 << option.to[0]
        price = option.price + (OCCUPIED_S if option.need & self.waiting else 0.0)
        return price + (BACK_S if end & self.wanted else 0.0), option.moves
