"""Laws of the guard: a bug in the books is stopped before robots touch, on record and for all."""

from random import Random

import pytest

from commands.instructions import SoftStopRobots
from fleetledger.shift import Shift
from ledger.events import RobotSoftStopLifted, RobotSoftStopped
from ledger.ids import RobotName, robot_key
from ledger.link import AlarmLevel, InstructionKind
from scheduler.traffic.judge import collisions
from sim.faults import FaultMix
from sim.robot import SimRobot
from sim.warehouses import generate
from tests.laws.onlooker import Onlooker, ask
from tests.laws.test_shift_laws import some_orders


def at_work(seed: int, robots: int = 6) -> Onlooker:
    file = generate(aisles=2, bays=2, robots=robots, seed=seed)
    shift = Shift(file, seed=seed, faults=FaultMix(late_ratio=0.2, late_mean_s=3.0))
    onlooker = Onlooker(shift)
    onlooker.run(5.0)
    some_orders(shift, file, robots, Random(seed))
    return onlooker


def traffic_of(shift: Shift):
    return shift.role.scheduler._sites[shift.scene].traffic[0]


def stops(shift: Shift) -> list[RobotSoftStopped]:
    return [e for e in shift.ledger.read(0) if isinstance(e, RobotSoftStopped)]


def strike_blind(shift: Shift) -> None:
    """The conflict table knows of no two cells any more that exclude each other."""
    traffic_of(shift).grants._static = lambda cell: (cell,)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_broken_conflict_table_hurts_nobody(seed):
    onlooker = at_work(seed)
    shift = onlooker.shift
    strike_blind(shift)
    for _ in range(300):
        shift.run(0.2)
        assert collisions({name: b for (_, name), b in onlooker.bodies().items()}) == []
    found = stops(shift)
    assert found, "nothing to catch"
    assert all(stop.reason.startswith("GroundTaken: ") and stop.by for stop in found)
    assert traffic_of(shift).breaches_so_far
    onlooker.states_agree()


def test_without_a_bug_nobody_is_stopped():
    onlooker = at_work(3)
    onlooker.run(120.0)
    assert stops(onlooker.shift) == []
    assert traffic_of(onlooker.shift).breaches_so_far == 0


def carried(shift: Shift) -> tuple[SimRobot, SimRobot, tuple[float, float]]:
    """Somebody has pushed one robot into another, both at rest."""
    one, other = list(shift.world.robots())[:2]
    home = (one.x, one.y)
    one.x, one.y = other.x + 0.3, other.y + 0.2
    one.changed = one.awake = True
    return one, other, home


def at_rest(robots: int = 3) -> Onlooker:
    shift = Shift(generate(aisles=2, bays=2, robots=robots, seed=1), seed=1)
    shift.run(8.0)
    return Onlooker(shift)


def robot(shift: Shift, body: SimRobot):
    return shift.fleet.robots[robot_key(shift.scene, RobotName(body.body.name))]


def test_robots_that_touch_are_held_with_an_alarm_that_names_both_until_they_are_apart():
    shift = at_rest().shift
    one, other, home = carried(shift)
    shift.run(2.0)
    names = sorted((one.body.name, other.body.name))
    assert {stop.robot for stop in stops(shift)} == set(names)
    assert one.soft_stop and other.soft_stop
    plan = shift.role.scheduler._sites[shift.scene].plans[RobotName(names[0])]
    assert plan.alarm is not None and plan.alarm.level is AlarmLevel.FATAL
    assert all(name in plan.alarm.message for name in names)
    shift.restart_scheduler()
    shift.run(4.0)
    assert one.soft_stop and other.soft_stop
    one.x, one.y = home
    one.changed = one.awake = True
    shift.run(4.0)
    assert not one.soft_stop and not other.soft_stop
    lifted = [e.robot for e in shift.ledger.read(0) if isinstance(e, RobotSoftStopLifted)]
    assert sorted(lifted) == names
    assert len(stops(shift)) == 2


def test_an_operator_may_send_a_held_robot_on_and_keeps_stops_of_their_own():
    shift = at_rest().shift
    one, other, home = carried(shift)
    shift.run(2.0)
    name, mine = RobotName(one.body.name), RobotName(other.body.name)
    told = {"scene": shift.scene, "robots": (name,)}
    shift.handler.handle(ask(shift, SoftStopRobots, stopped=False, **told))
    shift.run(6.0)
    assert not one.soft_stop, "the guard may not take it back"
    assert other.soft_stop
    shift.handler.handle(
        ask(shift, SoftStopRobots, stopped=True, scene=shift.scene, robots=(mine,))
    )
    one.x, one.y = home
    one.changed = one.awake = True
    shift.run(4.0)
    stop = robot(shift, other).told(InstructionKind.SOFT_STOP)
    assert other.soft_stop and stop is not None and not stop.reason


def stage(seed: int) -> None:
    """A soak's turn: quiet as long as nothing is wrong, and nobody hurt when everything is."""
    onlooker = at_work(seed)
    onlooker.run(60.0)
    assert stops(onlooker.shift) == []
    strike_blind(onlooker.shift)
    for _ in range(300):
        onlooker.shift.run(0.2)
        assert collisions({name: b for (_, name), b in onlooker.bodies().items()}) == []
