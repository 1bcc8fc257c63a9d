"""Robots and plans for tests of the telemetry log."""

from ledger.ids import RobotName, SceneId
from ledger.link import Plan, Report, Space
from ledger.telemetry import TelemetryLog

SCENE = SceneId("00000000000000000000000a")
OTHER = SceneId("00000000000000000000000b")
T0 = 1_795_000_000_000


def report(robot: str, at_ms: int, x_m: float, scene: SceneId = SCENE) -> Report:
    return Report(
        scene=scene,
        robot=RobotName(robot),
        number=at_ms - T0,
        at_ms=at_ms,
        area=0,
        x_m=x_m,
        y_m=1.5,
        heading_rad=0.25,
    )


def plan(robot: str, at_ms: int, x_m: float) -> Plan:
    """Hold a square metre, and half a dozen others with who is near."""
    squares = (((x, 0.0), (x + 1, 0.0), (x + 1, 1.0), (x, 1.0)) for x in (x_m,))
    return Plan(
        scene=SCENE,
        robot=RobotName(robot),
        at_ms=at_ms,
        ready=True,
        spaces=tuple(Space(points=points) for points in squares),
    )


def drive(log: TelemetryLog, seconds: int, robots: int = 3, start_ms: int = T0) -> list[Report]:
    """Ten reports a second of every robot, all moving; gives them all."""
    said = []
    for tick in range(seconds * 10):
        at_ms = start_ms + tick * 100
        batch = [report(f"R{n}", at_ms, (at_ms - T0) / 1000 + n) for n in range(robots)]
        log.write(batch)
        said += batch
    return said
