"""All simulated robots together: who is there, time passing, what they say, and their memory."""

import random
from collections.abc import Container, Iterable
from math import ceil

import msgspec

from ledger.ids import RobotKey, RobotName, SceneId, robot_key
from ledger.link import (
    DISPATCHER,
    Act,
    Cancel,
    Drive,
    Instruct,
    Reconnect,
    Report,
    TellRoute,
    ToRobot,
)
from ledger.scene import Group, RobotConfig, Scene
from sim.actions import ACTION_FAILED, CHARGE, action_failed, must_fail
from sim.faults import NONE, FaultMix
from sim.instructions import obey
from sim.legs import Body
from sim.people import BY_HAND
from sim.placement import Ground, Place, free_place, radius_m
from sim.radio import Radio
from sim.reporting import report
from sim.robot import Hears, SimRobot, drive, settle, stands_on, step
from sim.saving import SAVED_VERSION, SavedRobot, SavedWorld, restored, saved
from sim.troubles import Troubles

STANDING_MPS = 0.01  # slower is no moving: the last of the way after a stop, a millimetre at most
STEP_S_MAX = 0.2  # longer ones are cut: speed changes evenly within one
BATTERY_RATIO_MIN = 0.6  # of a new robot; they differ, so that not all charge at once


class World:
    """Holds the robots. Deterministic: the same calls with the same seed give the same bytes."""

    def __init__(self, rng: random.Random, faults: FaultMix = NONE) -> None:
        self._rng = rng
        self._faults = faults
        self._troubles = Troubles(rng, faults) if faults.strikes else None
        self._radio = Radio(rng, faults) if faults.disturbs_reports else None
        self._elapsed_s = 0.0
        self._robots: dict[RobotKey, SimRobot] = {}
        self._grounds: dict[tuple[SceneId, int], Ground] = {}
        self._remembered: dict[RobotKey, SavedRobot] = {}

    def __contains__(self, key: RobotKey) -> bool:
        return key in self._robots

    def __len__(self) -> int:
        return len(self._robots)

    def robots(self) -> Iterable[SimRobot]:
        """All robots, first added first."""
        return self._robots.values()

    def remembers(self, key: RobotKey) -> bool:
        """Tell whether a loaded memory waits for this robot; add such robots before others."""
        return key in self._remembered

    def add(self, scene: Scene, config: RobotConfig, at_ms: int) -> bool:
        """Put a robot where it was, or on a free place; False if there is no room for it."""
        key = robot_key(scene.id, config.name)
        if key in self._robots:
            return True
        memory = self._remembered.pop(key, None)
        grounds = self._grounds_of(scene)
        group = _group(scene, config)
        if memory is not None:
            for ground in grounds:
                if (memory.area, memory.map_digest) == (ground.area.id, ground.area.map_digest):
                    body = _body(scene, config, group, ground)
                    robot = self._robots[key] = restored(body, memory)
                    if robot.controller == BY_HAND:  # nobody knows any more who drove it
                        robot.controller = DISPATCHER
                    return True
        others = [r for r in self._robots.values() if r.body.scene == scene.id]
        preferred = memory.point if memory is not None else None
        found = free_place(grounds, radius_m(group), others, preferred)
        if found is None:
            return False
        robot = self._robots[key] = self._new_robot(scene, config, found, at_ms)
        if memory is not None:
            robot.battery, robot.odometer_m = memory.battery_ratio, memory.odometer_m
            robot.settled_m = memory.settled_m
            robot.today, robot.today_m = memory.today, memory.today_m
        return True

    def _new_robot(self, scene: Scene, config: RobotConfig, place: Place, at_ms: int) -> SimRobot:
        ground = self._grounds[scene.id, place.area.id]
        body = _body(scene, config, _group(scene, config), ground)
        # the time is in it because chance repeats itself after a restart with the same seed
        session = f"{at_ms:x}-{self._rng.getrandbits(32):08x}"
        robot = SimRobot(body, session, (place.x_m, place.y_m, place.heading_rad))
        robot.point = place.point
        robot.battery = self._rng.uniform(BATTERY_RATIO_MIN, 1.0)
        robot.settled_s = self._elapsed_s
        return robot

    def _grounds_of(self, scene: Scene) -> list[Ground]:
        grounds = []
        for area in scene.areas:
            if area.disabled:
                continue
            ground = self._grounds.get((scene.id, area.id))
            if ground is None or ground.area is not area:
                ground = self._grounds[scene.id, area.id] = Ground(area)
            grounds.append(ground)
        return grounds

    def remove(self, key: RobotKey) -> None:
        """Take a robot away, memory and all."""
        self._robots.pop(key, None)
        self._remembered.pop(key, None)

    def rest(self, key: RobotKey) -> None:
        """Take a robot away that will come back as it was, for its whole scene rests."""
        robot = self._robots.pop(key, None)
        if robot is not None:
            self._remembered[key] = saved(robot)

    def remap(self, scene: Scene, config: RobotConfig, at_ms: int) -> bool:
        """Go over to a changed scene.

        On a changed map a robot keeps its point if that is still there, but forgets its route,
        for that is of the old map; False if there is no room for it.
        """
        key = robot_key(scene.id, config.name)
        robot = self._robots.get(key)
        if robot is None:
            return self.add(scene, config, at_ms)
        for ground in self._grounds_of(scene):
            if (robot.body.area, robot.body.map_digest) == (
                ground.area.id,
                ground.area.map_digest,
            ):
                robot.body = _body(scene, config, _group(scene, config), ground)
                return True
        del self._robots[key]
        self._remembered[key] = saved(robot)
        return self.add(scene, config, at_ms)

    def tell(self, scene: SceneId, message: ToRobot) -> None:
        """Hand a message to its robot; one that is not there hears nothing."""
        robot = self._robots.get(robot_key(scene, message.robot))
        if robot is None or not _hears(robot, message):
            return
        settle(robot, self._elapsed_s)
        match message:
            case Drive():
                drive(robot, message)
            case Act():
                _begin(robot, message)
            case Cancel():
                robot.actions.cancel(message.id)
            case TellRoute():
                robot.tell_route = True
            case Instruct():
                obey(robot, message)
            case Reconnect():
                robot.hears = Hears.ALL
        robot.changed = robot.awake = True

    def is_linked(self, key: RobotKey) -> bool:
        """Tell whether the robot's link stands."""
        robot = self._robots.get(key)
        return robot is not None and robot.hears is Hears.ALL

    # -- faults, and people at the robot itself

    @property
    def troubles(self) -> dict[RobotKey, str]:
        """Robots that a fault has struck, and how; late ones and lost reports are none."""
        if self._troubles is None:
            return {}
        return {key: trouble.kind for key, trouble in self._troubles.suffering.items()}

    @property
    def struck(self) -> dict[str, int]:
        """How often which fault has struck."""
        return {} if self._troubles is None else dict(self._troubles.struck)

    def calm(self) -> None:
        """Let no new fault strike; people end what they are at."""
        self._faults, self._radio = NONE, None
        if self._troubles is not None:
            self._troubles.end(self._elapsed_s)

    def cut(self, scene: SceneId, robot: RobotName, *, deaf: bool = False) -> None:
        """Cut the link: nothing comes or goes but the call to reconnect, and if deaf not even it.

        The robot itself does not notice: it drives as far as it may.
        """
        self._at(scene, robot).hears = Hears.NOTHING if deaf else Hears.RECONNECT

    def mend(self, scene: SceneId, robot: RobotName) -> None:
        """Put the link back."""
        self._at(scene, robot).hears = Hears.ALL

    def seize(self, scene: SceneId, robot: RobotName, who: str) -> None:
        """Have somebody else take control; nobody = empty. It keeps the authority it has."""
        self._at(scene, robot).controller = who

    def press_soft_stop(self, scene: SceneId, robot: RobotName, *, on: bool = True) -> None:
        """Press the soft stop at the robot itself, or pull it out again."""
        self._at(scene, robot).soft_stop = on

    def _at(self, scene: SceneId, name: RobotName) -> SimRobot:
        robot = self._robots[robot_key(scene, name)]
        robot.changed = robot.awake = True
        return robot

    def fail_next(self, scene: SceneId, robot: RobotName, action: str) -> None:
        """Make the next action of that name fail."""
        self._robots[robot_key(scene, robot)].actions.failing.add(action)

    def step(self, dt_s: float) -> None:
        """Let time pass for everybody."""
        if dt_s <= 0.0:
            return
        parts = ceil(dt_s / STEP_S_MAX - 1e-9)
        part_s = dt_s / parts
        for _ in range(parts):
            self._elapsed_s += part_s
            for robot in self._robots.values():
                if robot.awake:
                    if robot.actions.charging:
                        settle(robot, self._elapsed_s)
                    step(robot, part_s)
                    if self._faults.late_ratio:
                        self._delay(robot)
            if self._troubles is not None:
                self._troubles.step(self._elapsed_s, part_s, self._robots, self._ground)

    def _delay(self, robot: SimRobot) -> None:
        if robot.legs and robot.legs[0].piece.commit != robot.commit:
            robot.commit = robot.legs[0].piece.commit
            if self._rng.random() < self._faults.late_ratio:
                robot.held_s = self._rng.expovariate(1.0 / self._faults.late_mean_s)

    def _ground(self, robot: SimRobot) -> Ground:
        return self._grounds[robot.body.scene, robot.body.area]

    def reports(
        self, at_ms: int, *, changed_only: bool = False, whole: Container[SceneId] = ()
    ) -> list[Report]:
        """Build the reports of all robots that are heard, or of those with news since their last.

        Of the scenes in `whole` all robots report, news or not.
        """
        said = [
            report(robot, at_ms, self._elapsed_s)
            for robot in self._robots.values()
            if robot.hears is Hears.ALL
            and (robot.changed or not changed_only or robot.body.scene in whole)
        ]
        if self._radio is None:
            return said
        return self._radio.pass_on(said, () if self._troubles is None else self._troubles.moved)

    def save(self) -> bytes:
        """Take down everybody at one moment; those of whom `load` told and who are not back too."""
        present = [saved(robot) for robot in self._robots.values()]
        chance = self._rng.getstate() if self._faults != NONE else None
        return msgspec.msgpack.encode(
            SavedWorld(
                elapsed_s=self._elapsed_s,
                chance=chance,
                robots=(*present, *self._remembered.values()),
            )
        )

    def load(self, raw: bytes) -> None:
        """Remember; each robot goes on where it was as soon as it is added again.

        Raises msgspec.DecodeError or ValueError on bytes that are not from `save`.
        """
        world = msgspec.msgpack.decode(raw, type=SavedWorld)
        if world.version != SAVED_VERSION:
            raise ValueError(f"a world of version {world.version}, not {SAVED_VERSION}")
        self._elapsed_s = world.elapsed_s
        if world.chance is not None and self._faults != NONE:
            self._rng.setstate(world.chance)
        self._remembered = {robot_key(r.scene, r.name): r for r in world.robots}


