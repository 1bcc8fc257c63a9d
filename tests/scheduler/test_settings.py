"""Settings of a scene take effect with the event that changes them, on a scheduler at work."""

import msgspec

from ledger.events import (
    OrderAssigned,
    OrderCancelled,
    RobotDisconnected,
    RobotReconfigured,
    RobotTrafficReset,
    SceneConfigured,
    SceneDisabled,
    SceneDispatchPaused,
    SceneDispatchResumed,
    SceneEnabled,
    SceneRemoved,
    StepStarted,
)
from ledger.ids import RobotName
from ledger.link import Act, Alarm, AlarmLevel, Cancel
from ledger.scene_config import SceneConfig, TrafficMethod
from ledger.state import OrderKind
from tests.scheduler.small_shift import Shift
from tests.scheduler.small_site import SCENE, added, carry, imported

A = RobotName("A")


def shift(*robots: tuple[str, float]) -> Shift:
    work = Shift(imported(), *(added(name) for name, _ in robots))
    for name, x_m in robots:
        work.robots.place(name, x_m)
    work.run(1)
    return work


def configure(work: Shift, **settings: object) -> None:
    work.happen(SceneConfigured(scene=SCENE, config=SceneConfig(**settings)))  # type: ignore[arg-type]


def assigned(work: Shift) -> list[int]:
    return [int(e.order[-6:]) for e in work.happened(OrderAssigned) if e.order[-1].isdigit()]


def test_dispatch_sort_decides_who_is_first_and_is_put_back() -> None:
    for settings, order in (({}, [1, 2, 3]), ({"dispatch_sort": ("-externalId",)}, [2, 3, 1])):
        work = shift(("A", 0.0))
        work.happen(SceneDispatchPaused(scene=SCENE))
        work.happen(carry(1, "B5", "B6", priority=2, external_id="a"))
        work.happen(carry(2, "B5", "B6", priority=1, external_id="c"))
        work.happen(carry(3, "B5", "B6", external_id="b"))
        work.run(1)
        configure(work, **settings)
        work.happen(SceneDispatchResumed(scene=SCENE))
        work.run(120)
        assert not any(work.order(n) for n in (1, 2, 3))
        assert assigned(work) == order


def test_who_has_waited_too_long_comes_before_any_sorting() -> None:
    work = shift(("A", 0.0))
    work.happen(SceneDispatchPaused(scene=SCENE), carry(1, "B5", "B6"))
    work.run(3)
    work.happen(carry(2, "B5", "B6", priority=9))
    configure(work, dispatch_sort=("-priority",), dispatch_wait_s_max=2)
    work.happen(SceneDispatchResumed(scene=SCENE))
    work.run(1)
    assert assigned(work) == [1]


def test_distances_and_the_interval_of_planning_reach_traffic() -> None:
    work = shift(("A", 0.0))
    assert work.traffic[1].tuned == SceneConfig()
    config = SceneConfig(
        point_distance_m=0.1,
        path_distance_m=0.7,
        traffic_plan_interval_ms=900,
        traffic_method=TrafficMethod.VENUS,
    )
    work.happen(SceneConfigured(scene=SCENE, config=config))
    work.run(0.1)
    assert work.traffic[1].tuned == config


def test_a_robot_with_an_error_takes_orders_only_where_the_scene_lets_it() -> None:
    work = shift(("A", 0.0))
    broken = Alarm(level=AlarmLevel.ERROR, code="E", message="broken")
    work.robots.set("A", alarms=(broken,))
    work.happen(carry(1, "B5", "B6"))
    work.run(3)
    assert assigned(work) == []
    assert work.order(1).allocation_reject.robots == {"A": "RobotFault"}
    configure(work, pause_on_robot_error=False)
    work.run(1)
    assert assigned(work) == [1]


def test_an_action_of_a_cancelled_order_runs_on_where_the_scene_keeps_it() -> None:
    work = shift(("A", 0.0))
    work.happen(carry(1, "B0", "B6"))
    assert work.run(5, lambda: any(isinstance(m, Act) for m in work.robots.told))
    configure(work, keep_robot_on_cancel=True)
    work.happen(OrderCancelled(scene=SCENE, order=work.order(1).id))
    work.run(0.5)
    assert not any(isinstance(m, Cancel) for m in work.robots.told)
    configure(work, keep_robot_on_cancel=False)
    work.run(0.5)
    assert any(isinstance(m, Cancel) for m in work.robots.told)


