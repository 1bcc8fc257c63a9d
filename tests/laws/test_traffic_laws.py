"""Laws of traffic: no two robots ever hold one piece of ground, whatever happens to reports."""

import math
import random

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ledger.ids import PointName
from ledger.scene import Area, Group, Path, Point
from ledger.scene_config import SceneConfig, TrafficMethod
from tests.scheduler.traffic.floor import Floor
from tests.scheduler.traffic.maps import area_of, lattice

GROUPS = (Group(id=0, name="g"),)
FEW = settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@st.composite
def roads(draw) -> Area:
    """Lattices of odd pitch with lanes left out, one-way lanes and bent ones."""
    chance = random.Random(draw(st.integers(0, 10_000)))
    full = lattice(
        draw(st.integers(2, 5)), draw(st.integers(2, 4)), draw(st.sampled_from((0.7, 1.4, 2.0)))
    )
    at = {point.name: point for point in full.points}
    paths = []
    for path in full.paths:
        if chance.random() < 0.15:
            continue
        a, b = at[path.start], at[path.end]
        controls: tuple[tuple[float, float], ...] = ()
        if chance.random() < 0.2:
            bent = (chance.uniform(-0.4, 0.4), chance.uniform(-0.4, 0.4))
            controls = (((a.x_m + b.x_m) / 2 + bent[0], (a.y_m + b.y_m) / 2 + bent[1]),)
        paths.append(Path(start=a.name, end=b.name, controls=controls))
    return area_of(list(full.points), paths)


@st.composite
def floors(draw) -> Floor:
    area = draw(roads())
    seed = draw(st.integers(0, 10_000))
    chance = random.Random(seed)
    points: list[Point] = []
    for point in chance.sample(area.points, len(area.points)):
        # Bodies must not overlap to begin with: that no planner could mend.
        if all(math.hypot(p.x_m - point.x_m, p.y_m - point.y_m) > 1.4 for p in points):
            points.append(point)
    count = draw(st.integers(1, min(6, len(points))))
    starts = {f"R{k}": (p.name, chance.uniform(-3, 3)) for k, p in enumerate(points[:count])}
    goals = [PointName(point.name) for point in area.points]
    config = SceneConfig(traffic_method=draw(st.sampled_from(TrafficMethod)))
    return Floor(area, GROUPS, starts, goals, seed=seed, late=0.1, service_s=1.0, config=config)


@FEW
@given(floors())
def test_no_two_robots_ever_hold_the_same_ground(floor):
    floor.run(40)


@FEW
@given(floors(), st.floats(0.05, 0.7))
def test_lost_reports_free_nothing_early(floor, loss):
    floor.run(40, report_loss=loss)


@FEW
@given(floors(), st.randoms(use_true_random=False))
def test_old_and_repeated_reports_change_nothing(floor, chance):
    kept = []
    for _ in range(250):
        floor.tick()
        kept += [robot.report(floor.now_ms, 0) for robot in floor.robots.values()]
        for report in kept[-len(floor.robots) :]:
            floor.traffic.observe(report)
        before = floor.traffic.plans(floor.now_ms)
        for report in chance.sample(kept, min(5, len(kept))):
            floor.traffic.observe(report)
        assert floor.traffic.plans(floor.now_ms) == before
    floor.judge()


@FEW
@given(floors(), st.lists(st.integers(1, 15), min_size=1, max_size=4))
def test_a_restart_at_any_moment_adopts_what_was_granted(floor, pauses_s):
    for pause_s in pauses_s:
        floor.run(pause_s)
        floor.restart()
    floor.run(20)
    assert all(floor.traffic.trouble(name) != "RobotRouteUnknown" for name in floor.robots)
