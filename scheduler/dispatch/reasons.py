"""The stable codes by which dispatch says why not. Programs read them; never change a meaning."""

from enum import StrEnum


class Why(StrEnum):
    """Why a robot does not take an order, or does not get on with one."""

    ROBOT_DISABLED = "RobotDisabled"  # taken out of dispatch
    ROBOT_OFFLINE = "RobotOffline"  # does not answer
    ROBOT_OFF_DUTY = "RobotOffDuty"  # told to take no more orders
    ROBOT_NOT_WANTED = "RobotNotWanted"  # the order names other robots or groups
    ROBOT_NOT_READY = "RobotNotReady"  # traffic does not know yet where it is
    ROBOT_EMERGENCY_STOP = "RobotEmergencyStop"  # stopped by hand
    ROBOT_SOFT_STOPPED = "RobotSoftStopped"  # by an operator, or at the robot itself
    ROBOT_NOT_CONTROLLED = "RobotNotControlled"  # somebody else has control of it, or nobody
    ROBOT_PAUSED = "RobotPaused"  # told to stay where it is
    ROBOT_FAULT = "RobotFault"  # reports an Error or Fatal alarm (pause_on_robot_error)
    ROBOT_BATTERY_LOW = "RobotBatteryLow"  # below charge_only, or not yet back at charge_ok
    ROBOT_CHARGING = "RobotCharging"  # has charged for less than charging_min_s
    ROBOT_BUSY_KEEPS_ORDER = "RobotBusyKeepsOrder"  # its next step must be of its present order
    ROBOT_NO_MORE_BIN = "RobotNoMoreBin"  # each of its bins has an order or a load
    ROBOT_TAKEN_BY_OTHER = "RobotTakenByOther"  # a better order got its last bin just now
    NO_ROUTE = "NoRoute"  # cannot drive to the order's first location
    GROUND_RESERVED = "GroundReserved"  # could get there, but for ground reserved for somebody
    CORRIDOR_FULL = "CorridorFull"  # robots enough are about in a single-lane aisle it leads to
    NO_ROOM_TO_LOAD = "NoRoomToLoad"  # somebody is where its load would be
    ROBOT_BLOCKED = "RobotBlocked"  # has a way, but has not moved for long
    ROBOT_OBSTRUCTED = "RobotObstructed"  # its own sensors see something in the way
    ROBOT_IN_THE_WAY = "RobotInTheWay"  # stands or drives where another wants to go
    DOOR_CLOSED = "DoorClosed"  # has waited for long for a door to open
    DOOR_FAULT = "DoorFault"  # its only way leads through a door that does not work
    LOCATION_UNKNOWN = "LocationUnknown"  # the map has no such point or bin any more
    ORDER_SUSPENDED = "OrderSuspended"  # somebody holds the order up
    SCENE_DISABLED = "SceneDisabled"  # taken out of service as a whole
    TRAFFIC_PAUSED = "TrafficPaused"  # traffic_paused is set


class NotAssigned(StrEnum):
    """Why an order as a whole has no robot (M4 allocationReject.code)."""

    ALL_ROBOTS = "AllRobotUnDispatchable"  # each robot has its own reason (spec/m4.md)
    NO_ROBOT = "NoRobot"  # the scene has no robots
    DISPATCH_PAUSED = "DispatchPaused"  # somebody holds up all assignment in the scene
    ORDER_SUSPENDED = "OrderSuspended"  # somebody holds the order up
    SCENE_DISABLED = "SceneDisabled"