def test_parking_pauses() -> None:
    work = shift(("A", 3.0))
    configure(work, parking_paused=True, parking_idle_s=1)
    work.run(20)
    assert not work.fleet.orders
    configure(work, parking_idle_s=1)
    work.run(2)
    assert [o.kind for o in work.fleet.orders.values()] == [OrderKind.PARKING]


def test_charging_pauses() -> None:
    work = shift(("A", 3.0))
    work.robots.set("A", battery_ratio=0.1)
    configure(work, charging_paused=True, parking_paused=True)
    work.run(20)
    assert not work.fleet.orders
    configure(work, parking_paused=True)
    work.run(2)
    assert [o.kind for o in work.fleet.orders.values()] == [OrderKind.CHARGING]


def test_orders_stay_where_reallocation_is_off() -> None:
    for off, robot in ((True, "A"), (False, "B")):
        work = shift(("A", 0.0))
        work.happen(carry(1, "B15", "B16"))
        work.run(1)
        configure(work, reallocation_off=off)
        work.happen(added("B"))
        work.robots.place("B", 14.0)
        work.run(4)
        assert work.order(1).robot == robot


def test_a_robot_may_be_silent_for_as_long_as_the_scene_says() -> None:
    for missed, lost in ((20, False), (3, True)):
        work = shift(("A", 0.0))
        configure(work, state_fetch_ms=1_000, state_failures_to_reconnect=missed)
        work.mute = {"A"}
        work.run(12)
        assert bool(work.happened(RobotDisconnected)) is lost


def test_a_paused_dispatch_assigns_nothing_and_says_so() -> None:
    work = shift(("A", 3.0))
    work.happen(SceneDispatchPaused(scene=SCENE), carry(1, "B5", "B6"))
    work.run(30)
    assert not work.happened(OrderAssigned), "nor does it park anybody"
    assert work.order(1).allocation_reject.code == "DispatchPaused"
    work.happen(SceneDispatchResumed(scene=SCENE))
    assert work.run(60, lambda: work.order(1) is None)


def test_a_disabled_scene_stops_and_comes_back() -> None:
    work = shift(("A", 0.0))
    work.happen(carry(1, "B5", "B9"))
    assert work.run(5, lambda: bool(work.happened(StepStarted)))
    work.happen(SceneDisabled(scene=SCENE), carry(2, "B5", "B9"))
    work.run(1)
    at_m = work.robots.reports[A].x_m
    work.run(40)
    assert work.robots.reports[A].x_m == at_m
    assert work.order(1).execution_reject.code == "SceneDisabled"
    assert work.order(2).allocation_reject.code == "SceneDisabled"
    work.happen(SceneEnabled(scene=SCENE))
    assert work.run(90, lambda: not work.order(1) and not work.order(2))


def test_a_removed_scene_is_left_alone() -> None:
    work = shift(("A", 0.0))
    work.happen(SceneRemoved(scene=SCENE))
    work.run(20)
    assert not work.robots.told
    assert not work.fleet.robots
    assert not work.scheduler._sites


def test_a_robot_of_another_group_and_one_whose_traffic_is_reset_are_placed_anew() -> None:
    work = shift(("A", 0.0))
    traffic = work.traffic[1]
    placed: list[tuple[str, int]] = []
    add = traffic.add
    traffic.add = lambda robot, group: (placed.append((robot, group)), add(robot, group))[1]  # type: ignore[method-assign]
    config = msgspec.structs.replace(work.robot("A").config, group=1)
    work.happen(RobotReconfigured(scene=SCENE, robot=A, config=config))
    work.run(1)
    assert placed == [("A", 1)]
    work.happen(RobotTrafficReset(scene=SCENE, robot=A))
    work.run(1)
    assert placed == [("A", 1), ("A", 1)]
    assert work.traffic[1].known["A"] == 0.0


def test_the_traffic_of_a_robot_that_does_not_answer_is_reset_when_it_does() -> None:
    work = shift(("A", 4.0))
    configure(work, parking_paused=True)
    work.mute = {"A"}
    work.run(12)
    work.happen(RobotTrafficReset(scene=SCENE, robot=A))
    work.run(5)
    assert work.traffic[1].known["A"] == 4.0, "its ground is not given to others"
    work.mute = set()
    work.run(1)
    assert work.traffic[1].known["A"] == 4.0
    assert "A" not in work.traffic[1].gone
