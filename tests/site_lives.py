"""What may happen next to robots, scene, ground and devices of a history (tests/histories.py)."""

from random import Random

import msgspec

from ledger.events import (
    AnyEvent,
    DeviceFaulted,
    DeviceRecovered,
    DoorCloseAsked,
    DoorHeldOpen,
    DoorLetGo,
    DoorOpenAsked,
    LiftHeldOpen,
    LiftLetGo,
    MapResourcesAsked,
    MapResourcesGranted,
    MapResourcesReleased,
    RobotAdded,
    RobotAlarmsCleared,
    RobotBinsCleared,
    RobotConnected,
    RobotControlReleased,
    RobotControlTaken,
    RobotDisabled,
    RobotDisconnected,
    RobotEnabled,
    RobotGivenUp,
    RobotPaused,
    RobotReconfigured,
    RobotReconnectAsked,
    RobotRemoved,
    RobotResumed,
    RobotSoftStopLifted,
    RobotSoftStopped,
    RobotsWaited,
    RobotTrafficReset,
    RobotWentOffDuty,
    RobotWentOnDuty,
    SceneConfigured,
    SceneDisabled,
    SceneDispatchPaused,
    SceneDispatchResumed,
    SceneEnabled,
    SceneMapReplaced,
    SceneRenamed,
)
from ledger.ids import PointName, RobotName, SceneId, UnitId, path_key
from ledger.scene import Door, Lift, LiftFloor
from ledger.scene_config import SceneConfig
from ledger.state import BinStatus, DeviceKind, Fleet, MapUnit, Robot
from ledger.waits import CycleSeen, WaitReason, WaitSum
from tests.strategies import grid, robot_config

DOORS = tuple(
    Door(id=n, name=f"D{n}", area=0, paths=(path_key(f"AP{n}", f"AP{n + 1}"),)) for n in (1, 2)
)
LIFTS = (Lift(id=1, name="L1", floors=(LiftFloor(name="1", area=0),)),)
CLAIMS_MAX = 5


def of_robot(random: Random, fleet: Fleet, scene: SceneId) -> AnyEvent:
    if not fleet.robots or (len(fleet.robots) < 12 and random.random() < 0.1):
        taken = {r.name for r in fleet.robots.values()}
        config = next(c for c in map(robot_config, range(99)) if c.name not in taken)
        return RobotAdded(scene=scene, config=config)
    robot = fleet.robots[random.choice(list(fleet.robots))]
    name = robot.name
    if not robot.online:
        if random.random() < 0.2:
            ask = RobotReconnectAsked(scene=scene, robot=name)
            return ask if robot.given_up else RobotGivenUp(scene=scene, robot=name)
        return RobotConnected(scene=scene, robot=name)
    if robot.off_duty:
        return RobotWentOnDuty(scene=scene, robot=name)
    if robot.config.disabled:
        return RobotEnabled(scene=scene, robot=name)
    if any(b.status is BinStatus.CANCELLED for b in robot.bins):
        return RobotBinsCleared(scene=scene, robot=name)
    may: list[AnyEvent] = [
        RobotDisconnected(scene=scene, robot=name),
        RobotWentOffDuty(scene=scene, robot=name),
        RobotDisabled(scene=scene, robot=name),
        _told(random, robot),
        _told(random, robot),
    ]
    if not robot.orders:
        places = random.choice((robot.config.bin_count, 1, 2, 3))
        config = msgspec.structs.replace(robot.config, bin_count=places, remark="set up anew")
        may.append(RobotReconfigured(scene=scene, robot=name, config=config))
        may.append(RobotTrafficReset(scene=scene, robot=name))
        if len(fleet.robots) > 2:
            may.append(RobotRemoved(scene=scene, robot=name))
    return random.choice(may)


def _told(random: Random, robot: Robot) -> AnyEvent:
    kind = random.choice(
        (
            RobotSoftStopped,
            RobotSoftStopLifted,
            RobotPaused,
            RobotResumed,
            RobotControlReleased,
            RobotControlTaken,
            RobotAlarmsCleared,
        )
    )
    if kind is RobotControlTaken:
        gently = random.random() < 0.5
        return RobotControlTaken(scene=robot.scene, robot=robot.name, gently=gently)
    return kind(scene=robot.scene, robot=robot.name)


