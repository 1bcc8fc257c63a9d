"""What the scheduler needs of a robot link; reports and tokens come in by its own callbacks."""

from typing import Protocol

from ledger.ids import SceneId
from ledger.link import ToRobot


class RobotLink(Protocol):
    """The way to the robots of one kind of protocol."""

    def tell(self, scene: SceneId, message: ToRobot) -> None:
        """Send, or drop if the robot is away: what matters is told again until it is reported."""
