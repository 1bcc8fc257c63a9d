"""What reports and tokens mean for the ledger: which robots answer and which do not."""

from collections.abc import Iterable, Mapping

from ledger.ids import RobotKey, robot_key
from ledger.proposals import AnyProposal, ConnectRobot, DisconnectRobot
from ledger.scene import Value
from ledger.state import Robot

REPORT_AGE_MS_MAX = 10_000  # robots report about ten times a second; a token alone is not enough


class Sighting(Value, frozen=True, kw_only=True):
    """What a link last had of a robot."""

    reported_ms: int | None = None  # when its newest report came in, by our clock
    alive: bool | None = None  # its token; None = the link has said nothing of it


def is_seen(sighting: Sighting | None, now_ms: int) -> bool:
    """Tell whether the robot answers: its token is not gone and it has reported of late."""
    if sighting is None or sighting.reported_ms is None or sighting.alive is False:
        return False
    return now_ms - sighting.reported_ms <= REPORT_AGE_MS_MAX


def observe(
    robots: Iterable[Robot],
    sightings: Mapping[RobotKey, Sighting],
    listening_since_ms: int,
    now_ms: int,
) -> tuple[AnyProposal, ...]:
    """Propose the connections that were made or lost since the ledger last heard of them.

    Who was connected before a restart of ours gets the time to speak up.
    """
    patient = now_ms - listening_since_ms <= REPORT_AGE_MS_MAX
    proposals: list[AnyProposal] = []
    for robot in robots:
        sighting = sightings.get(robot_key(robot.scene, robot.name))
        seen = is_seen(sighting, now_ms)
        unheard = sighting is None or (sighting.reported_ms is None and sighting.alive is not False)
        if seen and not robot.online:
            proposals.append(ConnectRobot(scene=robot.scene, robot=robot.name))
        elif robot.online and not seen and not (patient and unheard):
            proposals.append(DisconnectRobot(scene=robot.scene, robot=robot.name))
    return tuple(proposals)
