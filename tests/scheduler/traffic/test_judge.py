import math

from ledger.ids import RobotName, SceneId
from ledger.link import Plan, Space
from scheduler.traffic.judge import body, collisions, double_grants, outside

BOX = ((0.5, 0.35), (-0.5, 0.35), (-0.5, -0.35), (0.5, -0.35))
A, B = RobotName("A"), RobotName("B")


def plan(robot, *polygons):
    return Plan(
        scene=SceneId("s"),
        robot=robot,
        at_ms=0,
        ready=True,
        spaces=tuple(Space(points=tuple(polygon)) for polygon in polygons),
    )


def square(x):
    return ((x, 0), (x + 1, 0), (x + 1, 1), (x, 1))


def test_bodies_collide_only_if_they_overlap():
    turned = body(BOX, 0.9, 0.0, math.pi / 2)
    assert collisions({A: body(BOX, 0.0, 0.0, 0.0), B: body(BOX, 0.9, 0.0, 0.0)}) == [(A, B)]
    assert collisions({A: body(BOX, 0.0, 0.0, 0.0), B: turned}) == []


def test_an_empty_floor_has_no_collisions():
    assert collisions({}) == []
    assert double_grants([plan(A)]) == []


def test_ground_held_twice_is_named_and_touching_is_not():
    assert double_grants([plan(A, square(0)), plan(B, square(0.5))]) == [(A, B)]
    assert double_grants([plan(A, square(0), square(0.5)), plan(B, square(1.5))]) == []


def test_a_body_outside_its_own_ground_is_seen():
    ground = plan(A, ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    assert not outside(ground, body(BOX, 0.0, 0.0, 0.3))
    assert outside(ground, body(BOX, 0.6, 0.0, 0.0))
