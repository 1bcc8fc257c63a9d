"""Who stands on ground that others are promised, for it was thought to leave and never heard of it:
the others are brought to a halt and sent anew, or each would wait for the other for ever.
"""

import pytest

from ledger.ids import PointName, RobotName
from ledger.scene import Group
from scheduler.goal import Goal
from tests.scheduler.traffic.floor import Floor
from tests.scheduler.traffic.maps import lattice

GROUP = Group(id=0, name="g")
DEAF, BEHIND = RobotName("A"), RobotName("B")
# In a row, each behind the other; the first is to leave it, the others to go on over its stop.
STARTS = {"A": ("P2-1", 0.0), "B": ("P1-1", 0.0), "C": ("P0-1", 0.0)}
GOALS = {"A": "P2-2", "B": "P4-1", "C": "P3-1"}
WAYS = {"A": ["P2-2"], "B": ["P2-1", "P3-1"], "C": ["P1-1"]}


class AllAtOnce:
    """A planner that has each robot leave for the one behind it, over more than one stop."""

    looks_ahead = False

    def propose(self, world):
        roadmap = world.roadmap
        ends = {roadmap.net.points[roadmap.places.point[k]].name: k for k in roadmap.place.values()}
        found = []
        for agent in sorted(world.agents, key=lambda agent: agent.name):
            place, moves = agent.place, []
            for name in WAYS[agent.name]:
                end = ends[PointName(name)]
                moves += [m for m in roadmap.leaving[place] if roadmap.moves.end[m] == end][:1]
                place = end
            found.append((agent.name, tuple(moves)))
        return found


@pytest.mark.parametrize("followers", [1, 2])
def test_who_never_heard_that_it_was_to_leave_is_not_waited_for_for_ever(followers):
    """Found by eight hours of faults: a restart while the link of the first robot was cut."""
    names = sorted(STARTS)[: 1 + followers]
    floor = Floor(lattice(5, 3), (GROUP,), {name: STARTS[name] for name in names}, [])
    floor.run(1.0)
    floor.traffic._planner = AllAtOnce()
    for name in map(RobotName, names):
        floor.goals[name] = Goal(point=PointName(GOALS[name]), rank=(0, 0, name))
    deaf = floor.robots[DEAF]
    deaf.tell, deaf.report_news = (lambda _: None), (lambda *_: None)
    floor.run(1.0)
    behind = floor.traffic._tracks[BEHIND]
    assert behind.promised
    assert behind.place != floor.traffic.roadmap.place[PointName("P2-1")], "and on from there"
    for robot in floor.robots.values():
        robot.tells = True
    floor.restart()
    floor.run(3.0)
    del deaf.tell, deaf.report_news
    floor.idle = set(floor.robots)
    floor.run(60.0)
    assert floor.done == dict.fromkeys(floor.robots, 1)
