"""Names of things, one type each, so that an order id is never passed where a robot name is due."""

from typing import NewType

SceneId = NewType("SceneId", str)  # 24 hexadecimal digits when we make it
OrderId = NewType("OrderId", str)  # TOyyyymmdd-NNNNNN and a suffix for the system's own orders
StepId = NewType("StepId", str)  # <order>-Step<n>
RobotName = NewType("RobotName", str)  # unique in its scene
PointName = NewType("PointName", str)  # unique in its scene
BinName = NewType("BinName", str)  # unique in its scene
PathKey = NewType("PathKey", str)  # <start point>-><end point>
CommandId = NewType("CommandId", str)  # the client's Idempotency-Key, or ours
UnitId = NewType("UnitId", str)  # of an external reservation, made up by its owner
RobotKey = NewType("RobotKey", str)  # <scene>/<robot>: robot names are unique in a scene only


def robot_key(scene: SceneId, robot: RobotName) -> RobotKey:
    """Key of a robot in the fleet; scene ids hold no slash."""
    return RobotKey(f"{scene}/{robot}")


def path_key(start: PointName, end: PointName) -> PathKey:
    """Key of a directed path, spelt as M4 spells it (`AP33->LM32`)."""
    return PathKey(f"{start}->{end}")