def of_scene(random: Random, fleet: Fleet, scene: SceneId) -> AnyEvent:
    """A scene out of service, or paused, comes back before anything else happens to it."""
    now = fleet.scenes[scene]
    if now.disabled:
        return SceneEnabled(scene=scene)
    if now.dispatch_paused:
        return SceneDispatchResumed(scene=scene)
    file = grid(columns=random.randint(4, 5), robots=0)
    replaced = SceneMapReplaced(
        scene=scene,
        digest=f"{random.getrandbits(64):064x}",
        areas=file.areas,
        groups=file.groups,
        doors=DOORS[: random.randint(1, 2)],
        lifts=LIFTS,
    )
    may: list[AnyEvent] = [
        *(replaced, replaced),
        SceneConfigured(
            scene=scene, config=SceneConfig(withdrawn_cost_min=float(random.randint(0, 9)))
        ),
        SceneRenamed(
            scene=scene, name=f"grid {random.randint(1, 9)}", display_order=random.randint(0, 9)
        ),
        SceneDisabled(scene=scene),
        SceneDispatchPaused(scene=scene),
    ]
    return random.choice(may)


def of_ground(random: Random, fleet: Fleet, scene: SceneId) -> AnyEvent:
    waiting = [id_ for id_, claim in fleet.claims.items() if not claim.granted]
    if waiting and random.random() < 0.5:
        return MapResourcesGranted(scene=scene, units=(waiting[0],))
    if fleet.claims and (len(fleet.claims) >= CLAIMS_MAX or random.random() < 0.3):
        id_, claim = random.choice(list(fleet.claims.items()))
        return MapResourcesReleased(scene=scene, units=(id_,), lapsed=not claim.granted)
    unit = MapUnit(
        id=UnitId(f"U{fleet.position}"),
        owner=random.choice(("crane", "R1")),
        area=0,
        points=(f"AP{random.randint(1, 4)}",),
        zones=(((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)),) if random.random() < 0.3 else (),
    )
    return MapResourcesAsked(scene=scene, units=(unit,))


def of_device(random: Random, fleet: Fleet, scene: SceneId) -> AnyEvent:
    now = fleet.scenes[scene]
    door, lift = random.choice(now.doors).id, random.choice(now.lifts).id
    fault = next(iter(fleet.device_faults.values()), None)
    if fault is not None:
        return DeviceRecovered(scene=scene, kind=fault.kind, device=fault.device)
    may: list[AnyEvent] = [
        DoorOpenAsked(scene=scene, door=door, remark="by hand"),
        DoorCloseAsked(scene=scene, door=door),
        DoorHeldOpen(scene=scene, door=door),
        DoorLetGo(scene=scene, door=door),
        LiftHeldOpen(scene=scene, lift=lift, area=0),
        LiftLetGo(scene=scene, lift=lift),
        DeviceFaulted(scene=scene, kind=DeviceKind.DOOR, device=door, reason="not heard"),
        DeviceFaulted(scene=scene, kind=DeviceKind.LIFT, device=lift, reason="not heard"),
    ]
    return random.choice(may)


def of_traffic(random: Random, fleet: Fleet, scene: SceneId) -> AnyEvent:
    names = sorted(r.name for r in fleet.robots.values() if r.scene == scene)
    external = RobotName("external:crane")
    waits = []
    for name in random.sample(names, random.randint(1, len(names))):
        others = [other for other in (*names, external) if other != name]
        blockers = tuple(random.sample(others, random.randint(0, 2)))
        longest_ms = random.randint(1_000, 60_000)
        waits.append(
            WaitSum(
                robot=name,
                reason=random.choice(list(WaitReason)),
                blockers=blockers,
                place=random.choice((None, PointName("AP1"), PointName("AP2"))),
                times=random.randint(1, 5),
                total_ms=longest_ms + random.randint(0, 9_000),
                longest_ms=longest_ms,
            )
        )
    from_ms = max(0, fleet.at_ms - 600_000)
    ring = CycleSeen(
        robots=tuple(names[:2]), from_ms=from_ms, until_ms=random.choice((None, fleet.at_ms))
    )
    return RobotsWaited(
        scene=scene,
        from_ms=from_ms,
        waits=tuple(waits),
        left_out_ms=random.randint(0, 999),
        cycles=(ring,) if random.random() < 0.5 else (),
        pushes=random.randint(0, 20),
        plannings={"Goals": random.randint(1, 50), "Progress": random.randint(1, 900)},
    )
