"""What reports and tokens mean for the ledger: which robots answer and which do not."""

from collections.abc import Iterable, Mapping

from ledger.ids import RobotKey, robot_key
from ledger.proposals import AnyProposal, ConnectRobot, DisconnectRobot
from ledger.scene import Value
from ledger.scene_config import SceneConfig
from ledger.state import Robot

LATE_MS = 2_000  # a report may take so long: on the robot, on the network, and in our own pass


class Sighting(Value, frozen=True, kw_only=True):
    """What a link last had of a robot."""

    reported_ms: int | None = None  # when its newest report came in, by our clock
    alive: bool | None = None  # its token; None = the link has said nothing of it


def lost_after_ms(config: SceneConfig) -> int:
    """Give for how long a robot may be silent: so many reports missed (spec/m4.md, SceneConfig).

    One late report is not a missed one, however short the interval is set.
    """
    missed_ms = config.state_failures_to_reconnect * config.state_fetch_ms
    return max(missed_ms, config.state_fetch_ms + LATE_MS)


def is_seen(sighting: Sighting | None, silent_ms_max: int, now_ms: int) -> bool:
    """Tell whether the robot answers: its token is not gone and it has reported of late."""
    if sighting is None or sighting.reported_ms is None or sighting.alive is False:
        return False
    return now_ms - sighting.reported_ms <= silent_ms_max


def observe(
    robots: Iterable[Robot],
    sightings: Mapping[RobotKey, Sighting],
    silent_ms_max: int,
    listening_since_ms: int,
    now_ms: int,
) -> tuple[AnyProposal, ...]:
    """Propose the connections that were made or lost since the ledger last heard of them.

    Who was connected before a restart of ours gets the time to speak up.
    """
    patient = now_ms - listening_since_ms <= silent_ms_max
    proposals: list[AnyProposal] = []
    for robot in robots:
        sighting = sightings.get(robot_key(robot.scene, robot.name))
        seen = is_seen(sighting, silent_ms_max, now_ms)
        unheard = sighting is None or (sighting.reported_ms is None and sighting.alive is not False)
        if seen and not robot.online:
            proposals.append(ConnectRobot(scene=robot.scene, robot=robot.name))
        elif robot.online and not seen and not (patient and unheard):
            proposals.append(DisconnectRobot(scene=robot.scene, robot=robot.name))
    return tuple(proposals)
