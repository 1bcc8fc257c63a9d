"""Laws of doors: nobody is in one that is not open, and who waits for one says so."""

from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from ledger.link import DoorStatus
from ledger.scene import Area, Door
from tests.laws.doors import Doorkeeping, door_across, door_at, hall

FEW = settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])
ASKED = ("open", "close", "hold", "let go", "jam", "mend", "kill sim", "kill scheduler")


@st.composite
def plants(draw) -> tuple[Area, tuple[Door, ...], int, int, float]:
    columns, rows = draw(st.integers(3, 5)), draw(st.integers(2, 3))
    area = hall(columns, rows)
    lanes = sorted({tuple(sorted((p.start, p.end))) for p in area.paths})
    chosen = draw(st.lists(st.sampled_from(lanes), min_size=1, max_size=4, unique=True))
    doors = [door_across(n, a, b) for n, (a, b) in enumerate(chosen)]
    if draw(st.booleans()):
        doors.append(door_at(9, draw(st.sampled_from(area.points)).name))
    robots = draw(st.integers(1, columns * rows // 3))
    late = draw(st.sampled_from((0.0, 0.15)))
    return area, tuple(doors), robots, draw(st.integers(0, 10_000)), late


@FEW
@given(plants(), st.lists(st.tuples(st.sampled_from(ASKED), st.integers(0, 3)), max_size=14))
def test_nobody_is_ever_in_a_door_that_is_not_open_and_all_orders_end(plant, asked):
    with Doorkeeping(*plant) as work:
        assume(not work.in_doors())  # to begin with: nobody could have asked for the door
        for what, which in asked:
            work.order_at_random()
            work.ask(what, work.doors[which % len(work.doors)].id)
            work.run(9)
        work.finish(900)
        assert work.business() == []
        work.run(20)
        for door in work.doors:
            wanted = work.shift.role.scheduler._sites[work.shift.scene].devices._doors.states()
            if door.id not in {state.door for state in wanted if state.robots}:
                assert work.status(door.id) is DoorStatus.CLOSED


def test_a_door_opens_for_a_robot_and_closes_behind_it():
    with Doorkeeping(hall(4, 1), (door_across(1, "P1-0", "P2-0"),), 1, seed=3) as work:
        work.order("P0-0", "P3-0", "P0-0")
        seen = set()

        def look() -> None:
            work.judge()
            seen.add(work.status(1))

        work.shift.run(90, look)
        assert work.business() == []
        assert seen == set(DoorStatus) - {DoorStatus.UNKNOWN}
        assert work.status(1) is DoorStatus.CLOSED


def test_robots_go_round_a_door_that_does_not_work():
    with Doorkeeping(hall(4, 2), (door_across(1, "P1-0", "P2-0"),), 1, seed=3) as work:
        work.run(2)
        work.ask("jam", 1)
        work.run(2)
        work.order("P0-0", "P3-0")
        work.run(60)
        assert work.business() == []
        assert work.status(1) is DoorStatus.CLOSED


def test_a_robot_that_waits_for_a_broken_door_says_so_and_goes_on_once_it_is_mended():
    with Doorkeeping(hall(4, 1), (door_across(1, "P1-0", "P2-0"),), 1, seed=3) as work:
        work.order("P0-0", "P3-0", "P0-0")
        work.run(4)
        work.ask("jam", 1)
        work.run(60)
        (order,) = work.shift.fleet.orders.values()
        assert order.execution_reject is not None
        assert order.execution_reject.code == "DoorFault"
        assert order.execution_reject.robots == {"door:D1": "DoorFault"}
        (fault,) = work.shift.fleet.device_faults.values()
        assert fault.reason == "it is stuck"
        work.ask("mend", 1)
        work.run(90)
        assert work.business() == []
        assert work.shift.fleet.device_faults == {}


def test_a_robot_in_a_door_that_jams_open_drives_out_of_it():
    with Doorkeeping(hall(4, 1), (door_at(1, "P1-0"),), 1, seed=3) as work:
        work.order("P0-0", "P1-0")
        work.run(60)
        assert work.status(1) is DoorStatus.OPENED, "a robot rests in it"
        work.ask("jam", 1)
        work.order("P3-0")
        work.run(60)
        assert work.business() == []
