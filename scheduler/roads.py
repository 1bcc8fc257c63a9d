"""What the scheduler needs of traffic: one such thing for each enabled area of a scene."""

from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from typing import Protocol, TypeAlias

from ledger.ids import PointName, RobotName, SceneId
from ledger.link import Drive, Plan, Report, TellRoute
from ledger.scene import Area, Group
from scheduler.goal import Goal


class Roads(Protocol):
    """The questions that dispatch asks of traffic. They change nothing."""

    def stands_at(self, robot: RobotName, point: PointName) -> bool:
        """Tell whether the robot rests there and has no move left: a state test, not an event."""

    def cost_s(self, robot: RobotName, point: PointName) -> float:
        """Give the driving time from where its committed moves end; infinite = no route."""


class TrafficLike(Roads, Protocol):
    """Moves the robots of one area without collision."""

    @property
    def ready(self) -> bool:
        """Every robot that is there has been placed; nobody moves before."""

    def tune(self, point_distance_m: float, path_distance_m: float, plan_interval_ms: int) -> None:
        """Take settings of the scene (SceneConfig), at once."""

    def add(self, robot: RobotName, group: int) -> None:
        """Expect the robot here."""

    def remove(self, robot: RobotName) -> None:
        """Forget the robot and all that it holds."""

    def observe(self, report: Report) -> None:
        """Place the robot at its first report, then follow its progress."""

    def lost(self, robot: RobotName) -> None:
        """Keep all that it holds, and wait for it no longer."""

    def step(
        self, now_ms: int, goals: Mapping[RobotName, Goal], busy: AbstractSet[RobotName]
    ) -> list[Drive | TellRoute]:
        """Plan and grant; who is busy neither moves nor is pushed."""

    def plans(self, now_ms: int) -> list[Plan]:
        """Say what is intended with every robot."""


TrafficFactory: TypeAlias = Callable[[SceneId, Area, Sequence[Group]], TrafficLike]
