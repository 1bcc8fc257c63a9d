"""Robots that pass each other by sidings so near to the lane that only one at rest clears it."""

from itertools import pairwise

import msgspec
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ledger.scene import Group, Kinematics, PointKind
from tests.laws.routes import acyclic
from tests.scheduler.traffic.floor import Floor
from tests.scheduler.traffic.stuck import drawn

LANE, PITCH_M, SIDING_M = "abcdefghijk", 1.7, 1.02
SIDINGS = dict(zip("stuv", "cegi", strict=True))  # and the points of the lane that they are beside
GROUPS = (Group(id=0, name="g", kinematics=Kinematics(turn_radps2_max=1e6)),)


def sidings():
    at = {name: (PITCH_M * k, 0.0) for k, name in enumerate(LANE)}
    at |= {name: (at[beside][0], -SIDING_M) for name, beside in SIDINGS.items()}
    ways = [a + b for a, b in pairwise(LANE)]
    area = drawn(at, " ".join([*ways, *(a + b for b, a in SIDINGS.items())]))
    replace = msgspec.structs.replace
    points = (
        replace(point, kind=PointKind.PARKING) if point.name in SIDINGS else point
        for point in area.points
    )
    return replace(area, points=tuple(points))


TICKS, NEVER = 1_200, -100
HEARD = 20  # ticks until a new scheduler has heard from everybody
AREA = sidings()
NAMES = [point.name for point in AREA.points]


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 10_000), st.integers(100, 1_100))
@example(177, NEVER)  # one was sent on before it was at rest, and others had counted on its rest
@example(209, NEVER)
@example(27, 652)  # and a new scheduler did not know that they had …
@example(926, 193)  # … nor that the rest was its own already
def test_nobody_who_counts_on_the_rest_of_another_waits_in_a_ring_with_it(seed, restart):
    starts = {"A": ("a", 0.0), "B": ("k", 0.0), "C": ("t", 0.0), "D": ("f", 0.0)}
    floor = Floor(AREA, GROUPS, starts, NAMES, seed=seed, late=0.1, service_s=2.0)
    for tick in range(TICKS):
        floor.tick()
        if tick == restart:
            floor.restart()
        if tick % 10 == 0 and not 0 <= tick - restart < HEARD:
            acyclic(floor.traffic)
        if tick % 50 == 0:
            floor.judge()
