"""What the scheduler needs of traffic: one such thing for each enabled area of a scene."""

from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from typing import Protocol, TypeAlias

from ledger.ids import PointName, RobotName, SceneId
from ledger.link import Drive, Plan, Report, TellRoute
from ledger.scene import XY, Area, Door, Group
from ledger.scene_config import SceneConfig
from scheduler.goal import Goal
from scheduler.traffic.doors import DoorNow
from scheduler.traffic.guard import Breach


class Roads(Protocol):
    """The questions that dispatch asks of traffic. They change nothing."""

    def stands_at(self, robot: RobotName, point: PointName) -> bool:
        """Tell whether the robot rests there and has no move left: a state test, not an event."""

    def cost_s(self, robot: RobotName, point: PointName) -> float:
        """Give the driving time from where its committed moves end; infinite = no route."""

    def has_room(self, robot: RobotName) -> bool:
        """Tell whether it may take a load where it rests: it owns the ground for that."""

    def reserved(self, robot: RobotName, point: PointName) -> tuple[str, ...]:
        """Name the owners whose reserved ground alone keeps the robot from there."""


class TrafficLike(Roads, Protocol):
    """Moves the robots of one area without collision."""

    @property
    def ready(self) -> bool:
        """Every robot that is there has been placed; nobody moves before."""

    def tune(self, config: SceneConfig) -> None:
        """Take what settings of the scene are traffic's, at once."""

    def lay_doors(self, doors: Sequence[Door]) -> None:
        """Let nobody pass these doors until they are known to be open; called once, at first."""

    def follow_doors(self, now: Mapping[int, DoorNow]) -> None:
        """Take in how the doors are."""

    def wanted_doors(self) -> Mapping[int, tuple[RobotName, ...]]:
        """Say by door for whom it must be open; said before robots are placed too."""

    def add(self, robot: RobotName, group: int) -> None:
        """Expect the robot here."""

    def remove(self, robot: RobotName) -> None:
        """Forget the robot and all that it holds."""

    def observe(self, report: Report) -> None:
        """Place the robot at its first report, then follow its progress."""

    def load(self, robot: RobotName, *, loaded: bool) -> None:
        """Keep the ground of a loaded robot for it from now on, or of an empty one."""

    def lost(self, robot: RobotName) -> None:
        """Keep all that it holds, and wait for it no longer."""

    def remember(self, plan: Plan) -> None:
        """Keep ground and route of this plan for a robot that has not been heard yet."""

    def claim(
        self, id_: str, owner: str, rings: Sequence[tuple[XY, ...]], *, owned: bool = False
    ) -> None:
        """Reserve ground: no robot but the owner's own enters it from now on."""

    def unclaim(self, id_: str) -> None:
        """Give reserved ground back."""

    def claimed(self, id_: str) -> bool:
        """Tell whether no other robot is on that ground any more."""

    def step(
        self, now_ms: int, goals: Mapping[RobotName, Goal], busy: AbstractSet[RobotName]
    ) -> list[Drive | TellRoute]:
        """Plan and grant; who is busy neither moves nor is pushed."""

    def look(self, now_ms: int) -> list[Breach]:
        """Give what must not be by the robots' newest reports."""

    def excuse(self, robot: RobotName) -> None:
        """Let a robot go on in spite of a breach."""

    @property
    def breaches_so_far(self) -> int:
        """Count what must not have been."""

    def plans(self, now_ms: int) -> list[Plan]:
        """Say what is intended with every robot."""

    @property
    def pushes(self) -> int:
        """Count the robots that were sent out of the way of others."""

    @property
    def ladder(self) -> Mapping[str, int]:
        """Count what was done for robots that were stuck, and those of whom a person was told."""

    @property
    def plannings(self) -> Mapping[str, int]:
        """Count the plannings by what made them due."""


TrafficFactory: TypeAlias = Callable[[SceneId, Area, Sequence[Group]], TrafficLike]