def _group(scene: Scene, config: RobotConfig) -> Group:
    return next((g for g in scene.groups if g.id == config.group), Group(id=0, name="default"))


def _body(scene: Scene, config: RobotConfig, group: Group, ground: Ground) -> Body:
    return Body(
        scene=scene.id,
        name=config.name,
        area=ground.area.id,
        map_name=ground.area.map_name,
        map_digest=ground.area.map_digest,
        kinematics=group.kinematics,
        radius_m=radius_m(group),
        chargers=ground.chargers,
    )


def _hears(robot: SimRobot, message: ToRobot) -> bool:
    """Tell whether a message reaches the robot, and whether it obeys who sends it."""
    if robot.hears is not Hears.ALL:
        return robot.hears is Hears.RECONNECT and isinstance(message, Reconnect)
    return robot.controller == DISPATCHER or not isinstance(message, Drive | Act | Cancel)


def _begin(robot: SimRobot, act: Act) -> None:
    told_before = act.id in robot.actions.reports or robot.actions.running
    robot.actions.begin(act, problem=_problem(robot, act))
    if must_fail(act) and not told_before:
        alarm = action_failed(act, robot.alarms.get(ACTION_FAILED))
        robot.alarms[alarm.code] = alarm


def _problem(robot: SimRobot, act: Act) -> str | None:
    if must_fail(act):
        return f"{act.name} always fails"
    if robot.speed >= STANDING_MPS:
        return "the robot is moving"
    if act.name == CHARGE and stands_on(robot) not in robot.body.chargers:
        return "there is no charger here"
    return None
