"""Robots that speak our own messages over the bus: the simulated ones, and any that learn it."""

from collections.abc import Callable

import msgspec

from ledger.bus import Bus, tell_key
from ledger.ids import RobotName, SceneId
from ledger.link import Report, ToRobot, implausible

REPORTS = "scenes/*/robots/*/report"
TOKENS = "scenes/*/robots/*/alive"

_encoder = msgspec.json.Encoder()
_reports: msgspec.json.Decoder[Report] = msgspec.json.Decoder(Report)


class BusLink:
    """RobotLink over the bus, with the two callbacks through which robots are heard."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus

    def tell(self, scene: SceneId, message: ToRobot) -> None:
        """Publish under the robot's own key."""
        self._bus.publish(tell_key(scene, message.robot), _encoder.encode(message))

    def hear(
        self,
        on_report: Callable[[Report], None],
        on_alive: Callable[[SceneId, RobotName, bool], None],
        on_nonsense: Callable[[str, str], None],
    ) -> None:
        """Pass on reports and tokens, on the bus's own thread: the callbacks must only hand over.

        What cannot be read, or speaks for another robot, goes to `on_nonsense` (key, reason).
        """

        def report(key: str, payload: bytes) -> None:
            try:
                heard = read_report(key, payload)
            except ValueError as wrong:
                on_nonsense(key, str(wrong))
            else:
                on_report(heard)

        def token(key: str, alive: bool) -> None:
            scene, robot = robot_of(key)
            on_alive(scene, robot, alive)

        self._bus.subscribe(REPORTS, report)
        self._bus.watch(TOKENS, token)


def robot_of(key: str) -> tuple[SceneId, RobotName]:
    """Read whose key it is."""
    _, scene, _, robot, _ = key.split("/")
    return SceneId(scene), RobotName(robot)


def read_report(key: str, payload: bytes) -> Report:
    """Decode a report; raises ValueError if it is none, implausible, or another robot's."""
    report = _reports.decode(payload)  # msgspec.ValidationError is a ValueError
    if (report.scene, report.robot) != robot_of(key):
        raise ValueError(f"report of {report.scene}/{report.robot} came under {key}")
    if (what := implausible(report)) is not None:
        raise ValueError(what)
    return report
