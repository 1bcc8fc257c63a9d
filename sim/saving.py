"""A simulated robot's memory as a value, so that after a crash it goes on where it was."""

from ledger.ids import PointName, RobotName, SceneId
from ledger.link import DISPATCHER, ActionReport, Alarm, Mark, Piece
from ledger.scene import Value
from sim.legs import Body, Leg
from sim.robot import SimRobot, look_ahead, resume_joins

SAVED_VERSION = 1


class SavedRobot(Value, frozen=True, kw_only=True):
    """All that one robot remembers; fields as in SimRobot. A cut link is not: it connects anew."""

    scene: SceneId
    name: RobotName
    area: int
    map_digest: str
    session: str
    past: tuple[str, ...]
    x_m: float
    y_m: float
    heading_rad: float
    point: PointName | None
    pieces: tuple[Piece, ...]
    done: Mark
    along: float
    speed: float
    authority: Mark
    held_s: float
    commit: int
    charging: bool
    failing: tuple[str, ...]
    action_left_s: float
    action: str | None
    actions: tuple[ActionReport, ...]
    battery_ratio: float
    odometer_m: float
    settled_m: float
    settled_s: float
    today: int
    today_m: float
    number: int
    alarms: tuple[Alarm, ...]
    tell_route: bool
    soft_stop: bool = False
    paused: bool = False
    controller: str = DISPATCHER
    obeyed: int = 0


class SavedWorld(Value, frozen=True, kw_only=True):
    """All robots at one moment."""

    version: int = SAVED_VERSION
    elapsed_s: float
    chance: tuple[int, tuple[int, ...], float | None] | None  # of a world with faults
    robots: tuple[SavedRobot, ...]


def saved(robot: SimRobot) -> SavedRobot:
    """Take down what a robot remembers."""
    actions = robot.actions
    return SavedRobot(
        scene=robot.body.scene,
        name=robot.body.name,
        area=robot.body.area,
        map_digest=robot.body.map_digest,
        session=robot.session,
        past=tuple(robot.past),
        x_m=robot.x,
        y_m=robot.y,
        heading_rad=robot.heading,
        point=robot.point,
        pieces=tuple(leg.piece for leg in robot.legs),
        done=robot.done,
        along=robot.along,
        speed=robot.speed,
        authority=robot.authority,
        held_s=robot.held_s,
        commit=robot.commit,
        charging=actions.charging,
        failing=tuple(sorted(actions.failing)),
        action_left_s=actions.left_s,
        action=actions.newest,
        actions=tuple(actions.reports.values()),
        battery_ratio=robot.battery,
        odometer_m=robot.odometer_m,
        settled_m=robot.settled_m,
        settled_s=robot.settled_s,
        today=robot.today,
        today_m=robot.today_m,
        number=robot.number,
        alarms=tuple(robot.alarms.values()),
        tell_route=robot.tell_route,
        soft_stop=robot.soft_stop,
        paused=robot.paused,
        controller=robot.controller,
        obeyed=robot.obeyed,
    )


def restored(body: Body, memory: SavedRobot) -> SimRobot:
    """Make the robot that goes on as the saved one would have."""
    robot = SimRobot(body, memory.session, (memory.x_m, memory.y_m, memory.heading_rad))
    robot.past.extend(memory.past)
    robot.point = memory.point
    robot.legs.extend(Leg(piece, body.kinematics) for piece in memory.pieces)
    robot.done = memory.done
    robot.along, robot.speed = memory.along, memory.speed
    robot.authority = memory.authority
    robot.held_s, robot.commit = memory.held_s, memory.commit
    actions = robot.actions
    actions.charging = memory.charging
    actions.failing = set(memory.failing)
    actions.left_s, actions.newest = memory.action_left_s, memory.action
    actions.reports = {report.id: report for report in memory.actions}
    robot.battery = memory.battery_ratio
    robot.odometer_m = memory.odometer_m
    robot.settled_m, robot.settled_s = memory.settled_m, memory.settled_s
    robot.today, robot.today_m, robot.number = memory.today, memory.today_m, memory.number
    robot.alarms = {alarm.code: alarm for alarm in memory.alarms}
    robot.tell_route = memory.tell_route
    robot.soft_stop, robot.paused = memory.soft_stop, memory.paused
    robot.controller, robot.obeyed = memory.controller, memory.obeyed
    resume_joins(robot)
    look_ahead(robot)
    return robot
